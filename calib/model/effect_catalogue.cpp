#include "calib/model/effects.h"

#include <cmath>

namespace turncal {
namespace {

using Eigen::Vector3d;
using Out = Eigen::Ref<Eigen::Matrix3Xd>;
using State = const BlockState&;

constexpr double g0 = standard_gravity_mps2, micro_g = 1e-6 * g0;

// Specific force in g, the unit in which accelerometer polynomials are stated.
Vector3d in_g(State s) { return s.f_b / g0; }

// Functions of time and temperature.
using Number = double (*)(State s, double tau);
double hours(State s, double) { return s.time_s / 3600.0; }
double faded(State s, double tau) { return std::exp(-s.time_s / tau); }
double temperature(State s, double) { return s.temperature_c; }
double temperature_rate(State s, double) { return s.temperature_rate_c_per_h; }
double lagged_temperature(State s, double) { return s.lagged_temperature_c; }

// One value an axis: component k acts on axis k.
using PerAxis = Vector3d (*)(State s, double tau);
template <Number number>
Vector3d bias(State s, double tau) {
  return Vector3d::Constant(number(s, tau));
}
template <Number number>
Vector3d of_force(State s, double tau) {
  return in_g(s) * number(s, tau);
}
template <Number number>
Vector3d of_rate(State s, double tau) {
  return s.w_b * number(s, tau);
}
Vector3d square(State s, double) { return in_g(s).cwiseAbs2(); }
Vector3d size(State s, double) { return in_g(s).cwiseAbs(); }
Vector3d odd_square(State s, double) { return in_g(s).cwiseProduct(in_g(s).cwiseAbs()); }
Vector3d cube(State s, double) { return in_g(s).array().cube(); }
Vector3d creep(State s, double) { return (s.f_b - s.lagged_f_b) / g0; }
Vector3d while_turning(State s, double) { return Vector3d::Constant(s.w_b.norm() > 0.5 * rad_per_deg ? 1.0 : 0.0); }
Vector3d relaxation(State s, double tau) {
  if (s.since_rotation_s >= 1e6) return Vector3d::Zero();
  return in_g(s) * std::exp(-s.since_rotation_s / tau);
}
Vector3d rate_size(State s, double) { return s.w_b.cwiseAbs(); }
// Returns the mean square of a rate that changes evenly over the block, less the square of its mean.
Eigen::Array3d more_of_square(State s) { return (s.duration_s * s.w_dot_b).array().square() / 12.0; }
Vector3d rate_nonlinearity(State s, double) {
  const auto w = s.w_b.array();
  return (w.abs() * w + w.sign() * more_of_square(s)) / (10.0 * rad_per_deg);
}
Vector3d rate_cube(State s, double) {
  const auto w = s.w_b.array();
  return w * (w.square() + 3.0 * more_of_square(s)) / std::pow(10.0 * rad_per_deg, 2);
}

void diagonal(Out out, const Vector3d& value) { out.leftCols<3>().diagonal() = value; }
template <PerAxis value>
void of_gyros(State s, const Site&, double tau, Out g, Out) {
  diagonal(g, value(s, tau));
}
template <PerAxis value>
void of_accels(State s, const Site&, double tau, Out, Out a) {
  diagonal(a, value(s, tau));
}

// Full matrix: component 3 i + j puts value_j on axis i.
void full(Out out, const Vector3d& value) {
  for (int i = 0; i < 3; ++i) out.block<1, 3>(i, 3 * i) = value.transpose();
}
void cross_coupling(State s, const Site&, double, Out, Out a) {
  const Vector3d f = in_g(s);
  full(a, Vector3d(f.x() * f.y(), f.x() * f.z(), f.y() * f.z()));
}
void size_effect(State s, const Site&, double, Out, Out a) {
  const Eigen::Matrix3d faster = skew(s.w_dot_b), turning = skew(s.w_b);
  const Eigen::Matrix3d m = faster + turning * turning + s.duration_s * s.duration_s / 12.0 * faster * faster;
  for (int i = 0; i < 3; ++i) a.block(i, 3 * i, 1, 3) = m.row(i);
}
void delay(State s, const Site&, double, Out, Out a) { a.col(0) = s.w_b.cross(s.f_b); }
void g_sensitivity(State s, const Site&, double, Out g, Out) { full(g, in_g(s)); }
void magnetic(State s, const Site& site, double, Out g, Out) {
  // The Earth's field in gauss, a centred dipole: enough to test for a dependence on it, not a survey value.
  const double latitude = site.latitude_deg * rad_per_deg;
  full(g, s.C_nb.transpose() * Vector3d(0.31 * std::cos(latitude), -0.62 * std::sin(latitude), 0.0));
}
// E_ij f_j turns the gyro triad about axis i: e_i x w f_j
void flexure(State s, const Site&, double, Out g, Out) {
  const Vector3d f = in_g(s);
  for (int i = 0; i < 3; ++i) g.middleCols<3>(3 * i) = Vector3d::Unit(i).cross(s.w_b) * f.transpose();
}
void g_squared(State s, const Site&, double, Out g, Out) {
  const Vector3d f = in_g(s);
  for (int i = 0; i < 3; ++i)
    g.block<1, 6>(i, 6 * i) << f.x() * f.x(), f.y() * f.y(), f.z() * f.z(), f.x() * f.y(), f.x() * f.z(), f.y() * f.z();
}
// At rest the Earth's rate is used. A column made from the measured rate would share its noise with the velocities that
// it is to explain: of 28 units two were given a lock-in of 6 sigma.
void lock_in(State s, const Site& site, double w0_degph, Out g, Out) {
  constexpr double at_rest = 30.0 * earth_rate_radps;
  const Vector3d w = s.w_b.norm() > at_rest ? s.w_b : Vector3d(s.C_nb.transpose() * earth_rate_n(site.latitude_deg));
  const Vector3d ratio = w / (w0_degph * radps_per_degph);
  const Vector3d reading = w.array() / (1.0 + ratio.array().square());
  diagonal(g.leftCols<3>(), reading);
  g.col(3) = reading;
}
// The standing wave of a hemispherical shell lags the case by 0.277 of its rotation; its damping has four periods around the rim.
void wave_angle(State s, const Site&, double, Out g, Out) {
  for (int i = 0; i < 3; ++i) {
    const double phase = 4.0 * 0.277 * s.turned_rad[i];
    g(i, 2 * i) = std::cos(phase);
    g(i, 2 * i + 1) = std::sin(phase);
  }
}
void earth_rate(State s, const Site&, double, Out g, Out) { g = s.C_nb.transpose().leftCols<2>(); }
void sample_period(State s, const Site& site, double, Out g, Out) {
  g.col(0) = s.C_nb.transpose() * earth_rate_n(site.latitude_deg);
}

using Names = std::vector<std::string_view>;
using Taus = std::vector<double>;

std::vector<EffectEntry> make_catalogue() {
  constexpr Sensor gyro = Sensor::gyro, accel = Sensor::accelerometer;
  const Names xyz = {"x", "y", "z"};
  const Names nine = {"xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"};
  const Names products = {"x_xy", "x_xz", "x_yz", "y_xy", "y_xz", "y_yz", "z_xy", "z_xz", "z_yz"};
  const Names squares = {"x_xx", "x_yy", "x_zz", "x_xy", "x_xz", "x_yz", "y_xx", "y_yy", "y_zz",
                         "y_xy", "y_xz", "y_yz", "z_xx", "z_yy", "z_zz", "z_xy", "z_xz", "z_yz"};
  const Names waves = {"x_cos", "x_sin", "y_cos", "y_sin", "z_cos", "z_sin"};
  const Names earth_axes = {"north", "up"}, period = {"period"}, tau = {"tau"};
  const Names and_all = {"x", "y", "z", "all"};  // all: common to the gyros, else like an error of the Earth's rate
  const Names arms = {"x_rx", "x_ry", "x_rz", "y_rx", "y_ry", "y_rz", "z_rx", "z_ry", "z_rz"};
  const Taus warm_up_taus_s = {60.0, 120.0, 240.0, 480.0, 960.0, 1920.0, 3840.0, 7680.0, 30720.0};
  const Taus scale_warm_up_taus_s = {240.0, 960.0, 1920.0, 7680.0};  // a slower exponential is a drift
  const Taus creep_taus_s = {60.0, 150.0, 400.0, 1000.0}, relaxation_taus_s = {2.0, 5.0, 12.0};
  const Taus lag_taus_s = {150.0, 300.0, 1200.0, 4800.0}, lock_in_rates_degph = {2.0, 5.0, 12.0};
  std::vector<EffectEntry> rows = {
      {"accel_second_order", accel, Quantity::bias, Driver::force, "second-order nonlinearity K2 (IEEE 1293)",
       "K2 f_i^2", "ug/g^2", xyz, micro_g,
       "+1 g, -1 g and 0 g on each axis; dwells at 45 deg separate it from the scale asymmetry", of_accels<square>},
      {"accel_scale_asymmetry", accel, Quantity::bias, Driver::force, "scale factor asymmetry (IEEE 1293)",
       "Ka abs(f_i)", "ppm", xyz, micro_g, "+1 g, -1 g and 0 g on each axis; dwells at 45 deg separate it from K2",
       of_accels<size>},
      {"accel_odd_quadratic", accel, Quantity::bias, Driver::force, "odd quadratic coefficient (IEEE 1293)",
       "Ko f_i abs(f_i)", "ug/g^2", xyz, micro_g, "dwells at 45 deg", of_accels<odd_square>},
      {"accel_third_order", accel, Quantity::bias, Driver::force, "third-order nonlinearity K3 (IEEE 1293)", "K3 f_i^3",
       "ug/g^3", xyz, micro_g, "dwells at 45 deg", of_accels<cube>},
      {"accel_cross_coupling", accel, Quantity::bias, Driver::force, "cross-coupling Kip, Kio, Kop (IEEE 1293)",
       "K f_j f_k", "ug/g^2", products, micro_g, "rotations with velocity carried; dwells at 45 deg", cross_coupling},
      {"accel_size_effect", accel, Quantity::bias, Driver::rate, "size effect: arm of each accelerometer",
       "row i of (w' x r_i + w x (w x r_i))", "mm", arms, 1e-3,
       "rotations with velocity carried; the common part of the three arms is invisible", size_effect},
      {"accel_delay", accel, Quantity::bias, Driver::rate, "time delay of the accelerometers after the gyros",
       "tau (w x f)", "ms", tau, 1e-3, "rotations with velocity carried", delay},
      {"accel_bias_temperature", accel, Quantity::bias, Driver::temperature,
       "temperature coefficient of bias (IEEE 1293)", "c (T - T_ref)", "ug/C", xyz, micro_g,
       "recorded temperature that changes", of_accels<bias<temperature>>},
      {"accel_scale_temperature", accel, Quantity::scale_factor, Driver::temperature,
       "temperature coefficient of scale factor (IEEE 1293)", "c (T - T_ref) f_i", "ppm/C", xyz, micro_g,
       "recorded temperature that changes, +1 g and -1 g at each end", of_accels<of_force<temperature>>},
      {"accel_bias_drift", accel, Quantity::bias, Driver::time, "bias drift (IEEE 1293)", "c t", "ug/h", xyz, micro_g,
       "a return to an earlier position", of_accels<bias<hours>>},
      {"accel_warm_up", accel, Quantity::bias, Driver::time, "warm-up transient of bias (IEEE 1293)", "c exp(-t/tau)",
       "ug", xyz, micro_g, "a return to an earlier position, dense in the first minutes", of_accels<bias<faded>>,
       warm_up_taus_s},
      {"accel_scale_warm_up", accel, Quantity::scale_factor, Driver::time,
       "warm-up transient of scale factor (IEEE 1293)", "c exp(-t/tau) f_i", "ppm", xyz, micro_g,
       "+1 g and -1 g at the beginning and later", of_accels<of_force<faded>>, scale_warm_up_taus_s},
      {"accel_scale_drift", accel, Quantity::scale_factor, Driver::time, "scale factor drift (IEEE 1293)", "c t f_i",
       "ppm/h", xyz, micro_g, "+1 g and -1 g at the beginning and at the end", of_accels<of_force<hours>>},
      {"accel_creep", accel, Quantity::bias, Driver::turns, "creep after a change of specific force",
       "c (f_i - f_i lagged by tau)", "ug/g", xyz, micro_g, "long dwells after a change of the axis from up to down",
       of_accels<creep>, creep_taus_s},
      {"accel_rectification", accel, Quantity::bias, Driver::rate,
       "bias while the unit turns (vibration rectification, IEEE 1293)", "c while abs(w) > 0.5 deg/s", "ug", xyz,
       micro_g, "rotations with velocity carried, of different lengths", of_accels<while_turning>},
      {"accel_bias_temperature_rate", accel, Quantity::bias, Driver::temperature,
       "bias with the rate of temperature (IEEE 1293)", "c dT/dt", "ug/(C/h)", xyz, micro_g,
       "temperature that changes at different rates", of_accels<bias<temperature_rate>>},
      {"accel_bias_temperature_lag", accel, Quantity::bias, Driver::temperature,
       "bias with a temperature that lags (IEEE 1293)", "c (T lagged by tau - T_ref)", "ug/C", xyz, micro_g,
       "temperature that changes, and then stays", of_accels<bias<lagged_temperature>>, lag_taus_s},
      {"gyro_g_sensitivity", gyro, Quantity::bias, Driver::force, "acceleration-sensitive drift (IEEE 952, 647)", "G f",
       "deg/h/g", nine, radps_per_degph,
       "static positions; its symmetric part with heading changes, to tell it from gyro_magnetic", g_sensitivity},
      {"gyro_scale_asymmetry", gyro, Quantity::scale_factor, Driver::rate, "scale factor asymmetry (IEEE 647)",
       "c abs(w_i)", "ppm", xyz, 1e-6, "both senses of rotation", of_gyros<rate_size>},
      {"gyro_rate_nonlinearity", gyro, Quantity::scale_factor, Driver::rate, "scale factor nonlinearity (IEEE 647)",
       "c abs(w_i) w_i / (10 deg/s)", "ppm", xyz, 1e-6,
       "different rates (2, 10, 40 deg/s); a single rate aliases the scale factor", of_gyros<rate_nonlinearity>},
      {"gyro_rate_third_order", gyro, Quantity::scale_factor, Driver::rate,
       "third-order nonlinearity of scale factor (IEEE 647)", "c w_i^3 / (10 deg/s)^2", "ppm", xyz, 1e-6,
       "three rates and more (2, 10, 40 deg/s)", of_gyros<rate_cube>},
      {"gyro_bias_temperature", gyro, Quantity::bias, Driver::temperature,
       "temperature coefficient of bias (IEEE 647, 952)", "c (T - T_ref)", "deg/h/C", xyz, radps_per_degph,
       "recorded temperature that changes", of_gyros<bias<temperature>>},
      {"gyro_scale_temperature", gyro, Quantity::scale_factor, Driver::temperature,
       "temperature coefficient of scale factor (IEEE 647, 952)", "c (T - T_ref) w_i", "ppm/C", xyz, 1e-6,
       "recorded temperature that changes, turns at each end", of_gyros<of_rate<temperature>>},
      {"gyro_bias_drift", gyro, Quantity::bias, Driver::time, "bias drift, rate ramp (IEEE 952)", "c t", "deg/h/h", xyz,
       radps_per_degph, "a longer run, a return to the first position", of_gyros<bias<hours>>},
      {"gyro_warm_up", gyro, Quantity::bias, Driver::time, "warm-up transient of bias (IEEE 647)", "c exp(-t/tau)",
       "deg/h", xyz, radps_per_degph, "a longer run, dense in the first minutes", of_gyros<bias<faded>>,
       warm_up_taus_s},
      {"gyro_magnetic", gyro, Quantity::bias, Driver::field, "magnetic sensitivity (IEEE 647)", "M B_b", "deg/h/G",
       nine, radps_per_degph, "heading changes at each tilt", magnetic},
      {"gyro_accel_flexure", gyro, Quantity::direction, Driver::force,
       "elastic misalignment of the gyro triad against the accelerometers", "(E f) x w", "arcsec/g", nine,
       rad_per_arcsec, "rotations about each axis at each tilt", flexure},
      {"gyro_scale_warm_up", gyro, Quantity::scale_factor, Driver::time, "warm-up transient of scale factor (IEEE 647)",
       "c exp(-t/tau) w_i", "ppm", xyz, 1e-6, "turns about each axis at the beginning and later",
       of_gyros<of_rate<faded>>, scale_warm_up_taus_s},
      {"gyro_scale_drift", gyro, Quantity::scale_factor, Driver::time, "scale factor drift (IEEE 647)", "c t w_i",
       "ppm/h", xyz, 1e-6, "turns about each axis at the beginning and at the end", of_gyros<of_rate<hours>>},
      {"gyro_g_squared", gyro, Quantity::bias, Driver::force, "acceleration-squared-sensitive drift (IEEE 952, 647)",
       "G f_j f_k", "deg/h/g^2", squares, radps_per_degph,
       "dwells with each axis up, down and level; products at 45 deg", g_squared},
      {"gyro_lock_in", gyro, Quantity::scale_factor, Driver::rate, "smooth lock-in of a ring laser (IEEE 647)",
       "c w_i / (1 + (w_i / w_0)^2)", "%", and_all, 1e-2, "dwells with the axis north, south, up, down and east",
       lock_in, lock_in_rates_degph, "w0_degph"},
      {"gyro_bias_temperature_rate", gyro, Quantity::bias, Driver::temperature,
       "bias with the rate of temperature (IEEE 647, 952)", "c dT/dt", "deg/h/(C/h)", xyz, radps_per_degph,
       "temperature that changes at different rates", of_gyros<bias<temperature_rate>>},
      {"gyro_bias_temperature_lag", gyro, Quantity::bias, Driver::temperature,
       "bias with a temperature that lags (IEEE 647, 952)", "c (T lagged by tau - T_ref)", "deg/h/C", xyz,
       radps_per_degph, "temperature that changes, and then stays", of_gyros<bias<lagged_temperature>>, lag_taus_s},
      {"gyro_wave_angle", gyro, Quantity::bias, Driver::angle,
       "drift with the angle of the standing wave of a hemispherical resonator (whole-angle mode)",
       "c cos(4 k a_i), c sin(4 k a_i), a_i turned since the start, k = 0.277", "deg/h", waves, radps_per_degph,
       "turns of 30 to 90 deg about each axis, with a dwell after each", wave_angle},
      {"earth_rate", Sensor::earth_rate, Quantity::bias, Driver::field, "error of the earth rate used (latitude)",
       "C_bn dw_ie", "deg/h", earth_axes, radps_per_degph, "lies inside gyro_magnetic; a known latitude", earth_rate},
      {"sample_period", Sensor::earth_rate, Quantity::bias, Driver::field, "error of the sample period used",
       "1e-6 c C_bn w_ie", "ppm", period, 1e-6, "lies inside earth_rate; a unit whose clock was measured",
       sample_period},
      {"post_rotation_relaxation", accel, Quantity::bias, Driver::turns,
       "relaxation of the accelerometer after a rotation", "c exp(-t/tau) f_i", "ug/g", xyz, micro_g,
       "first seconds of a dwell", of_accels<relaxation>, relaxation_taus_s},
  };
  for (EffectEntry& row : rows) {
    row.of_one_run = row.driver == Driver::time || row.driver == Driver::angle;
    row.needs_temperature = row.driver == Driver::temperature;
    if (row.driver == Driver::angle) row.share = 0.02;  // a kind of sensor that few units on such a table have
  }
  return rows;
}

}  // namespace

const std::vector<EffectEntry>& effect_catalogue() {
  static const std::vector<EffectEntry> catalogue = make_catalogue();
  return catalogue;
}

}  // namespace turncal
