// What a recording of one pose can tell: noise, and how the readings change with time and temperature.
//
// A unit that lies still in one pose for a while determines no scale factor and no bias. Its Allan deviation gives the noise
// (calib/statistics/allan.h), and its slow changes give, axis by axis, a drift or a warm-up exp(-t/tau) and a temperature coefficient:
//   y = y0 + c_time x_time(t) + c_T (T - mean T)
// by least squares over batch means (at most 200 of them, so that what is correlated within a batch counts once); x_time is what BIC
// prefers of nothing, t, and exp(-t/tau) for the catalogue's time constants. Standard deviations are those of the residual. Where
// temperature follows the time too closely (correlation above 0.97) the two are aliases: each is then given alone, and marked.
// By the nominal scale, in the units of the effect catalogue; of the accelerometers whatever changes in this pose is called bias.
#pragma once

#include <string>
#include <vector>

#include "calib/statistics/allan.h"
#include "calib/statistics/compression.h"
#include "calib/types/status.h"

namespace turncal {

struct PoseCoefficient {
  std::string key;  // "gyro_warm_up.x"
  std::string unit;
  double value = 0.0;
  double sigma = 0.0;
  double tau_s = 0.0;  // 0: none
  bool alias = false;  // time and temperature cannot be told apart here
};

struct SinglePose {
  double duration_s = 0.0;
  AllanResult noise;
  std::vector<PoseCoefficient> coefficients;
};

// `recording` with blocks of a second (CompressionOptions{}). An error when less than 100 s of it are at rest.
Result<SinglePose> analyse_single_pose(const CompressedRecording& recording);

}  // namespace turncal
