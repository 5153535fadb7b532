// Where the joint estimate begins, from the rests and the commanded angles of the table alone.
//
// At rest number k with commanded attitude C_k, levelled on the accelerometers, the gyros read
//   mean rate_k = N0 + C_k' (e_n, w_U, e_e)
// with w_U the known vertical part of the earth's rate and (e_n, e_e) its horizontal part in a frame whose north is the
// given one: five unknowns, linear, so the given heading may be wrong by any angle. The true north lies where (e_n, e_e)
// points. Used only as a start: the estimate linearises about it and goes on from there.
//
// The directions of gravity tell how the unit is mounted on the table: one of 24 orientations, or the reverse of one (the
// accelerometers have the wrong sign, which no mounting makes). They, and how far gravity and turns are off their size,
// say how wrong the start values can be: the plausible ranges follow from them.
#pragma once

#include <string>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct JointStart {
  Eigen::Matrix3d mounting = Eigen::Matrix3d::Identity();  // C_nb = C(table angles) mounting
  std::string mounting_text;  // empty: as the table's axes; "turned by 90 deg about up", ...
  std::string error;          // plain words when no mounting explains the rests: "gravity has the wrong sign", ...
  double heading_rad = 0.0;   // to be added to the commanded heading; 0 when the earth's rate is not seen
  double heading_sigma_rad = 1.0;
  Eigen::Vector3d N0_degph = Eigen::Vector3d::Zero();  // 0 where below what the start should know
  double accel_misfit = 0.0;                           // rms of |f| / g - 1 over the rests
  double static_s = 0.0;
};
JointStart joint_start(const CompressedRecording& recording, const Parameters& parameters);

}  // namespace turncal
