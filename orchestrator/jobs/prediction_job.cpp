#include "orchestrator/jobs/prediction_job.h"

#include <fmt/format.h>

#include <cmath>
#include <string_view>
#include <utility>

#include "calib/navigation/alignment.h"
#include "calib/prediction/predict.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/jobs/run_request.h"

namespace turncal {

namespace {

// Returns the error "--arw = 0: expected ..."; also for NaN, which the command line lets pass.
Status check_option(const char* option, double value, double min, double max, bool min_excluded = false) {
  const bool good = (min_excluded ? value > min : value >= min) && value <= max;
  if (good) return {};
  return input_error(fmt::runtime(min_excluded ? "{} = {}: expected a number above {} and not above {}"
                                               : "{} = {}: expected a number from {} to {}"),
                     option, format_number(value), format_number(min), format_number(max));
}

Status check_request(const PredictRequest& r) {
  TRY(check_site(r.site));
  TRY(check_option("--temperature-rise", r.temperature_rise_c, -100.0, 100.0));
  TRY(check_option("--temperature-tau", r.temperature_tau_s, 1.0, 1e6));
  if (r.temperature_rise_c != 0.0 && !r.effects)
    return input_error(
        "--temperature-rise changes nothing without --effects: the 24 parameters do not depend on temperature");
  return {};
}

// Makes names unique: two sequences of one name get two names.
std::string column_name(const std::vector<NamedPrediction>& columns, const std::string& name) {
  int same = 1;
  for (const NamedPrediction& column : columns)
    if (column.name == name || column.name.starts_with(name + "#")) ++same;
  return same == 1 ? name : name + "#" + std::to_string(same);
}

}  // namespace

Status check_site(const PlannedSite& site) {
  TRY(check_option("--latitude", site.latitude_deg.value_or(0.0), site_latitude_deg.min, site_latitude_deg.max));
  TRY(check_option("--gravity", site.gravity_mps2.value_or(standard_gravity_mps2), site_gravity_mps2.min,
                   site_gravity_mps2.max));
  TRY(check_option("--arw", site.arw_deg_per_rt_h, 0.0, 1000.0, true));
  TRY(check_option("--vrw", site.vrw_ug_per_rt_hz, 0.0, 1e6, true));
  TRY(check_option("--gyro-bias-instability", site.gyro_bias_instability_degph, 0.0, 1e4));
  return check_option("--accel-bias-instability", site.accel_bias_instability_ug, 0.0, 1e5);
}

Result<PlannedUnit> planned_unit(const PlannedSite& site) {
  const StationConfig station = TRY(read_station_config(site.station));
  RigConfig rig = TRY(rig_of(station));
  PlannedUnit unit{.station = station, .info = planned_info(station, &rig)};
  if (site.latitude_deg) unit.info.latitude_deg = *site.latitude_deg;
  if (site.gravity_mps2) unit.info.gravity_mps2 = *site.gravity_mps2;
  unit.info.simulated = true;
  unit.parameters = typical_unit(unit.info);
  unit.parameters.n = Eigen::Matrix3d::Identity() * rig.gyro_pulse_arcsec;
  return unit;
}

NoiseModel noise_model(const PlannedSite& site) {
  NoiseModel noise;
  noise.angle_random_walk.setConstant(site.arw_deg_per_rt_h * radprs_per_degprh);
  noise.velocity_random_walk.setConstant(site.vrw_ug_per_rt_hz * mpsprs_per_ugprHz);
  noise.gyro_bias_instability_radps = site.gyro_bias_instability_degph * radps_per_degph;
  noise.accel_bias_instability_mps2 = site.accel_bias_instability_ug * 1e-6 * standard_gravity_mps2;
  return noise;
}

Facts describe_premises(const PlannedSite& site, const RecordingInfo& info) {
  return {{{"noise", fmt::format("{} deg/sqrt(h), {} ug/sqrt(Hz); bias instability {} deg/h, {} ug; pulse {} m/s",
                                 format_number(site.arw_deg_per_rt_h), format_number(site.vrw_ug_per_rt_hz),
                                 format_number(site.gyro_bias_instability_degph),
                                 format_number(site.accel_bias_instability_ug), format_number(info.accel_pulse_mps))},
           {"site", fmt::format("latitude {} deg, gravity {} m/s^2; IMU at {} Hz", format_number(info.latitude_deg),
                                format_number(info.gravity_mps2),
                                format_number(std::round(1e6 / info.sample_period_s) / 1e6))}}};
}

Result<Predictions> predict_sequences(const PredictRequest& request) {
  TRY(check_request(request));
  DriftPlan drift_plan;
  drift_plan.align_s = request.align_s;
  if (request.navigate_s > 0.0) drift_plan.free_s = request.navigate_s;
  const PlannedUnit unit = TRY(planned_unit(request.site));
  PredictOptions options;
  options.noise = noise_model(request.site);
  options.unit = unit.parameters;
  options.effects = request.effects;
  if (request.temperature_rise_c != 0.0)
    options.temperature = TemperatureProfile{.rise_c = request.temperature_rise_c, .tau_s = request.temperature_tau_s};

  std::vector<NamedPrediction> columns;
  std::vector<std::string> refused;  // why the station would refuse it, one a column
  for (const std::string& file : request.sequences) {
    const Sequence sequence = TRY(read_sequence(file));
    const Plan plan = make_plan(sequence, plan_limits(unit.station, unit.info.sample_period_s));
    NamedPrediction column{column_name(columns, sequence.name),
                           predict(unit.info, planned_motion(sequence, plan), options), plan.station_s};
    if (!column.prediction.valid)
      return Error{ErrorKind::internal, file + ": no prediction: " + column.prediction.message};
    columns.push_back(std::move(column));
    refused.push_back(plan.ok() ? "" : plan.violations.front());
  }

  Document document{"", "Prediction"};
  Facts premises = describe_premises(request.site, unit.info);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    premises.rows.emplace_back("sequence", fmt::format("{}: {:.0f} s, of which {:.0f} s at rest", columns[c].name,
                                                       columns[c].station_s, columns[c].prediction.static_s));
    if (!refused[c].empty()) premises.rows.emplace_back("", "the station cannot run it: " + refused[c]);
  }
  document.add(std::move(premises));
  document.section("sigmas", "Sigma of each parameter");
  document.add(sigma_table(columns, unit.info));
  add_undetermined(columns, document);
  if (request.navigate_s > 0.0) {
    if (Status status = check_navigation_latitude(unit.info.latitude_deg); !status)
      return input_error("--navigate: " + status.error().message);
    std::vector<std::pair<std::string, ExpectedDrift>> drifts;
    for (const NamedPrediction& column : columns)
      drifts.emplace_back(column.name, predicted_drift(unit.info, column.prediction, options, drift_plan));
    add_predicted_drift(drifts, drift_plan, document);
  }
  if (request.effects) {
    add_detectable(columns, document);
    if (!options.temperature)
      document.text("Effects of temperature were not looked at: it does not change (--temperature-rise).");
    document.section("never", "Never observable");
    for (const std::string_view quantity : unobservable_quantities()) document.text(std::string(quantity));
  }
  return Predictions{unit.info, std::move(columns), std::move(refused), std::move(document)};
}

}  // namespace turncal
