// What a recording of one pose determines: noise, and how the readings change with time and temperature.
//
// A unit that lies still in one pose determines no scale factor and no bias. Its Allan deviation gives the noise
// (calib/statistics/allan.h). Its slow changes give, axis by axis, a drift or a warm-up exp(-t/tau) and a temperature coefficient:
//   y = y0 + c_time x_time(t) + c_T (T - mean T)
// by least squares over at most 200 batch means, so that correlation within a batch counts once. x_time is chosen by BIC from nothing, t,
// and exp(-t/tau) with the catalogue's time constants. Standard deviations come from the residual. If temperature follows time too closely
// (correlation above 0.97) the two are confounded: each coefficient is then fitted alone, and marked. Values are by the nominal scale, in
// the units of the effect catalogue. Any change of an accelerometer in this pose is reported as bias.
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
  bool alias = false;  // confounded: time and temperature
};

struct SinglePose {
  double duration_s = 0.0;
  AllanResult noise;
  std::vector<PoseCoefficient> coefficients;
};

// `recording`: compressed to blocks of a second (CompressionOptions{}). Returns an error if less than 100 s of it are at rest.
Result<SinglePose> analyse_single_pose(const CompressedRecording& recording);

}  // namespace turncal
