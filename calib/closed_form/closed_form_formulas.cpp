#include "calib/closed_form/closed_form_formulas.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

// heading, pitch, roll
constexpr AxisTriple at(double h, double p, double r) { return {{h, p, r}}; }

constexpr std::array<std::array<LegSpec, 2>, 13> legs_of_step = {{
    {{{at(0, 0, 0), at(0, 0, 360)}, {at(0, 0, 0), at(0, 0, -360)}}},          // 2
    {{{at(-90, 0, 0), at(0, 360, 0)}, {at(-90, 0, 0), at(0, -360, 0)}}},      // 3
    {{{at(-90, 0, -90), at(0, 360, 0)}, {at(-90, 0, -90), at(0, -360, 0)}}},  // 4
    {{{at(0, 0, 0), at(0, 0, 180)}, {at(0, 0, 0), at(0, 0, -180)}}},          // 5
    {{{at(-90, 0, 0), at(0, 180, 0)}, {at(-90, 0, 0), at(0, -180, 0)}}},      // 6
    {{{at(0, 0, 0), at(0, 0, 90)}, {at(0, 0, 0), at(0, 0, -90)}}},            // 7
    {{{at(-90, 0, 0), at(0, 90, 0)}, {at(-90, 0, 0), at(0, -90, 0)}}},        // 8
    {{{at(-90, 0, -90), at(0, 90, 0)}, {at(-90, 0, -90), at(0, -90, 0)}}},    // 9
    {{{at(-90, 0, 0), at(0, 0, 90)}, {at(-90, 0, 0), at(0, 0, -90)}}},        // 10
    {{{at(-90, 0, 0), at(90, 0, 0)}, {at(-90, 0, 0), at(-90, 0, 0)}}},        // 11
    {{{at(0, 0, 0), at(0, 90, 0)}, {at(0, 0, 0), at(0, -90, 0)}}},            // 12
    {{{at(0, 0, 0), at(0, 0, 0)}, {}}},                                       // 13
    {{{at(-90, 0, 0), at(0, 0, 0)}, {}}},                                     // 14
}};

// The specific force along a body axis that stands vertical but for a small tilt: the two others see the tilt, so the
// axis sees what they leave of g. (With the plain g a table 3 arc-minutes off level spoils a_ii by 0.4 ppm.)
double vertical_force(const Eigen::Vector3d& f, int axis, double gravity) {
  const double across2 = f.squaredNorm() - f[axis] * f[axis];
  return std::sqrt(std::max(gravity * gravity - across2, 0.25 * gravity * gravity));
}

// The calibrated reading is s f + e with s the scale error and e the bias error: solved for both, then taken out.
void correct_scale_and_bias(const StepMeasurement& m, Parameters& p) {
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d& up = m.up[static_cast<std::size_t>(i)];
    const Eigen::Vector3d& down = m.down[static_cast<std::size_t>(i)];
    const double force_up = vertical_force(up, i, m.gravity_mps2);
    const double force_down = vertical_force(down, i, m.gravity_mps2);
    const double scale = (up[i] - down[i]) / (force_up + force_down);
    const double bias = up[i] - scale * force_up;
    p.A0_g[i] = (p.A0_g[i] + bias / standard_gravity_mps2) / scale;
    p.a.row(i) /= scale;
  }
}

}  // namespace

const std::array<VerticalSpec, 6> closed_form_verticals = {{
    {1, 0, true, at(0, 90, 0)},
    {1, 0, false, at(0, -90, 0)},
    {1, 1, true, at(0, 0, 0)},
    {5, 1, false, at(0, 0, 180)},
    {1, 2, true, at(0, 0, -90)},
    {1, 2, false, at(0, 0, 90)},
}};

std::span<const LegSpec> closed_form_legs(int step) {
  if (step < 2 || step > closed_form_steps) return {};
  return std::span(legs_of_step[static_cast<std::size_t>(step - 2)]).first(step < 13 ? 2 : 1);
}

void correct_parameters(const StepMeasurement& m, Parameters& p) {
  if (m.step == 1) return correct_scale_and_bias(m, p);

  const double g = m.gravity_mps2;
  const LegMotion& leg = m.leg1;
  const double T = leg.dwell_s;
  const Eigen::Vector3d slope1 = m.leg1.velocity_mps / m.leg1.dwell_s;
  if (m.step >= 13) {
    // A rate error d has turned the attitude by d t at time t since levelling, so the dwell gains g d (T^2/2 + t0 T).
    const double east = slope1.z() / (g * (0.5 * T + leg.before_dwell_s)) / radps_per_degph;
    const double north = slope1.x() / (g * (0.5 * T + leg.before_dwell_s)) / radps_per_degph;
    // phi_U' = w_N phi_E - dw_U, and the integral of phi_E is V_N / g: an error of the given heading, which tilts about
    // east, is kept out of the drift of the heading (0.0002 deg/h in 600 s at 3 arc-minutes).
    const double from_tilt_rad = m.earth_north_radps * leg.velocity_mps.x() / g;
    p.N0_degph[1] -= (leg.heading_change_rad - from_tilt_rad) / (T + leg.before_dwell_s) / radps_per_degph;
    if (m.step == 13) {
      p.N0_degph[0] += east;
      p.N0_degph[2] -= north;
    } else {
      p.N0_degph[2] += east;
    }
    return;
  }

  // East velocities only: -g phi_N. An error psi of the given heading lets earth rate leak in as psi w_N about east,
  // seen in the north velocity; about north it enters only as psi^2.
  const double slope2_east = m.leg2.velocity_mps.z() / m.leg2.dwell_s;
  const double sum = (slope1.z() + slope2_east) / (2.0 * g);         // (V1 + V2) / (2 g T)
  const double difference = (slope1.z() - slope2_east) / (2.0 * g);  // (V1 - V2) / (2 g T)
  const double g_unit = g / standard_gravity_mps2;                   // A0 is in g of 9.80665 m/s^2
  switch (m.step) {
    case 2: p.n(0, 0) *= 1.0 - difference / (2.0 * pi); break;
    case 3: p.n(2, 2) *= 1.0 - difference / (2.0 * pi); break;
    case 4: p.n(1, 1) *= 1.0 - difference / (2.0 * pi); break;
    case 5: p.A0_g[2] -= 0.5 * sum * g_unit; break;
    case 6: p.A0_g[0] += 0.5 * sum * g_unit; break;
    case 7:
      p.A0_g[1] += difference * g_unit;
      p.a(1, 2) += p.a(2, 2) * sum;
      break;
    case 8: p.a(0, 1) -= p.a(1, 1) * sum; break;
    case 9: p.a(0, 2) -= p.a(2, 2) * sum; break;
    case 10:
      p.n(1, 0) -= p.n(0, 0) * sum;
      p.n(2, 0) -= p.n(0, 0) * difference;
      break;
    case 11:
      p.n(0, 1) += p.n(1, 1) * sum;
      p.n(2, 1) += p.n(1, 1) * difference;
      break;
    case 12:
      p.n(1, 2) += p.n(2, 2) * sum;
      p.n(0, 2) -= p.n(2, 2) * difference;
      break;
    default: break;
  }
}

}  // namespace turncal
