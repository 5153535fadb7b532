// What a unit on a table at known angles must measure, coarsely: gravity upwards at rest, C_bn (0, g, 0), and the turn of one axis about the
// body axis that follows from the angles (C_nb = Ry(-H) Rz(P) Rx(R)), with that sign. An error says in one line what was measured instead.
#pragma once

#include <Eigen/Core>

#include <optional>
#include <string>
#include <utility>

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

// Does the earth turn as site.latitude_deg says? From the rests of a run's first step, before anything is estimated.
//
//   rest k:  w_k = b + C_k^T e + noise     b: the gyros' biases;  e: the earth's rate in the table's base, north, up, east
//
// C_k is the attitude by the table's angles, turned so that up is where the accelerometers feel it. b begins as 0 +- what a bias may well
// be: 1 deg/h where the first rest's rate is of the earth's size as that of a laser gyro is, and else ten times what it is off by. Poses that
// turn over tell b from e. So the first rest finds the other hemisphere, and the third a latitude that is a few degrees off. What is judged is e_up / |e| = sin(latitude):
// a common scale error of the gyros does not matter. Linear least squares, rest by rest.
//
// Nothing is judged while |e| is not of the earth's size (units, dead gyros: other checks), nor after a rest that contradicts those
// before it (an axis or a sign: checked by the turns). Coarse on purpose, see EarthRateLimits.
struct EarthRateLimits {
  double sigmas = 5.0;
  double least_difference = 0.05;      // of sin(latitude): more than effects of the field on the gyros
  double least_bias_degph = 1.0;       // sigma
  double strange_bias = 10.0;          // sigma, times what the first rest's rate is off from the earth's
  double misalignment_rad = 0.005;     // of gyros and fixture, against what the table's angles say
  double contradiction = 16.0;         // chi squared of one rest, of three: 0.1 %
  double smallest = 0.5, largest = 2;  // of the earth's rate
};

class EarthRateCheck {
 public:
  explicit EarthRateCheck(double latitude_deg, EarthRateLimits limits = {})
      : latitude_deg_(latitude_deg), limits_(limits) {}
  // rad/s, body axes, by the nominal scale; sigma of the mean of one axis. C_nb by the table's angles; up: the specific force.
  // What is wrong, in one line; empty: nothing that is seen.
  std::string add_rest(const Eigen::Vector3d& rate_radps, double sigma_radps, const Eigen::Matrix3d& C_nb,
                       const Eigen::Vector3d& up);

 private:
  double latitude_deg_;
  EarthRateLimits limits_;
  Eigen::Matrix<double, 6, 1> x_ = Eigen::Matrix<double, 6, 1>::Zero();  // b, e
  Eigen::Matrix<double, 6, 6> P_ = Eigen::Matrix<double, 6, 6>::Zero();
  int rests_ = 0;
  bool contradictory_ = false;
};

}  // namespace turncal
