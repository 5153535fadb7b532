// What each of the fourteen steps measures, and the formula that turns it into parameters. Derived in
// docs/closed-form.md from the error equations of a unit at rest (n = north, up, east; phi the attitude error,
// C_computed = (I - [phi x]) C):
//
//   phi' = -w_ie x phi - C_nb dw_b,     dV_N' = +g phi_E,     dV_E' = -g phi_N
//
// with dw_b what the calibrated gyro reads too much. The document's formulas are for dwells of one length T; the code
// takes each leg's own, V/T instead of V.
#pragma once

#include <array>
#include <span>

#include <Eigen/Core>

#include "calib/closed_form/leg_navigation.h"
#include "calib/model/parameters.h"
#include "calib/types/axis.h"

namespace turncal {

inline constexpr int closed_form_steps = 14;

// A leg as commanded: heading, pitch, roll at its start (up to whole turns) and the turn to its end.
struct LegSpec {
  AxisTriple from_deg;
  AxisTriple turn_deg;
};
// The legs of steps 2 to 14 whose velocities are V1 and V2. Step 1 has none; 13 and 14 have one, without a turn.
std::span<const LegSpec> closed_form_legs(int step);

// A static segment of step 1 (y down: of step 5) in which a body axis is vertical.
struct VerticalSpec {
  int step;
  int body_axis;
  bool up;
  AxisTriple at_deg;
};
extern const std::array<VerticalSpec, 6> closed_form_verticals;

struct StepMeasurement {
  int step = 0;
  double gravity_mps2 = 0.0;
  double earth_north_radps = 0.0;  // w_N
  // Step 1: mean calibrated specific force with body axis i up and down, m/s^2, body frame.
  std::array<Eigen::Vector3d, 3> up{};
  std::array<Eigen::Vector3d, 3> down{};
  // Steps 2 to 14.
  LegMotion leg1;
  LegMotion leg2;  // steps 2 to 12
};

// Corrects the parameters that the step determines, by the derived formulas.
void correct_parameters(const StepMeasurement& measured, Parameters& parameters);

}  // namespace turncal
