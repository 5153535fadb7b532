// What a calibration keeps for the fleet: the parameters, and the scores of every effect that the model lacks.
//
// One filter pass at the estimate with all columns of the catalogue (calib/joint/joint_filter.h) gives information A and gradient c of
// [base b, columns c]. With the base eliminated (score_algebra.h),
//   Q = A_cc - A_cb A_bb^-1 A_bc,   s = -(c_c - A_cb A_bb^-1 c_b),   m = -A_bb^-1 A_bc
// any subset S of effects is estimated as Q_SS^-1 s_S with covariance Q_SS^-1, moves the parameters by m_S times that, and gains s_S'
// Q_SS^-1 s_S in 2 ln L: the recording itself is no longer needed. Quadratic about the estimate without effects, at its fitted noise.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

struct UnitStatistics {
  ParameterVector value = ParameterVector::Zero(),
                  sigma = ParameterVector::Zero();  // file units; sigma 0: fixed or not determined
  std::vector<std::string> columns;                 // column_key()
  Eigen::VectorXd s;                                // of each column
  Eigen::MatrixXf Q;                                // symmetric; rows of what the recording cannot see are 0
  Eigen::MatrixXf moves;                            // 24 x columns: m
  double level = 1.0;                               // rms normalised innovation
};

// "accel_creep.x", and with a time constant "accel_creep.x tau_s 300".
std::string column_key(const EffectColumn& column);

// REQUIRES: an estimate of this recording without effects, except turn-on columns (several_recordings.h).
UnitStatistics unit_statistics(const CompressedRecording& recording, const JointResult& estimate);

// The same for several recordings of one unit, joined. Effects of the time since a run began are those of the first.
// None if their estimate does not converge.
std::optional<UnitStatistics> unit_statistics(const std::vector<const CompressedRecording*>& recordings);

}  // namespace turncal
