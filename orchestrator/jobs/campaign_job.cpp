#include "orchestrator/jobs/campaign_job.h"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "calib/prediction/predict.h"
#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/station/hooks.h"

namespace turncal {
namespace {

constexpr const char* leg_name = "leg.conf";

// Each leg of a dry run has noise and a time of its own: the rig's file has no such keys, and they are added.
Result<std::string> text_of_rig(const Campaign& campaign, const RunPlan& plan) {
  const std::string from = campaign.rig.empty() ? plan.station.rig_file : campaign.rig;
  if (from.empty()) return std::string();
  const std::string text = TRY(read_whole_file(from));
  const KeyValueFile file = TRY(KeyValueFile::parse(text, from));
  for (const char* const key : {"noise.seed", "start_utc_s"})
    if (file.has(key)) return file.error_at(key, "no such key: each leg of a campaign has its own");
  return text;
}

Result<std::string> write_rig(const std::string& text, const RunPlan& plan, std::size_t leg,
                              const std::string& folder) {
  const double later_s = 6.0 * 3600.0 * static_cast<double>(leg);
  const std::string path = folder + "/leg.rig";
  TRY(write_file_atomically(path, fmt::format("{}\nnoise.seed = {}\nstart_utc_s = {}\n", text, 1000003 * (leg + 1),
                                              format_number(plan.rig.start_utc_s + later_s))));
  return path;
}

RunRequest request_of(const Campaign& campaign, const CampaignLeg& leg, const RunRequest& asked) {
  RunRequest request = asked;
  request.units = {campaign.unit};
  request.station = campaign.site.station;
  request.rig = campaign.rig;
  request.sequence = leg.sequence;
  request.temperature_c = leg.temperature_c;
  return request;
}

// Its folder, with what `thermal` and a dry run need of it; the unit is switched before the folder says so.
Status prepare_leg(const Campaign& campaign, const RunPlan& plan, std::size_t number, const std::string& folder) {
  const CampaignLeg& leg = campaign.legs[number];
  if (path_exists(folder + "/" + leg_name)) return {};
  TRY(make_folder(folder));
  const std::string conf = fmt::format("switch_on = {}\n", leg.switch_on_number);
  const bool by_hand = leg.switch_on && !plan.request.dry_run && plan.station.hooks.switch_on.empty();
  if (leg.switch_on && !plan.request.dry_run)
    TRY(run_hook(plan.station.hooks, {.event = "switch_on", .unit = campaign.unit, .folder = folder, .message = ""}));
  TRY(write_file_atomically(folder + "/" + leg_name, conf));
  if (!by_hand) return {};
  return Error{ErrorKind::interrupted,
               fmt::format("leg {}: switch unit {} off and on, then give the same command again (or set hook.switch_on "
                           "in the station file)",
                           number + 1, campaign.unit)};
}

// Everything that would stop a later leg is said before the first.
Result<std::vector<RunPlan>> plan_legs(const Campaign& campaign, const RunRequest& asked) {
  std::vector<RunPlan> plans;
  for (const CampaignLeg& leg : campaign.legs) plans.push_back(TRY(plan_run(request_of(campaign, leg, asked))));
  return plans;
}

// From the leg before; what the first one begins with is not known.
double chamber_s(const Campaign& campaign, const std::vector<RunPlan>& plans, std::size_t leg) {
  const ChamberConfig& chamber = *plans[leg].station.chamber;
  const double way_c = campaign.legs[leg].temperature_c - campaign.legs[leg > 0 ? leg - 1 : 0].temperature_c;
  return 60.0 * std::abs(way_c) / chamber.described.limits.ramp_c_per_min + chamber.settle_s;
}

// A leg that says no more than what its sequence is expected to determine.
ThermalLeg expected_leg(double temperature_c, const Prediction& prediction) {
  ThermalLeg leg;
  leg.temperature_c = temperature_c;
  std::vector<Eigen::Index> rows;
  for (std::size_t i = 0; i < prediction.free.size(); ++i) {
    if (!prediction.determined[static_cast<std::size_t>(prediction.free[i])]) continue;
    leg.free.push_back(prediction.free[i]);
    rows.push_back(static_cast<Eigen::Index>(i));
  }
  leg.covariance = prediction.covariance(rows, rows);
  return leg;
}

}  // namespace

Result<Campaign> read_campaign(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  const auto beside = [&](const std::string& name) { return name.empty() ? name : file.beside(name); };
  Campaign campaign;
  file.integer("format", 1, 1);
  campaign.unit = file.text("unit");
  campaign.site.station = beside(file.text("station"));
  campaign.rig = beside(file.text_or("rig", ""));
  campaign.site.arw_deg_per_rt_h = file.number_or("noise.arw_deg_per_rt_h", campaign.site.arw_deg_per_rt_h, positive);
  campaign.site.vrw_ug_per_rt_hz = file.number_or("noise.vrw_ug_per_rt_hz", campaign.site.vrw_ug_per_rt_hz, positive);
  const std::string sequence = file.text_or("sequence", "");
  double low = INFINITY, high = -INFINITY;
  int switched = 1;
  for (const double c : file.numbers("temperatures_c")) {
    const std::string key = fmt::format("leg.{}.", campaign.legs.size() + 1);
    CampaignLeg leg{c, beside(file.text_or(key + "sequence", sequence)), file.boolean_or(key + "switch_on", false)};
    leg.switch_on_number = switched += leg.switch_on ? 1 : 0;
    campaign.legs.push_back(leg);
    low = std::min(low, c), high = std::max(high, c);
  }
  if (file.has("temperatures_c") && !(high - low > thermal_priors.same_temperature_c))
    file.reject("temperatures_c", "the temperatures of two legs or more, in C, not all the same");
  TRY(file.check_all_used());
  return campaign;
}

Result<ThermalOutput> run_campaign(const Campaign& campaign, const RunRequest& asked, const std::string& out,
                                   CommandContext& context) {
  const std::vector<RunPlan> plans = TRY(plan_legs(campaign, asked));
  for (const RunPlan& plan : plans) TRY(check_sequence(plan));
  const std::string rig = asked.dry_run ? TRY(text_of_rig(campaign, plans.front())) : "";
  TRY(make_folder(out));
  const LockFile held = TRY(hold_folder(out));

  ThermalRequest together;
  for (std::size_t k = 0; k < campaign.legs.size(); ++k) {
    const std::string folder = fmt::format("{}/leg-{:02}", out, k + 1), journal = folder + "/" + journal_name;
    together.legs.push_back(folder);
    const bool begun = path_exists(journal);
    if (begun && is_over(TRY(read_journal(journal))) && path_exists(folder + "/" + parameters_name)) continue;
    RunRequest request;
    if (!begun) {
      TRY(prepare_leg(campaign, plans[k], k, folder));
      request = request_of(campaign, campaign.legs[k], asked);
      if (asked.dry_run) request.rig = TRY(write_rig(rig, plans[k], k, folder));
    }
    request.session = asked.session;
    request.session.brief = !asked.session.verbose;
    double left_s = 0.0;
    for (std::size_t j = k; j < plans.size(); ++j) left_s += chamber_s(campaign, plans, j) + plans[j].plan.station_s;
    context.out << fmt::format("{}[campaign] leg {} of {}, {} C, in {}; about {:.1f} h left\n", tag_of(plans[k]), k + 1,
                               plans.size(), format_number(campaign.legs[k].temperature_c), folder, left_s / 3600.0)
                << std::flush;
    const RunEnd end = begun ? resume_run(folder, request, context) : begin_run(request, folder, context);
    if (!end.to_the_end)
      return Error{end.status.error().kind, fmt::format("leg {}: {}", k + 1, end.status.error().message)};
    if (!path_exists(folder + "/" + parameters_name))
      return Error{ErrorKind::unit_failed, fmt::format("leg {}: no parameters came of it: {}", k + 1,
                                                       end.status ? "" : end.status.error().message)};
    if (StopSignals::any())
      return Error{ErrorKind::interrupted, fmt::format("paused after leg {}; the same command goes on", k + 1)};
  }
  together.time_utc = format_utc(wall_utc_s());
  return thermal_calibration(together);
}

Result<Document> plan_campaign(const Campaign& campaign) {
  const PlannedUnit unit = TRY(planned_unit(campaign.site));
  if (!unit.station.chamber)
    return input_error(campaign.site.station + ": has no chamber: expected chamber.file (docs/chamber.md)");
  PredictOptions options;
  options.noise = noise_model(campaign.site);
  options.unit = unit.parameters;
  Document document{"", "Campaign"};
  Facts premises = describe_premises(campaign.site, unit.info);
  premises.add("unit", campaign.unit);
  document.add(std::move(premises));
  document.section("legs", "Legs");
  Table table{{cell::number("leg"), cell::number("C"), cell::name("sequence"), cell::text("switch-on"),
               cell::number("chamber, min"), cell::number("run, min"), cell::number("ends after, h")}};
  std::map<std::string, Prediction> known;  // by sequence
  std::vector<ThermalLeg> legs;
  RunRequest request;
  request.dry_run = true;
  const std::vector<RunPlan> plans = TRY(plan_legs(campaign, request));
  double end_s = 0.0;
  for (std::size_t k = 0; k < plans.size(); ++k) {
    const CampaignLeg& leg = campaign.legs[k];
    const RunPlan& plan = plans[k];
    const auto [prediction, is_new] = known.try_emplace(leg.sequence);
    if (is_new) prediction->second = predict(unit.info, planned_motion(plan.sequence, plan.plan), options);
    if (!prediction->second.valid)
      return input_error(plan.sequence.name + ": no prediction: " + prediction->second.message);
    legs.push_back(expected_leg(leg.temperature_c, prediction->second));
    const double warming_s = chamber_s(campaign, plans, k), run_s = plan.plan.station_s;
    end_s += warming_s + run_s;
    table.row({cell::count(k + 1), cell::number(format_number(leg.temperature_c)), cell::name(plan.sequence.name),
               cell::text(leg.switch_on ? "yes" : ""), cell::fixed(warming_s / 60.0, 0), cell::fixed(run_s / 60.0, 0),
               cell::fixed(end_s / 3600.0, 1)});
  }
  document.add(std::move(table));
  const ThermalExpectation expected = expected_thermal_sigmas(legs);
  document.section("sigmas",
                   fmt::format("Expected sigma of each coefficient, about {} C", format_number(expected.reference_c)));
  Table sigmas{{cell::name("sigma"), cell::text("unit")}};
  for (std::size_t order = 0; order < expected.sigma.size(); ++order)
    sigmas.head.push_back(cell::number(order == 0   ? "constant"
                                       : order == 1 ? "per C"
                                                    : fmt::format("per C^{}", order)));
  for (std::size_t key = 0; key < parameter_keys.size(); ++key) {
    if (!(expected.sigma.front()[static_cast<Eigen::Index>(key)] > 0.0)) continue;
    std::vector<Cell> row = {cell::name(parameter_keys[key]),
                             cell::text(parameter_unit(parameter_keys[key], unit.info.gyro_increment))};
    for (const ParameterVector& sigma : expected.sigma)
      row.push_back(cell::number(sigma[static_cast<Eigen::Index>(key)]));
    sigmas.row(std::move(row));
  }
  document.add(std::move(sigmas));
  document.soft("From the noise of the legs alone; the change of the bias from switch-on to switch-on comes on top.",
                Scope::all);
  return document;
}

}  // namespace turncal
