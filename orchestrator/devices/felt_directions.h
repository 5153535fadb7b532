// What a unit on a table at known angles must feel, coarsely: gravity upwards at rest, C_bn (0, g, 0), and the turn of one axis about the
// body axis that the angles say (C_nb = Ry(-H) Rz(P) Rx(R)), with that sign. An error says in one line what was felt instead.
#pragma once

#include <optional>
#include <utility>

#include <Eigen/Core>

#include "calib/types/axis.h"
#include "calib/types/status.h"

namespace turncal {

struct DirectionLimits {
  double direction_deg = 20.0;     // of gravity, and of a turn
  double force_tolerance = 0.2;    // of 1
  double smallest_turn_deg = 2.0;  // that is judged
};

Eigen::Matrix3d attitude_of(const AxisTriple& angles_deg);  // C_nb

// Axis and angle of a turn; nothing when more than one axis differs.
std::optional<std::pair<Axis, double>> turn_between(const AxisTriple& from_deg, const AxisTriple& to_deg);

// Means over a rest: m/s^2.
Status judge_force(const Eigen::Vector3d& force_mps2, const AxisTriple& angles_deg, double gravity_mps2,
                   const DirectionLimits& limits);
// The gyros' sum over a turn from `from` to `to`, which differ in one axis: degrees, by nominal scale factors.
Status judge_felt(const Eigen::Vector3d& sum_deg, const AxisTriple& from_deg, const AxisTriple& to_deg,
                  const DirectionLimits& limits);

}  // namespace turncal
