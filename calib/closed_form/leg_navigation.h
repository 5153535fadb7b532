// Navigation of one leg of the closed form on the blocks of a CompressedRecording: level, rotate, dwell.
//
// A leg goes from one static segment (alignment or dwell) of a step to the next one of the same step. It begins at the
// end of the first: heading as commanded there, levelled by the mean specific force over the whole segment. Everything
// up to the second static segment is navigated (a single rotation as a rule; a dwell that did not count and was closed
// as `rotate` is part of the way), then the second one:
//   C_nb(t + dt) = Exp(-w_ie dt) C_nb(t) Exp(rotation)
//   v_n += Exp(-w_ie dt / 2) C_nb(t) velocity - g dt U
// n turns with the earth while a block passes, so what was gained is seen from a frame half a block on. The navigated
// velocity is an error (the unit stands) of cm/s, for which Schuler loop and Coriolis term are left out.
//
// velocity_mps is gained between the first and the last sample of the dwell, whatever was gained on the way. During the
// rotation the attitude error is still growing; only in the dwell is it constant, phi, and the velocity V = slope * T
// with slope (+g phi_E, -g phi_N): that is what the formulas of the closed form divide by T.
//
// Lost samples: at rest the block is stretched to its length, which is exact; in motion the angle is lost, and the
// caller must not use the leg (lost_in_motion). Glitches are not looked for.
#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"
#include "calib/types/status.h"

namespace turncal {

// Blocks of segment k are [first[k], first[k + 1]).
std::vector<std::size_t> first_blocks(const CompressedRecording& recording);

// Mean calibrated specific force over a static segment, body frame, m/s^2. REQUIRES a block in it.
Eigen::Vector3d mean_specific_force(const CompressedRecording& recording, const std::vector<std::size_t>& first_block,
                                    std::size_t segment, const SensorModel& model);

// Samples are missing in block `index` and the unit was turning before or after them.
bool lost_in_motion(const CompressedRecording& recording, std::size_t index, const SensorModel& model);

struct LegMotion {
  Eigen::Vector3d velocity_mps;     // n frame, gained in the dwell: from its first sample to its last
  double dwell_s = 0.0;             // T
  double before_dwell_s = 0.0;      // from levelling to the start of the dwell
  double heading_change_rad = 0.0;  // since levelling, clockwise; for legs that do not turn
  Eigen::Matrix3d C_nb_start;       // levelled
  Eigen::Matrix3d C_nb_arrived;     // at the start of the dwell
  double turned_rad = 0.0;          // about axis_b, signed, on the way (0 when axis_b is zero)
};

// `axis_b`: the body axis about which the table turns on the way; zero when it does not.
LegMotion navigate_leg(const CompressedRecording& recording, const std::vector<std::size_t>& first_block,
                       std::size_t from_segment, std::size_t to_segment, const SensorModel& model,
                       const Eigen::Vector3d& axis_b);

}  // namespace turncal
