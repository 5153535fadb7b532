#include "orchestrator/commands/command_predict.h"

#include <cmath>
#include <cstdio>
#include <memory>

#include "calib/prediction/predicted_drift.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/station_rig.h"
#include "orchestrator/jobs/sequence_coverage.h"
#include "orchestrator/report/drift_table.h"
#include "orchestrator/report/prediction_table.h"

namespace turncal {

namespace {

std::string shown(double value) { return format_number(value); }

// Not by the command line's own checks: they let "nan" pass.
Status check_range(const char* option, double value, double min, double max, bool min_excluded = false) {
  const bool good = (min_excluded ? value > min : value >= min) && value <= max;  // false for NaN
  if (good) return {};
  return input_error(std::string(option) + " = " + shown(value) + ": expected a number " +
                     (min_excluded ? "above " + shown(min) + " and not above " : "from " + shown(min) + " to ") +
                     shown(max));
}

Status check_request(const PredictRequest& r) {
  for (const Status& status : {
           check_range("--latitude", r.latitude_deg.value_or(0.0), -90.0, 90.0),
           check_range("--gravity", r.gravity_mps2.value_or(standard_gravity_mps2), 9.7, 9.9),
           check_range("--arw", r.arw_deg_per_rt_h, 0.0, 1000.0, true),
           check_range("--vrw", r.vrw_ug_per_rt_hz, 0.0, 1e6, true),
           check_range("--gyro-bias-instability", r.gyro_bias_instability_degph, 0.0, 1e4),
           check_range("--accel-bias-instability", r.accel_bias_instability_ug, 0.0, 1e5),
           check_range("--temperature-rise", r.temperature_rise_c, -100.0, 100.0),
           check_range("--temperature-tau", r.temperature_tau_s, 1.0, 1e6),
       })
    if (!status) return status;
  if (r.temperature_rise_c != 0.0 && !r.effects)
    return input_error(
        "--temperature-rise changes nothing without --effects: the 24 parameters do not depend on temperature");
  return {};
}

// The unit that the station's IMU driver would deliver.
struct PlannedUnit {
  RecordingInfo info;
  Parameters parameters;
};
Result<PlannedUnit> planned_unit(const StationConfig& station, const PredictRequest& request) {
  Result<RigConfig> rig = rig_of(station);
  if (!rig) return rig.error();
  PlannedUnit unit;
  unit.info.sample_period_s = rig->sample_period_s;
  unit.info.latitude_deg = request.latitude_deg.value_or(station.latitude_deg);
  unit.info.gravity_mps2 = request.gravity_mps2.value_or(station.gravity_mps2);
  unit.info.accel_pulse_mps = rig->accel_pulse_mps;
  unit.info.simulated = true;
  unit.parameters = typical_unit(unit.info);
  unit.parameters.n = Eigen::Matrix3d::Identity() * rig->gyro_pulse_arcsec;
  return unit;
}

NoiseModel noise_model(const PredictRequest& request) {
  NoiseModel noise;
  noise.angle_random_walk.setConstant(request.arw_deg_per_rt_h * radprs_per_degprh);
  noise.velocity_random_walk.setConstant(request.vrw_ug_per_rt_hz * mpsprs_per_ugprHz);
  noise.gyro_bias_instability_radps = request.gyro_bias_instability_degph * radps_per_degph;
  noise.accel_bias_instability_mps2 = request.accel_bias_instability_ug * 1e-6 * standard_gravity_mps2;
  return noise;
}

void print_premises(const PredictRequest& request, const RecordingInfo& info, std::ostream& out) {
  out << "Noise     " << shown(request.arw_deg_per_rt_h) << " deg/sqrt(h), " << shown(request.vrw_ug_per_rt_hz)
      << " ug/sqrt(Hz); bias instability " << shown(request.gyro_bias_instability_degph) << " deg/h, "
      << shown(request.accel_bias_instability_ug) << " ug; pulse " << shown(info.accel_pulse_mps) << " m/s\n";
  out << "Site      latitude " << shown(info.latitude_deg) << " deg, gravity " << shown(info.gravity_mps2)
      << " m/s^2; IMU at " << shown(std::round(1e6 / info.sample_period_s) / 1e6) << " Hz\n";
}

// 1h, 90min, 5400s or 5400.
Result<double> navigation_time_s(const std::string& text) {
  constexpr double longest_navigation_s = 86400.0;
  std::string_view number = text;
  double unit = 1.0;
  for (const auto& [name, seconds] : {std::pair{"min", 60.0}, std::pair{"h", 3600.0}, std::pair{"s", 1.0}}) {
    if (!number.ends_with(name)) continue;
    number.remove_suffix(std::string_view(name).size());
    unit = seconds;
    break;
  }
  const std::optional<double> value = parse_number(number);
  if (!value || *value * unit < 1.0 || *value * unit > longest_navigation_s)
    return input_error("--navigate '" + text + "': expected a time from 1s to 24h, like 1h, 90min or 5400s");
  return *value * unit;
}

// Two sequences of one name still need two names.
std::string column_name(const std::vector<NamedPrediction>& columns, const std::string& name) {
  int same = 1;
  for (const NamedPrediction& column : columns)
    if (column.name == name || column.name.starts_with(name + "#")) ++same;
  return same == 1 ? name : name + "#" + std::to_string(same);
}

}  // namespace

Status run_predict(const PredictRequest& request, std::ostream& out) {
  if (Status status = check_request(request); !status) return status;
  DriftPlan drift_plan;
  drift_plan.align_s = request.align_s;
  if (!request.navigate.empty()) {
    const Result<double> time_s = navigation_time_s(request.navigate);
    if (!time_s) return time_s.error();
    drift_plan.free_s = *time_s;
  }
  const Result<StationConfig> station =
      request.station.empty() ? Result<StationConfig>(default_station_config()) : read_station_config(request.station);
  if (!station) return station.error();
  const Result<PlannedUnit> unit = planned_unit(*station, request);
  if (!unit) return unit.error();
  PredictOptions options;
  options.noise = noise_model(request);
  options.unit = unit->parameters;
  options.effects = request.effects;
  if (request.temperature_rise_c != 0.0)
    options.temperature = TemperatureProfile{.rise_c = request.temperature_rise_c, .tau_s = request.temperature_tau_s};

  std::vector<NamedPrediction> columns;
  std::vector<std::string> refused;  // why the station would not run it, beside each column
  for (const std::string& file : request.sequences) {
    const Result<Sequence> sequence = read_sequence(file);
    if (!sequence) return sequence.error();
    const Plan plan = make_plan(*sequence, plan_limits(*station, unit->info.sample_period_s));
    NamedPrediction column{column_name(columns, sequence->name),
                           predict(unit->info, planned_motion(*sequence, plan), options), plan.station_s};
    if (!column.prediction.valid)
      return Error{ErrorKind::internal, file + ": no prediction: " + column.prediction.message};
    columns.push_back(std::move(column));
    refused.push_back(plan.ok() ? "" : plan.violations.front());
  }

  print_premises(request, unit->info, out);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    char line[200];
    std::snprintf(line, sizeof line, "Sequence  %s: %.0f s, of which %.0f s at rest\n", columns[c].name.c_str(),
                  columns[c].station_s, columns[c].prediction.static_s);
    out << line;
    if (!refused[c].empty()) out << "  the station cannot run it: " << refused[c] << "\n";
  }
  out << "\n";
  print_sigmas(columns, unit->info, out);
  out << "\n";
  print_undetermined(columns, out);
  if (!request.navigate.empty()) {
    const double latitude_deg = std::abs(unit->info.latitude_deg);
    if (latitude_deg > max_navigation_latitude_deg)
      return input_error("--navigate: latitude " + shown(unit->info.latitude_deg) + " deg: expected at most " +
                         shown(max_navigation_latitude_deg) + " deg north or south");
    std::vector<std::pair<std::string, ExpectedDrift>> drifts;
    for (const NamedPrediction& column : columns)
      drifts.emplace_back(column.name, predicted_drift(unit->info, column.prediction, options, drift_plan));
    out << "\n";
    print_predicted_drift(drifts, drift_plan, out);
  }
  if (request.effects) {
    out << "\n";
    print_effects(columns, out);
    if (!options.temperature)
      out << "Effects of temperature were not looked at: it does not change (--temperature-rise).\n";
    out << "Never observable:\n";
    for (const std::string_view quantity : unobservable_quantities()) out << "  " << quantity << "\n";
  }
  return {};
}

void add_predict_command(CommandLine& line, CommandContext& context) {
  const auto request = std::make_shared<PredictRequest>();
  const Command command =
      line.command("predict", "the sigma each parameter would have after a sequence; nothing moves");
  command.option("--sequence", request->sequences, "sequence file; several stand side by side").required();
  command.option("--station", request->station, "station configuration; default: the built-in rig station");
  command.option("--latitude", request->latitude_deg, "deg; default: the station's");
  command.option("--gravity", request->gravity_mps2, "m/s^2; default: the station's");
  command.option("--arw", request->arw_deg_per_rt_h, "angle random walk, deg/sqrt(h)").default_in_help();
  command.option("--vrw", request->vrw_ug_per_rt_hz, "velocity random walk, ug/sqrt(Hz)").default_in_help();
  command.option("--gyro-bias-instability", request->gyro_bias_instability_degph, "deg/h").default_in_help();
  command.option("--accel-bias-instability", request->accel_bias_instability_ug, "ug").default_in_help();
  command.flag("--effects", request->effects, "the smallest effects that would be caught, and which are confused");
  command.option("--temperature-rise", request->temperature_rise_c, "C over the run, for --effects").default_in_help();
  command.option("--temperature-tau", request->temperature_tau_s, "its time constant, s").default_in_help();
  command.option("--navigate", request->navigate, "drift of free navigation after this time: 1h, 90min, 5400s");
  command.option("--align", request->align_s, "alignment before it, s").range(20.0, 86400.0).default_in_help();
  command.runs(context, [request, &context] { return run_predict(*request, context.out); });
}

}  // namespace turncal
