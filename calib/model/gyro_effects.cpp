#include <cmath>

#include "calib/model/effects.h"

namespace turncal {
namespace {

using namespace effect_entry;

const std::vector<std::string_view> nine = {"xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"};
const std::vector<std::string_view> squares = {"x_xx", "x_yy", "x_zz", "x_xy", "x_xz", "x_yz", "y_xx", "y_yy", "y_zz",
                                               "y_xy", "y_xz", "y_yz", "z_xx", "z_yy", "z_zz", "z_xy", "z_xz", "z_yz"};
const std::vector<double> lock_in_rates_degph = {2.0, 5.0, 12.0};

// The earth's field in gauss, centred dipole: enough to test for a dependence on it, not a survey value.
Vector3d magnetic_field_n(const Site& site) {
  const double latitude = site.latitude_deg * rad_per_deg;
  return {0.31 * std::cos(latitude), -0.62 * std::sin(latitude), 0.0};
}

// At rest a unit turns with the earth. The measured rate has noise there, which a column made from it would share with the
// velocities that it is to explain: of 28 units two were given a lock-in of 6 sigma.
Vector3d rate_without_noise(const BlockState& s, const Site& site) {
  constexpr double at_rest = 30.0 * earth_rate_radps;
  return s.w_b.norm() > at_rest ? s.w_b : Vector3d(s.C_nb.transpose() * earth_rate_n(site.latitude_deg));
}

}  // namespace

std::vector<EffectEntry> gyro_effects() {
  return {
      {.name = "gyro_g_sensitivity",
       .term = "acceleration-sensitive drift (IEEE 952, 647)",
       .formula = "G f",
       .unit = "deg/h/g",
       .components = nine,
       .si = radps_per_degph,
       .seen_by = "static positions; its symmetric part with heading changes, to tell it from gyro_magnetic",
       .write = [](const BlockState& s, const Site&, double, Out g, Out) { full(g, in_g(s)); }},
      {.name = "gyro_scale_asymmetry",
       .term = "scale factor asymmetry (IEEE 647)",
       .formula = "c abs(w_i)",
       .unit = "ppm",
       .components = xyz,
       .si = 1e-6,
       .seen_by = "both senses of rotation",
       .write = [](const BlockState& s, const Site&, double, Out g, Out) { diagonal(g, s.w_b.cwiseAbs()); }},
      {.name = "gyro_rate_nonlinearity",
       .term = "scale factor nonlinearity (IEEE 647)",
       .formula = "c abs(w_i) w_i / (10 deg/s)",
       .unit = "ppm",
       .components = xyz,
       .si = 1e-6,
       .seen_by = "different rates (2, 10, 40 deg/s); a single rate aliases the scale factor",
       .write = [](const BlockState& s, const Site&, double, Out g,
                   Out) { diagonal(g, s.w_b.cwiseAbs().cwiseProduct(s.w_b) / (10.0 * rad_per_deg)); }},
      {.name = "gyro_bias_temperature",
       .term = "temperature coefficient of bias (IEEE 647, 952)",
       .formula = "c (T - T_ref)",
       .unit = "deg/h/C",
       .components = xyz,
       .si = radps_per_degph,
       .needs_temperature = true,
       .seen_by = "recorded temperature that changes",
       .write = [](const BlockState& s, const Site&, double, Out g,
                   Out) { diagonal(g, Vector3d::Constant(s.temperature_c)); }},
      {.name = "gyro_scale_temperature",
       .term = "temperature coefficient of scale factor (IEEE 647, 952)",
       .formula = "c (T - T_ref) w_i",
       .unit = "ppm/C",
       .components = xyz,
       .si = 1e-6,
       .needs_temperature = true,
       .seen_by = "recorded temperature that changes, turns at each end",
       .write = [](const BlockState& s, const Site&, double, Out g, Out) { diagonal(g, s.w_b * s.temperature_c); }},
      {.name = "gyro_bias_drift",
       .term = "bias drift, rate ramp (IEEE 952)",
       .formula = "c t",
       .unit = "deg/h/h",
       .components = xyz,
       .si = radps_per_degph,
       .of_one_run = true,
       .seen_by = "a longer run, a return to the first position",
       .write = [](const BlockState& s, const Site&, double, Out g,
                   Out) { diagonal(g, Vector3d::Constant(hours(s))); }},
      {.name = "gyro_warm_up",
       .term = "warm-up transient of bias (IEEE 647)",
       .formula = "c exp(-t/tau)",
       .unit = "deg/h",
       .components = xyz,
       .si = radps_per_degph,
       .taus_s = warm_up_taus_s,
       .of_one_run = true,
       .seen_by = "a longer run, dense in the first minutes",
       .write = [](const BlockState& s, const Site&, double tau, Out g,
                   Out) { diagonal(g, Vector3d::Constant(std::exp(-s.time_s / tau))); }},
      {.name = "gyro_magnetic",
       .term = "magnetic sensitivity (IEEE 647)",
       .formula = "M B_b",
       .unit = "deg/h/G",
       .components = nine,
       .si = radps_per_degph,
       .seen_by = "heading changes at each tilt",
       .write = [](const BlockState& s, const Site& site, double, Out g,
                   Out) { full(g, s.C_nb.transpose() * magnetic_field_n(site)); }},
      {.name = "gyro_accel_flexure",
       .term = "elastic misalignment of the gyro triad against the accelerometers",
       .formula = "(E f) x w",
       .unit = "arcsec/g",
       .components = nine,
       .si = rad_per_arcsec,
       .seen_by = "rotations about each axis at each tilt",
       .write =
           [](const BlockState& s, const Site&, double, Out g, Out) {
             // E_ij f_j turns the gyro triad about axis i: e_i x w f_j
             const Vector3d f = in_g(s);
             for (int i = 0; i < 3; ++i) {
               const Vector3d turn = Vector3d::Unit(i).cross(s.w_b);
               for (int j = 0; j < 3; ++j) g.col(3 * i + j) = turn * f[j];
             }
           }},
      {.name = "gyro_scale_warm_up",
       .term = "warm-up transient of scale factor (IEEE 647)",
       .formula = "c exp(-t/tau) w_i",
       .unit = "ppm",
       .components = xyz,
       .si = 1e-6,
       .taus_s = scale_warm_up_taus_s,
       .of_one_run = true,
       .seen_by = "turns about each axis at the beginning and later",
       .write = [](const BlockState& s, const Site&, double tau, Out g,
                   Out) { diagonal(g, s.w_b * std::exp(-s.time_s / tau)); }},
      {.name = "gyro_scale_drift",
       .term = "scale factor drift (IEEE 647)",
       .formula = "c t w_i",
       .unit = "ppm/h",
       .components = xyz,
       .si = 1e-6,
       .of_one_run = true,
       .seen_by = "turns about each axis at the beginning and at the end",
       .write = [](const BlockState& s, const Site&, double, Out g, Out) { diagonal(g, s.w_b * hours(s)); }},
      {.name = "gyro_g_squared",
       .term = "acceleration-squared-sensitive drift (IEEE 952, 647)",
       .formula = "G f_j f_k",
       .unit = "deg/h/g^2",
       .components = squares,
       .si = radps_per_degph,
       .seen_by = "dwells with each axis up, down and level; products at 45 deg",
       .write =
           [](const BlockState& s, const Site&, double, Out g, Out) {
             const Vector3d f = in_g(s);
             for (int i = 0; i < 3; ++i)
               g.block<1, 6>(i, 6 * i) << f.x() * f.x(), f.y() * f.y(), f.z() * f.z(), f.x() * f.y(), f.x() * f.z(),
                   f.y() * f.z();
           }},
      {.name = "gyro_lock_in",
       .term = "smooth lock-in of a ring laser (IEEE 647)",
       .formula = "c w_i / (1 + (w_i / w_0)^2)",
       .unit = "%",
       .components = {"x", "y", "z",
                      "all"},  // all: three gyros of a kind, which else an error of the earth rate imitates
       .si = 1e-2,
       .taus_s = lock_in_rates_degph,
       .variant = "w0_degph",
       .seen_by = "dwells with the axis north, south, up, down and east",
       .write =
           [](const BlockState& s, const Site& site, double w0_degph, Out g, Out) {
             const Vector3d w = rate_without_noise(s, site);
             const Vector3d ratio = w / (w0_degph * radps_per_degph);
             const Vector3d reading = w.array() / (1.0 + ratio.array().square());
             diagonal(g.leftCols<3>(), reading);
             g.col(3) = reading;
           }},
      {.name = "gyro_bias_temperature_rate",
       .term = "bias with the rate of temperature (IEEE 647, 952)",
       .formula = "c dT/dt",
       .unit = "deg/h/(C/h)",
       .components = xyz,
       .si = radps_per_degph,
       .needs_temperature = true,
       .seen_by = "temperature that changes at different rates",
       .write = [](const BlockState& s, const Site&, double, Out g,
                   Out) { diagonal(g, Vector3d::Constant(s.temperature_rate_c_per_h)); }},
      {.name = "gyro_bias_temperature_lag",
       .term = "bias with a temperature that lags (IEEE 647, 952)",
       .formula = "c (T lagged by tau - T_ref)",
       .unit = "deg/h/C",
       .components = xyz,
       .si = radps_per_degph,
       .taus_s = lag_taus_s,
       .needs_temperature = true,
       .seen_by = "temperature that changes, and then stays",
       .write = [](const BlockState& s, const Site&, double, Out g,
                   Out) { diagonal(g, Vector3d::Constant(s.lagged_temperature_c)); }},
  };
}

}  // namespace turncal
