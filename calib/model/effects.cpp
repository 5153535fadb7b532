#include "calib/model/effects.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/model/attitude.h"

namespace turncal {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Ref;
using Eigen::Vector3d;

constexpr double g0 = standard_gravity_mps2;
constexpr double micro_g = 1e-6 * g0;
using Out = Ref<Matrix3Xd>;

// Specific force in g, the unit in which accelerometer polynomials are stated.
Vector3d in_g(const BlockState& s) { return s.f_b / g0; }

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

const std::vector<std::string_view> xyz = {"x", "y", "z"};
const std::vector<std::string_view> nine = {"xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"};
const std::vector<std::string_view> products = {"x_xy", "x_xz", "x_yz", "y_xy", "y_xz", "y_yz", "z_xy", "z_xz", "z_yz"};
const std::vector<std::string_view> arms = {"x_rx", "x_ry", "x_rz", "y_rx", "y_ry", "y_rz", "z_rx", "z_ry", "z_rz"};
const std::vector<double> warm_up_taus_s = {60.0, 120.0, 240.0, 480.0, 960.0, 1920.0};
const std::vector<double> scale_warm_up_taus_s = {240.0, 960.0, 1920.0};
const std::vector<double> relaxation_taus_s = {2.0, 5.0, 12.0};
const std::vector<double> creep_taus_s = {60.0, 150.0, 400.0, 1000.0};
const std::vector<double> lag_taus_s = {300.0, 1200.0};
const std::vector<double> lock_in_rates_degph = {2.0, 5.0, 12.0};
constexpr double rate_time_s = 60.0;  // over which a temperature rate is measured
constexpr int most_components = 18;
const std::vector<std::string_view> squares = {"x_xx", "x_yy", "x_zz", "x_xy", "x_xz", "x_yz", "y_xx", "y_yy", "y_zz",
                                               "y_xy", "y_xz", "y_yz", "z_xx", "z_yy", "z_zz", "z_xy", "z_xz", "z_yz"};

// Diagonal effect on a triad: component k acts on axis k with a value of its own.
void diagonal(Out out, const Vector3d& value) {
  for (int k = 0; k < 3; ++k) out(k, k) = value[k];
}
// Full matrix: component 3 i + j puts value_j on axis i.
void full(Out out, const Vector3d& value) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out(i, 3 * i + j) = value[j];
}

double hours(const BlockState& s) { return s.time_s / 3600.0; }

std::vector<EffectEntry> make_catalogue() {
  return {
      {.name = "accel_second_order",
       .term = "second-order nonlinearity K2 (IEEE 1293)",
       .formula = "K2 f_i^2",
       .unit = "ug/g^2",
       .components = xyz,
       .si = micro_g,
       .seen_by = "+1 g, -1 g and 0 g on each axis; dwells at 45 deg separate it from the scale asymmetry",
       .write = [](const BlockState& s, const Site&, double, Out, Out a) { diagonal(a, in_g(s).cwiseAbs2()); }},
      {.name = "accel_scale_asymmetry",
       .term = "scale factor asymmetry (IEEE 1293)",
       .formula = "Ka abs(f_i)",
       .unit = "ppm",
       .components = xyz,
       .si = micro_g,
       .seen_by = "+1 g, -1 g and 0 g on each axis; dwells at 45 deg separate it from K2",
       .write = [](const BlockState& s, const Site&, double, Out, Out a) { diagonal(a, in_g(s).cwiseAbs()); }},
      {.name = "accel_odd_quadratic",
       .term = "odd quadratic coefficient (IEEE 1293)",
       .formula = "Ko f_i abs(f_i)",
       .unit = "ug/g^2",
       .components = xyz,
       .si = micro_g,
       .seen_by = "dwells at 45 deg",
       .write = [](const BlockState& s, const Site&, double, Out,
                   Out a) { diagonal(a, in_g(s).cwiseProduct(in_g(s).cwiseAbs())); }},
      {.name = "accel_third_order",
       .term = "third-order nonlinearity K3 (IEEE 1293)",
       .formula = "K3 f_i^3",
       .unit = "ug/g^3",
       .components = xyz,
       .si = micro_g,
       .seen_by = "dwells at 45 deg",
       .write = [](const BlockState& s, const Site&, double, Out, Out a) { diagonal(a, in_g(s).array().cube()); }},
      {.name = "accel_cross_coupling",
       .term = "cross-coupling Kip, Kio, Kop (IEEE 1293)",
       .formula = "K f_j f_k",
       .unit = "ug/g^2",
       .components = products,
       .si = micro_g,
       .seen_by = "rotations with velocity carried; dwells at 45 deg",
       .write =
           [](const BlockState& s, const Site&, double, Out, Out a) {
             const Vector3d f = in_g(s);
             full(a, Vector3d(f.x() * f.y(), f.x() * f.z(), f.y() * f.z()));
           }},
      {.name = "accel_size_effect",
       .term = "size effect: arm of each accelerometer",
       .formula = "row i of (w' x r_i + w x (w x r_i))",
       .unit = "mm",
       .components = arms,
       .si = 1e-3,
       .seen_by = "rotations with velocity carried; the common part of the three arms is invisible",
       .write =
           [](const BlockState& s, const Site&, double, Out, Out a) {
             const Eigen::Matrix3d m = skew(s.w_dot_b) + skew(s.w_b) * skew(s.w_b);
             for (int i = 0; i < 3; ++i) a.block(i, 3 * i, 1, 3) = m.row(i);
           }},
      {.name = "accel_delay",
       .term = "time delay of the accelerometers after the gyros",
       .formula = "tau (w x f)",
       .unit = "ms",
       .components = {"tau"},
       .si = 1e-3,
       .seen_by = "rotations with velocity carried",
       .write = [](const BlockState& s, const Site&, double, Out, Out a) { a.col(0) = s.w_b.cross(s.f_b); }},
      {.name = "accel_bias_temperature",
       .term = "temperature coefficient of bias (IEEE 1293)",
       .formula = "c (T - T_ref)",
       .unit = "ug/C",
       .components = xyz,
       .si = micro_g,
       .needs_temperature = true,
       .seen_by = "recorded temperature that changes",
       .write = [](const BlockState& s, const Site&, double, Out,
                   Out a) { diagonal(a, Vector3d::Constant(s.temperature_c)); }},
      {.name = "accel_scale_temperature",
       .term = "temperature coefficient of scale factor (IEEE 1293)",
       .formula = "c (T - T_ref) f_i",
       .unit = "ppm/C",
       .components = xyz,
       .si = micro_g,
       .needs_temperature = true,
       .seen_by = "recorded temperature that changes, +1 g and -1 g at each end",
       .write = [](const BlockState& s, const Site&, double, Out, Out a) { diagonal(a, in_g(s) * s.temperature_c); }},
      {.name = "accel_bias_drift",
       .term = "bias drift (IEEE 1293)",
       .formula = "c t",
       .unit = "ug/h",
       .components = xyz,
       .si = micro_g,
       .of_one_run = true,
       .seen_by = "a return to an earlier position",
       .write = [](const BlockState& s, const Site&, double, Out,
                   Out a) { diagonal(a, Vector3d::Constant(hours(s))); }},
      {.name = "accel_warm_up",
       .term = "warm-up transient of bias (IEEE 1293)",
       .formula = "c exp(-t/tau)",
       .unit = "ug",
       .components = xyz,
       .si = micro_g,
       .taus_s = warm_up_taus_s,
       .of_one_run = true,
       .seen_by = "a return to an earlier position, dense in the first minutes",
       .write = [](const BlockState& s, const Site&, double tau, Out,
                   Out a) { diagonal(a, Vector3d::Constant(std::exp(-s.time_s / tau))); }},
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
      {.name = "earth_rate",
       .term = "error of the earth rate used (latitude)",
       .formula = "C_bn dw_ie",
       .unit = "deg/h",
       .components = {"north", "up"},
       .si = radps_per_degph,
       .seen_by = "lies inside gyro_magnetic; a known latitude",
       .write = [](const BlockState& s, const Site&, double, Out g, Out) { g = s.C_nb.transpose().leftCols<2>(); }},
      {.name = "sample_period",
       .term = "error of the sample period used",
       .formula = "1e-6 c C_bn w_ie",
       .unit = "ppm",
       .components = {"period"},
       .si = 1e-6,
       .seen_by = "lies inside earth_rate; a unit whose clock was measured",
       .write = [](const BlockState& s, const Site& site, double, Out g,
                   Out) { g.col(0) = s.C_nb.transpose() * earth_rate_n(site.latitude_deg); }},
      {.name = "post_rotation_relaxation",
       .term = "relaxation of the accelerometer after a rotation",
       .formula = "c exp(-t/tau) f_i",
       .unit = "ug/g",
       .components = xyz,
       .si = micro_g,
       .taus_s = relaxation_taus_s,
       .seen_by = "first seconds of a dwell",
       .write =
           [](const BlockState& s, const Site&, double tau, Out, Out a) {
             if (s.since_rotation_s < 1e6) diagonal(a, in_g(s) * std::exp(-s.since_rotation_s / tau));
           }},
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
      {.name = "accel_scale_warm_up",
       .term = "warm-up transient of scale factor (IEEE 1293)",
       .formula = "c exp(-t/tau) f_i",
       .unit = "ppm",
       .components = xyz,
       .si = micro_g,
       .taus_s = scale_warm_up_taus_s,
       .of_one_run = true,
       .seen_by = "+1 g and -1 g at the beginning and later",
       .write = [](const BlockState& s, const Site&, double tau, Out,
                   Out a) { diagonal(a, in_g(s) * std::exp(-s.time_s / tau)); }},
      {.name = "accel_scale_drift",
       .term = "scale factor drift (IEEE 1293)",
       .formula = "c t f_i",
       .unit = "ppm/h",
       .components = xyz,
       .si = micro_g,
       .of_one_run = true,
       .seen_by = "+1 g and -1 g at the beginning and at the end",
       .write = [](const BlockState& s, const Site&, double, Out, Out a) { diagonal(a, in_g(s) * hours(s)); }},
      {.name = "accel_creep",
       .term = "creep after a change of specific force",
       .formula = "c (f_i - f_i lagged by tau)",
       .unit = "ug/g",
       .components = xyz,
       .si = micro_g,
       .taus_s = creep_taus_s,
       .seen_by = "long dwells after a change of the axis from up to down",
       .write = [](const BlockState& s, const Site&, double, Out, Out a) { diagonal(a, (s.f_b - s.lagged_f_b) / g0); }},
      {.name = "accel_rectification",
       .term = "bias while the unit turns (vibration rectification, IEEE 1293)",
       .formula = "c while abs(w) > 0.5 deg/s",
       .unit = "ug",
       .components = xyz,
       .si = micro_g,
       .seen_by = "rotations with velocity carried, of different lengths",
       .write =
           [](const BlockState& s, const Site&, double, Out, Out a) {
             if (s.w_b.norm() > 0.5 * rad_per_deg) diagonal(a, Vector3d::Ones());
           }},
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
      {.name = "accel_bias_temperature_rate",
       .term = "bias with the rate of temperature (IEEE 1293)",
       .formula = "c dT/dt",
       .unit = "ug/(C/h)",
       .components = xyz,
       .si = micro_g,
       .needs_temperature = true,
       .seen_by = "temperature that changes at different rates",
       .write = [](const BlockState& s, const Site&, double, Out,
                   Out a) { diagonal(a, Vector3d::Constant(s.temperature_rate_c_per_h)); }},
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
      {.name = "accel_bias_temperature_lag",
       .term = "bias with a temperature that lags (IEEE 1293)",
       .formula = "c (T lagged by tau - T_ref)",
       .unit = "ug/C",
       .components = xyz,
       .si = micro_g,
       .taus_s = lag_taus_s,
       .needs_temperature = true,
       .seen_by = "temperature that changes, and then stays",
       .write = [](const BlockState& s, const Site&, double, Out,
                   Out a) { diagonal(a, Vector3d::Constant(s.lagged_temperature_c)); }},
  };
}

// What the effects with a memory look back on: each is called block after block, from the first on.
class History {
 public:
  // Follows f and T with the time constant tau (0: none), and T with rate_time_s.
  void follow(BlockState& s, double tau) {
    if (s.time_s <= time_s_) {  // another pass
      lagged_f_ = s.f_b;
      lagged_c_ = minute_c_ = s.temperature_c;
    } else {
      const double step_s = s.time_s - time_s_;
      if (tau > 0.0) {
        const double part = -std::expm1(-step_s / tau);
        lagged_f_ += part * (s.f_b - lagged_f_);
        lagged_c_ += part * (s.temperature_c - lagged_c_);
      }
      minute_c_ -= std::expm1(-step_s / rate_time_s) * (s.temperature_c - minute_c_);
    }
    time_s_ = s.time_s;
    s.lagged_f_b = lagged_f_;
    s.lagged_temperature_c = lagged_c_;
    s.temperature_rate_c_per_h = (s.temperature_c - minute_c_) / rate_time_s * 3600.0;
  }

 private:
  double time_s_ = 1e300;
  Vector3d lagged_f_ = Vector3d::Zero();
  double lagged_c_ = 0.0, minute_c_ = 0.0;
};

}  // namespace

const std::vector<EffectEntry>& effect_catalogue() {
  static const std::vector<EffectEntry> catalogue = make_catalogue();
  return catalogue;
}

const EffectEntry* find_effect(std::string_view name) {
  for (const EffectEntry& entry : effect_catalogue())
    if (entry.name == name) return &entry;
  return nullptr;
}

double absurd_magnitude(const EffectEntry& entry, double duration_s) {
  if (entry.unit == "mm") return 1000.0;
  if (entry.unit == "ms") return 100.0;
  const double largest = entry.unit.starts_with("deg") || entry.unit.starts_with("arcsec") ? 1e4 : 1e5;
  return entry.name.ends_with("_drift") && duration_s > 0.0 ? largest * std::max(1.0, 3600.0 / duration_s) : largest;
}

std::span<const std::string_view> unobservable_quantities() {
  static constexpr std::array<std::string_view, 4> names = {
      "error of the local gravity entered for the site (it is the common accelerometer scale factor), and of the "
      "sample period as far "
      "as the earth's rate does not show it",
      "arm from the table's centre to the unit's centre", "sag of the whole fixture",
      "error of the table's angles (they are not used as truth beyond the first heading)"};
  return names;
}

std::string EffectColumn::key() const {
  return std::string(entry->name) + "." + std::string(entry->components[static_cast<std::size_t>(component)]);
}

std::vector<EffectColumn> catalogue_columns(const RecordingInfo& info) {
  std::vector<EffectColumn> columns;
  for (const EffectEntry& entry : effect_catalogue()) {
    if (entry.needs_temperature && !info.has_temperature) continue;
    const std::vector<double> taus = entry.taus_s.empty() ? std::vector<double>{0.0} : entry.taus_s;
    for (const double tau : taus)
      for (int k = 0; k < static_cast<int>(entry.components.size()); ++k) columns.push_back({&entry, k, tau});
  }
  return columns;
}

EffectModel make_effect_model(const std::vector<EffectColumn>& columns, const Site& site,
                              double reference_temperature_c) {
  // Consecutive columns of one entry and one tau are written together; a column picks its component from that.
  struct Part {
    const EffectEntry* entry;
    double tau_s;
    std::vector<std::pair<int, int>> pick = {};  // component, column
    History history = {};
  };
  std::vector<Part> parts;
  for (int k = 0; k < static_cast<int>(columns.size()); ++k) {
    const EffectColumn& column = columns[static_cast<std::size_t>(k)];
    if (parts.empty() || parts.back().entry != column.entry || parts.back().tau_s != column.tau_s)
      parts.push_back({.entry = column.entry, .tau_s = column.tau_s});
    parts.back().pick.emplace_back(column.component, k);
  }
  EffectModel model;
  model.columns = static_cast<int>(columns.size());
  model.values = Eigen::VectorXd::Zero(model.columns);
  model.reference_temperature_c = reference_temperature_c;
  Eigen::Matrix3Xd gyro = Eigen::Matrix3Xd::Zero(3, most_components);
  Eigen::Matrix3Xd accel = Eigen::Matrix3Xd::Zero(3, most_components);
  model.regressors = [parts, site, gyro, accel](const BlockState& at, EffectRegressors& out) mutable {
    BlockState s = at;
    for (Part& part : parts) {
      part.history.follow(s, part.tau_s);
      const int count = static_cast<int>(part.entry->components.size());
      gyro.leftCols(count).setZero();
      accel.leftCols(count).setZero();
      part.entry->write(s, site, part.tau_s, gyro.leftCols(count), accel.leftCols(count));
      for (const auto& [component, column] : part.pick) {
        out.gyro.col(column) = gyro.col(component) * part.entry->si;
        out.accel.col(column) = accel.col(component) * part.entry->si;
      }
    }
  };
  return model;
}

}  // namespace turncal
