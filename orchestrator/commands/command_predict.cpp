#include "orchestrator/commands/command_predict.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "calib/navigation/alignment.h"
#include "calib/prediction/predicted_drift.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/sequence_coverage.h"
#include "orchestrator/report/result_table.h"

namespace turncal {

namespace {

Status check_request(const PredictRequest& r) {
  for (const Status& status : {
           check_site(r.site),
           check_option("--temperature-rise", r.temperature_rise_c, -100.0, 100.0),
           check_option("--temperature-tau", r.temperature_tau_s, 1.0, 1e6),
       })
    if (!status) return status;
  if (r.temperature_rise_c != 0.0 && !r.effects)
    return input_error(
        "--temperature-rise changes nothing without --effects: the 24 parameters do not depend on temperature");
  return {};
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
  TRY(check_request(request));
  DriftPlan drift_plan;
  drift_plan.align_s = request.align_s;
  if (!request.navigate.empty()) {
    const double time_s = TRY(parse_time_s("--navigate", request.navigate));
    drift_plan.free_s = time_s;
  }
  const PlannedUnit unit = TRY(planned_unit(request.site));
  PredictOptions options;
  options.noise = noise_model(request.site);
  options.unit = unit.parameters;
  options.effects = request.effects;
  if (request.temperature_rise_c != 0.0)
    options.temperature = TemperatureProfile{.rise_c = request.temperature_rise_c, .tau_s = request.temperature_tau_s};

  std::vector<NamedPrediction> columns;
  std::vector<std::string> refused;  // why the station would not run it, beside each column
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
  if (!request.navigate.empty()) {
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
  out << (request.format.empty() ? as_text(document) : as_json(document));
  return {};
}

void add_site_options(const Command& command, PlannedSite& site) {
  command.option("--station", site.station, "station configuration; default: the built-in rig station");
  command.option("--latitude", site.latitude_deg, "deg; default: the station's");
  command.option("--gravity", site.gravity_mps2, "m/s^2; default: the station's");
  command.option("--arw", site.arw_deg_per_rt_h, "angle random walk, deg/sqrt(h)").default_in_help();
  command.option("--vrw", site.vrw_ug_per_rt_hz, "velocity random walk, ug/sqrt(Hz)").default_in_help();
  command.option("--gyro-bias-instability", site.gyro_bias_instability_degph, "deg/h").default_in_help();
  command.option("--accel-bias-instability", site.accel_bias_instability_ug, "ug").default_in_help();
}

void add_predict_command(CommandLine& line, CommandContext& context) {
  const auto request = std::make_shared<PredictRequest>();
  const Command command =
      line.command("predict", "the sigma each parameter would have after a sequence; nothing moves");
  command.option("--sequence", request->sequences, "sequence file; several stand side by side").required();
  add_site_options(command, request->site);
  command.flag("--effects", request->effects, "the smallest effects that would be caught, and which are confused");
  command.option("--temperature-rise", request->temperature_rise_c, "C over the run, for --effects").default_in_help();
  command.option("--temperature-tau", request->temperature_tau_s, "its time constant, s").default_in_help();
  command.option("--navigate", request->navigate, "drift of free navigation after this time: 1h, 90min, 5400s");
  command.option("--align", request->align_s, "alignment before it, s").range(20.0, 86400.0).default_in_help();
  command.option("--format", request->format, "print it in this form instead of words").one_of({"json"});
  command.prints(context, [request, &context] { return run_predict(*request, context.out); });
}

}  // namespace turncal
