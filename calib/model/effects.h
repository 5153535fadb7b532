// The catalogue of effects beyond the 24 parameters, one entry per effect (effect_catalogue.cpp).
//
// An entry says what one unit of each component adds to the calibrated reading, in the units of docs/diagnosis.md.
// Names follow IEEE 1293 (accelerometer model), 647 (ring laser gyros) and 952. Effects with an unknown time constant
// appear once per value of tau in a list ("variants": the evidence decides between them, and they count as one effect).
// A component with value p adds p * rate_b (rad/s) to the gyros and p * force_b (m/s^2) to the accelerometers; the
// model removes it: corrected = calibrated - p * regressor.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "calib/model/attitude.h"
#include "calib/types/recording_types.h"

namespace turncal {

// The input of a regressor: the motion over one block for the present parameters, SI units.
struct BlockState {
  Eigen::Vector3d f_b;      // specific force in the middle of the block, m/s^2
  Eigen::Vector3d w_b;      // rate, rad/s
  Eigen::Vector3d w_dot_b;  // angular acceleration, rad/s^2
  Eigen::Matrix3d C_nb;     // attitude in the middle of the block
  double duration_s = 0.0;
  int recording = 0;                                    // index among several recordings of a unit, from 0
  double time_s = 0.0;                                  // middle of the block, from that recording's first sample
  double since_rotation_s = 0.0;                        // from the end of the last rotation; large before the first
  double temperature_c = 0.0;                           // minus the reference; 0 when not measured
  double temperature_rate_c_per_h = 0.0;                // dT/dt; 0 when not measured
  Eigen::Vector3d table_rad = Eigen::Vector3d::Zero();  // commanded heading, pitch, roll at the end of its segment
  // Filled by make_effect_model() from the earlier blocks: f_b and temperature lagged by the effect's time constant,
  // both settled at the first sample, and the integral of w_b since then.
  Eigen::Vector3d turned_rad = Eigen::Vector3d::Zero();
  Eigen::Vector3d lagged_f_b = Eigen::Vector3d::Zero();
  double lagged_temperature_c = 0.0;
};

// The regressors of all components: column k of gyro (rad/s) and accel (m/s^2) is one unit of component k.
struct EffectRegressors {
  explicit EffectRegressors(int columns = 0) : gyro(3, columns), accel(3, columns) {
    gyro.setZero();
    accel.setZero();
  }
  Eigen::Matrix<double, 3, Eigen::Dynamic> gyro, accel;
};

struct EffectModel {
  int columns = 0;                                                       // number of components
  std::function<void(const BlockState&, EffectRegressors&)> regressors;  // fills all columns
  Eigen::VectorXd values;  // value of each component in the present model (zero: tested, not used)
  double reference_temperature_c = 0.0;
};

struct Site {  // what regressors need to know of the site
  double latitude_deg = 0.0;
};

// What an effect acts on, and what drives it. Equivalent descriptions are written one way: an accelerometer error that
// depends on force is a bias, a gyro error that depends on rate is a scale factor.
enum class Sensor { gyro, accelerometer, earth_rate };
enum class Quantity { bias, scale_factor, direction };
enum class Driver { time, temperature, turns, angle, force, rate, field, unknown };
std::string_view to_string(Sensor sensor);
std::string_view to_string(Quantity quantity);
std::string_view to_string(Driver driver);

struct EffectEntry {
  std::string_view name;
  Sensor sensor;
  Quantity quantity;
  Driver driver;
  std::string_view term;  // in the sense of the standards
  std::string_view formula;
  std::string_view unit;
  std::vector<std::string_view> components;
  double si = 1.0;           // one unit in rad/s (gyro) or m/s^2 (accelerometer) terms of `write`
  std::string_view seen_by;  // the positions or rates that would show it
  // Adds one unit of component k to column k of gyro and accel (3 x components, zero before), times si.
  void (*write)(const BlockState& s, const Site& site, double tau_s, Eigen::Ref<Eigen::Matrix3Xd> gyro,
                Eigen::Ref<Eigen::Matrix3Xd> accel);
  std::vector<double> taus_s = {};     // variants; empty: none
  std::string_view variant = "tau_s";  // what a variant is called in files, with its unit
  bool of_one_run = false;             // depends on the time since this run began: another run has its own
  bool needs_temperature = false;
  double share = 1.0;  // how often units have it, relative to the other entries
};

const std::vector<EffectEntry>& effect_catalogue();
const EffectEntry* find_effect(std::string_view name);
// Returns a magnitude of one component (in its unit) that no sensor has: an effect detectable only above it counts as
// not visible. A drift is judged by what it adds up to over `duration_s`, if that is less than an hour.
double absurd_magnitude(const EffectEntry& entry, double duration_s = 3600.0);
// Quantities no recording of this kind can show, whatever the sequence.
std::span<const std::string_view> unobservable_quantities();

// One column of an EffectModel: a component of an effect (of a variant of it).
struct EffectColumn {
  const EffectEntry* entry = nullptr;
  int component = 0;
  double tau_s = 0.0;       // 0: the effect has none
  int recording = -1;       // the only one of several in which it acts; -1: in all
  std::string key() const;  // "accel_second_order.x"; of a recording after the first "accel_bias_drift.x_recording_2"
};

// Returns the whole catalogue as columns, with every variant. Effects that need a temperature are left out if the
// recording has none; those of one run are there once for each of `recordings`.
std::vector<EffectColumn> catalogue_columns(const RecordingInfo& info, int recordings = 1);
EffectModel make_effect_model(const std::vector<EffectColumn>& columns, const Site& site,
                              double reference_temperature_c);

}  // namespace turncal
