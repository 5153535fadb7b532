#include "orchestrator/jobs/thermal_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <map>
#include <set>
#include <tuple>

#include "calib/prediction/predict.h"
#include "calib/statistics/data_screen.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/design/sequence_design.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/station/child_program.h"
#include "orchestrator/station/verdict.h"
#include "orchestrator/station/version.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

constexpr double not_known = std::numeric_limits<double>::quiet_NaN();

struct LegFile {
  ThermalLeg leg;
  ParameterFile file;
  std::string path;  // parameter file or recording
  std::string measured;
  std::optional<int> direction;
};

// Fits mean and slope of a straight line through all samples. Returns whether the temperature has moved.
Result<bool> follow_thermometer(RecordingSource& source, ThermalLeg& leg) {
  double n = 0.0, t = 0.0, T = 0.0, tt = 0.0, tT = 0.0, TT = 0.0;
  std::optional<std::int64_t> first;
  TRY(source.read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      if (!std::isfinite(sample.temperature_c) || !temperature_can_be(sample.temperature_c)) continue;
      if (!first) first = sample.counter;
      const double h = double(sample.counter - *first) * source.info().sample_period_s / 3600.0,
                   c = double(sample.temperature_c);
      n += 1.0, t += h, T += c, tt += h * h, tT += h * c, TT += c * c;
    }
    return Status{};
  }));
  if (n == 0.0) return false;
  leg.temperature_c = T / n;
  const double spread = tt - t * t / n;
  leg.rate_c_per_h = spread > 0.0 ? (tT - t * T / n) / spread : 0.0;
  return TT / n - T * T / (n * n) > 0.01;  // a standard deviation of 0.1 C
}

Status read_leg_conf(const std::string& path, LegFile& leg) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  leg.leg.temperature_c =
      file.number_or("temperature_c", leg.leg.temperature_c, between(least_temperature_c, most_temperature_c));
  leg.leg.rate_c_per_h = file.number_or("rate_c_per_h", leg.leg.rate_c_per_h);
  leg.leg.switch_on = int(file.integer_or("switch_on", leg.leg.switch_on, 0, 1'000'000));
  if (file.has("direction")) {
    const std::string direction = file.one_of("direction", {"up", "down", "unknown"});
    leg.direction = direction == "up" ? 1 : direction == "down" ? -1 : 0;
  }
  return file.check_all_used();
}

Status take_covariance(const StoredCovariance& stored, LegFile& leg) {
  leg.leg.value = leg.file.parameters;
  for (int key = 0; key < parameter_count; ++key)
    if (stored.covariance(key, key) > 0.0) leg.leg.free.push_back(key);
  leg.leg.covariance = stored.covariance(leg.leg.free, leg.leg.free);
  return {};
}

Result<LegFile> read_leg(const std::string& path, int number, const ThermalRequest& request,
                         std::vector<std::string>& notes) {
  std::error_code error;
  const bool is_folder = fs::is_directory(path, error),
             is_file = !is_folder && recognise_file(path) == FileKind::parameters;
  const std::string folder = is_folder ? path : fs::path(path).parent_path().string();
  LegFile leg;
  leg.leg.name = path;
  leg.leg.temperature_c = leg.leg.rate_c_per_h = not_known;
  leg.leg.switch_on = -number;  // its own switch-on
  leg.path = is_file ? path : path + "/" + parameters_name;
  const bool has_recording = !is_file && recognise_file(path) == FileKind::recording;
  std::string why;
  if (is_file || (is_folder && path_exists(leg.path))) {
    const std::string text = TRY(read_whole_file(leg.path));
    leg.file = TRY(parse_parameter_file(text, leg.path));
    const StoredCovariance stored = TRY(stored_covariance(leg.file, leg.path));
    if (stored.source == std::string_view("covariance"))
      TRY(take_covariance(stored, leg));
    else
      why = leg.path + ": " +
            (leg.file.effects.empty() ? "holds no covariance of its parameters" : "has effects beside its parameters") +
            ": expected the joint estimate of the 24, or its recording beside it";
    if (leg.file.temperature) return input_error(leg.path + ": has temperature coefficients already: expected a leg");
    if (!why.empty() && !has_recording) return input_error(why);
  }
  if (has_recording || (leg.leg.free.empty() && why.empty())) {
    const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(path));
    const bool moved = TRY(follow_thermometer(*source, leg.leg));
    if (leg.leg.free.empty() || moved) {
      request.phase("calibrating " + path);
      const LoadedRecording loaded = TRY(load_recording(*source));
      const auto output = TRY(calibrate_recording(loaded, {.time_utc = request.time_utc, .partial = true}));
      if (leg.leg.free.empty()) {
        leg.path = path, leg.file = output.file;
        add_measured_utc(loaded.data.info, leg.file);
        const StoredCovariance stored = TRY(stored_covariance(leg.file, path));
        if (stored.source != std::string_view("covariance"))
          return input_error(path + ": its calibration gives no covariance: expected a recording with table angles");
        TRY(take_covariance(stored, leg));
      }
      if (moved && output.fit)
        leg.leg.within = response_to_temperature(loaded.data, *output.fit)(leg.leg.free, leg.leg.free);
    }
  }
  if (!std::isfinite(leg.leg.temperature_c))
    leg.leg.temperature_c = leg.file.reference_temperature_c.value_or(not_known);
  if (const std::string conf = (folder.empty() ? "." : folder) + "/leg.conf"; path_exists(conf))
    TRY(read_leg_conf(conf, leg));
  for (const std::string& given : request.temperatures) {
    const std::size_t equals = given.rfind('=');
    if (equals == std::string::npos || given.substr(0, equals) != path) continue;
    const std::optional<double> value = parse_number(std::string_view(given).substr(equals + 1));
    if (!value) return input_error("--temperature " + given + ": expected a number of C behind the last =");
    leg.leg.temperature_c = *value;
  }
  if (!std::isfinite(leg.leg.temperature_c))
    return input_error(path + ": has no thermometer: expected --temperature " + path +
                       "=VALUE, or temperature_c in its leg.conf");
  if (!std::isfinite(leg.leg.rate_c_per_h)) leg.leg.rate_c_per_h = 0.0;
  if (const std::string* const measured = find_further(leg.file, "record.measured_utc")) leg.measured = *measured;
  if (!is_trusted(leg.file)) notes.push_back(path + ": its sigmas are not trusted");
  return leg;
}

// Checks that the legs are of one unit and in one form, with no recording twice.
Status check_together(const std::vector<LegFile>& legs) {
  const ParameterFile& first = legs.front().file;
  for (std::size_t k = 1; k < legs.size(); ++k) {
    const ParameterFile& file = legs[k].file;
    if (file.unit_serial != first.unit_serial)
      return input_error("{}: is of unit '{}': expected '{}', as {}", legs[k].path, file.unit_serial, first.unit_serial,
                         legs.front().path);
    if (file.gyro_increment != first.gyro_increment || file.accel_increment != first.accel_increment ||
        file.accel_pulse_mps != first.accel_pulse_mps || file.simulated != first.simulated)
      return input_error(legs[k].path + ": has other increments than " + legs.front().path +
                         ", or only one of them is simulated: expected legs of one kind");
    for (std::size_t j = 0; j < k; ++j)
      if (legs[j].file.recording_hash == file.recording_hash)
        return input_error(legs[k].path + ": is the recording of " + legs[j].path + " again: expected each once");
  }
  return {};
}

// Sorts the legs by time, sets their directions, and numbers the switch-ons in order.
void put_in_order(std::vector<LegFile>& legs) {
  const bool timed = std::ranges::none_of(legs, [](const LegFile& leg) { return leg.measured.empty(); });
  if (timed) std::ranges::stable_sort(legs, {}, &LegFile::measured);
  for (std::size_t k = 0; k < legs.size(); ++k) {
    const double step = k == 0 ? 0.0 : legs[k].leg.temperature_c - legs[k - 1].leg.temperature_c;
    const int found = std::abs(step) > thermal_priors.same_temperature_c ? (step > 0.0 ? 1 : -1)
                      : k == 0                                           ? 0
                                                                         : legs[k - 1].leg.direction;
    legs[k].leg.direction = legs[k].direction.value_or(found);
  }
  std::map<int, int> numbers;
  for (LegFile& leg : legs)
    leg.leg.switch_on = numbers.try_emplace(leg.leg.switch_on, int(numbers.size()) + 1).first->second;
}

// Returns the position error after an hour at rest for parameter errors with this covariance, rms.
double miles(const ParameterFile& file, const ParameterCovariance& off) {
  RecordingInfo info;
  info.gyro_increment = file.gyro_increment, info.accel_increment = file.accel_increment;
  info.accel_pulse_mps = file.accel_pulse_mps;
  info.sample_period_s = file.sample_period_s;
  FreeNavigationSetup setup;
  setup.site = {file.latitude_deg * rad_per_deg, file.gravity_mps2};
  setup.counts = counts_model(from_vector(file.parameters), info);
  setup.parameter_covariance = off;
  const DriftPlan plan;
  setup.align_s = plan.align_s;
  const ExpectedDrift::Point end = expected_drift(setup, plan.heading_rad, plan.free_s, plan.free_s).points.back();
  return expected_nm_per_h(end.covariance_m2 - end.noise_m2, end.time_s);
}

ParameterFile file_of(const std::vector<LegFile>& legs, const ThermalModel& model, const std::string& time_utc) {
  ParameterFile file = legs.front().file;
  std::erase_if(file.further, [](const auto& key) { return !key.first.starts_with("noise."); });
  describe_thermal(model, file);
  std::string hashes, why_not;
  for (const LegFile& leg : legs) {
    hashes += leg.file.recording_hash + "\n";
    if (why_not.empty() && !is_trusted(leg.file)) why_not = leg.leg.name + ": " + why_not_trusted(leg.file);
  }
  describe_trust(why_not, file);
  for (std::size_t k = 0; k < legs.size(); ++k) {
    file.add_further(fmt::format("record.leg.{}.hash", k + 1), legs[k].file.recording_hash);
    file.add_further(fmt::format("record.leg.{}.temperature_c", k + 1), legs[k].leg.temperature_c);
  }
  file.recording_hash = hash_of_text(hashes);
  file.model = "temperature", file.method = "joint";
  file.software_version = software_version();
  file.time_utc = time_utc;
  return file;
}

// Adds noise seed and time of each leg of a dry run to the rig's text, which has no such keys.
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
  const double later_s = 6.0 * 3600.0 * double(leg);
  const std::string path = folder + "/leg.rig";
  TRY(write_file_atomically(path, fmt::format("{}\nnoise.seed = {}\nstart_utc_s = {}\n", text, 1000003 * (leg + 1),
                                              format_number(plan.rig.start_utc_s + later_s))));
  return path;
}

RunRequest request_of(const Campaign& campaign, const CampaignLeg& leg, const RunRequest& asked) {
  RunRequest request = asked;
  request.units = {campaign.unit};
  request.station = leg.station.empty() ? campaign.site.station : leg.station;
  request.rig = campaign.rig;
  request.sequence = leg.sequence;
  request.temperature_c = leg.temperature_c;
  return request;
}

// Makes a leg's folder, with what `thermal` and a dry run need; the unit is switched before the folder says so.
Status prepare_leg(const Campaign& campaign, const RunPlan& plan, std::size_t number, const std::string& folder) {
  const CampaignLeg& leg = campaign.legs[number];
  const std::string conf = folder + "/leg.conf";
  if (path_exists(conf)) return {};
  TRY(make_folder(folder));
  const bool switched = leg.switch_on && !plan.request.dry_run;
  if (switched)
    TRY(run_hook(plan.station.hooks, {.event = "switch_on", .unit = campaign.unit, .folder = folder, .message = ""}));
  TRY(write_file_atomically(conf, fmt::format("switch_on = {}\n", leg.switch_on_number)));
  if (!switched || !plan.station.hooks.switch_on.empty()) return {};
  return Error{ErrorKind::interrupted,
               fmt::format("leg {}: switch unit {} off and on, then give the same command again (or set hook.switch_on "
                           "in the station file)",
                           number + 1, campaign.unit)};
}

// Plans all legs, so that whatever would stop a later leg is reported before the first.
Result<std::vector<RunPlan>> plan_legs(const Campaign& campaign, const RunRequest& asked) {
  std::vector<RunPlan> plans;
  for (const CampaignLeg& leg : campaign.legs) {
    Result<RunPlan> plan = plan_run(request_of(campaign, leg, asked));
    const std::string option = "--temperature: ";  // option of a run, here a key of the file
    if (!plan && plan.error().message.starts_with(option))
      return input_error("{}: key 'temperatures_c', leg {}: {}", campaign.file, plans.size() + 1,
                         plan.error().message.substr(option.size()));
    plans.push_back(TRY(std::move(plan)));
    TRY(check_sequence(plans.back()));
  }
  return plans;
}

// Returns what the first `count` legs can distinguish. When that is all that all legs can, further legs only reduce sigmas.
auto reach_of(const Campaign& campaign, std::size_t count) {
  constexpr std::size_t all_shapes = 5,
                        repeats = 2;  // temperatures for every shape; switch-ons to see the repeatability
  std::set<double> temperatures;
  std::set<int> switch_ons;
  std::set<std::pair<std::string, bool>> ways;  // station (its ramp) and direction
  for (std::size_t k = 0; k < count; ++k) {
    const CampaignLeg& leg = campaign.legs[k];
    temperatures.insert(leg.temperature_c);
    switch_ons.insert(leg.switch_on_number);
    if (k > 0) ways.emplace(leg.station, leg.temperature_c > campaign.legs[k - 1].temperature_c);
  }
  return std::tuple(*temperatures.begin(), *temperatures.rbegin(), std::min(temperatures.size(), all_shapes),
                    std::min(switch_ons.size(), repeats), ways);
}

// Returns the parameter of which least is known at a temperature of the campaign. Empty: the station has no requirement.
std::optional<NeededSigma> least_known(const Campaign& campaign, const ThermalModel& model,
                                       const StationConfig& station) {
  std::vector<NeededSigma> all;
  for (const CampaignLeg& leg : campaign.legs) {
    const ThermalPoint point = evaluate(model, leg.temperature_c);
    ParameterFile there;
    there.parameters = point.value;
    for (const ThermalParameter& p : model.parameters)
      there.sigma[std::size_t(p.key)] = std::sqrt(point.covariance(p.key, p.key));
    std::ranges::copy(needed_sigmas(there, station.stop_sigma, station.limits), std::back_inserter(all));
  }
  const auto worst = std::ranges::max_element(all, {}, &NeededSigma::ratio);
  return worst == all.end() ? std::nullopt : std::optional(*worst);
}

// Returns the time from the previous leg until the air has settled; the temperature before the first leg is unknown.
double chamber_s(const Campaign& campaign, const std::vector<RunPlan>& plans, std::size_t leg) {
  const ChamberConfig& chamber = *plans[leg].station.chamber;
  const double way_c = std::abs(campaign.legs[leg].temperature_c - campaign.legs[leg > 0 ? leg - 1 : 0].temperature_c);
  return 60.0 * std::max(0.0, way_c - chamber.band_c) / chamber.described.limits.ramp_c_per_min + chamber.settle_s;
}

// Returns a leg with what its sequence is expected to determine.
ThermalLeg expected_leg(double temperature_c, const Prediction& prediction) {
  ThermalLeg leg;
  leg.temperature_c = temperature_c;
  std::vector<Eigen::Index> rows;
  for (std::size_t i = 0; i < prediction.free.size(); ++i) {
    if (!prediction.determined[std::size_t(prediction.free[i])]) continue;
    leg.free.push_back(prediction.free[i]);
    rows.push_back(Eigen::Index(i));
  }
  leg.covariance = prediction.covariance(rows, rows);
  return leg;
}

}  // namespace

Result<ThermalOutput> thermal_calibration(const ThermalRequest& request) {
  ThermalOutput output;
  ThermalReport& report = output.report;
  std::vector<LegFile> legs;
  for (const std::string& given : request.temperatures)
    if (std::ranges::none_of(request.legs, [&](const std::string& leg) { return given.starts_with(leg + "="); }))
      return input_error("--temperature " + given + ": expected LEG=VALUE, LEG of " +
                         one_of(given.substr(0, given.rfind('=')), request.legs));
  for (const std::string& path : request.legs)
    legs.push_back(TRY(read_leg(path, int(legs.size()) + 1, request, report.notes)));
  TRY(check_together(legs));
  put_in_order(legs);
  for (const LegFile& leg : legs) report.legs.push_back(leg.leg);
  request.phase("weighing models of temperature");
  report.model = TRY(fit_thermal_model(report.legs, {request.reference_c}));
  output.file = file_of(legs, report.model, request.time_utc);
  report.unit = output.file.unit_serial;
  report.gyro_increment = output.file.gyro_increment;
  report.simulated = output.file.simulated;
  const ThermalHoldout& held_out = report.model.holdout;
  if (held_out.worst_z > thermal_priors.disagrees_z) {
    const std::string off = fmt::format("{}: {} is {:.1f} sigma from what the other temperatures expect",
                                        held_out.worst_leg, parameter_key(held_out.worst_key), held_out.worst_z);
    report.notes.push_back(off + ": the sigmas are not trusted, unless this leg is wrong and left out");
    describe_trust(off, output.file);
  }
  report.before_nm_per_h = miles(output.file, held_out.before);
  report.after_nm_per_h = miles(output.file, held_out.after);
  report.noise_nm_per_h = miles(output.file, held_out.noise);
  return output;
}

Result<Campaign> read_campaign(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  const auto beside = [&](const std::string& name) { return name.empty() ? name : file.beside(name); };
  Campaign campaign{.file = path};
  file.integer("format", 1, 1);
  campaign.unit = file.text("unit");
  campaign.site.station = file.file_named("station");
  if (file.has("rig")) campaign.rig = file.file_named("rig");
  campaign.site.arw_deg_per_rt_h = file.number_or("noise.arw_deg_per_rt_h", campaign.site.arw_deg_per_rt_h, positive);
  campaign.site.vrw_ug_per_rt_hz = file.number_or("noise.vrw_ug_per_rt_hz", campaign.site.vrw_ug_per_rt_hz, positive);
  const std::string sequence = file.text_or("sequence", "");
  double low = INFINITY, high = -INFINITY;
  int switched = 1;
  for (const double c : file.numbers("temperatures_c")) {
    const std::string key = fmt::format("leg.{}.", campaign.legs.size() + 1);
    CampaignLeg leg{c, beside(file.text_or(key + "sequence", sequence)), beside(file.text_or(key + "station", "")),
                    file.boolean_or(key + "switch_on", false)};
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
  const std::string rig = asked.dry_run ? TRY(text_of_rig(campaign, plans.front())) : "";
  TRY(make_folder(out));
  const LockFile held = TRY(hold_folder(out));

  ThermalRequest together;
  together.time_utc = format_utc(wall_utc_s());
  const auto enough_after = [&](std::size_t legs, double left_s, ThermalOutput& known) {
    const auto least = least_known(campaign, known.report.model, plans.front().station);
    const bool enough = least && least->ratio() <= 1.0 && is_trusted(known.file);
    const std::string what = fmt::format(
        "after leg {} of {}: {}", legs, plans.size(),
        enough ? fmt::format("enough is known at every temperature; {:.1f} h are left out", left_s / 3600.0)
               : "not yet enough: " + (least && least->ratio() > 1.0 ? words_of(*least) : why_not_trusted(known.file)));
    context.out << tag_of(plans.front()) << "[campaign] " << what << '\n' << std::flush;
    known.report.notes.push_back(what);
    return enough;
  };
  for (std::size_t k = 0; k < campaign.legs.size(); ++k) {
    const std::string folder = fmt::format("{}/leg-{:02}", out, k + 1), journal = folder + "/" + journal_name;
    const bool begun = path_exists(journal);
    double left_s = 0.0;
    for (std::size_t j = k; j < plans.size(); ++j) left_s += chamber_s(campaign, plans, j) + plans[j].plan.station_s;
    if (asked.until_sigma && !begun && k > 0 && reach_of(campaign, k) == reach_of(campaign, plans.size())) {
      ThermalOutput known = TRY(thermal_calibration(together));
      if (enough_after(k, left_s, known)) return known;
    }
    together.legs.push_back(folder);
    RunRequest request = request_of(campaign, campaign.legs[k], asked);
    if (begun) {
      const JournalContents run = TRY(read_journal(journal));
      const RunRequest was = request_of(run);
      if (was.units != request.units || was.temperature_c != request.temperature_c || was.dry_run != request.dry_run)
        return input_error(folder + ": is a run of another campaign, by unit or temperature: expected another --out");
      if (is_over(run) && path_exists(folder + "/" + parameters_name)) continue;
      request = {};
    } else {
      TRY(prepare_leg(campaign, plans[k], k, folder));
      if (asked.dry_run) request.rig = TRY(write_rig(rig, plans[k], k, folder));
    }
    request.session = asked.session;
    request.session.brief = !asked.session.verbose;
    request.session.part = true;
    request.session.whole = fmt::format("; leg {} of {}, the last one ends at about {}", k + 1, plans.size(),
                                        format_utc(wall_utc_s() + left_s));
    context.out << fmt::format("{}[campaign] leg {} of {}, {} C, in {}; about {:.1f} h left\n", tag_of(plans[k]), k + 1,
                               plans.size(), format_number(campaign.legs[k].temperature_c), folder, left_s / 3600.0)
                << std::flush;
    const RunEnd end = begun ? resume_run(folder, request, context) : begin_run(request, folder, context);
    const std::string why = end.status ? "" : end.status.error().message;
    if (!end.to_the_end) return Error{end.status.error().kind, fmt::format("leg {}: {}", k + 1, why)};
    if (!path_exists(folder + "/" + parameters_name))
      return Error{ErrorKind::unit_failed, fmt::format("leg {} gave no parameters: {}", k + 1, why)};
    if (StopSignals::any())
      return Error{ErrorKind::interrupted, fmt::format("paused after leg {}; the same command continues", k + 1)};
  }
  together.time_utc = format_utc(wall_utc_s());
  ThermalOutput known = TRY(thermal_calibration(together));
  if (asked.until_sigma) enough_after(plans.size(), 0.0, known);
  return known;
}

Result<Document> plan_campaign(const Campaign& campaign) {
  const PlannedUnit unit = TRY(planned_unit(campaign.site));
  if (!unit.station.chamber)
    return input_error(campaign.site.station + ": has no chamber: expected chamber.file (docs/thermal.md)");
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
    sigmas.head.push_back(
        cell::number(order == 0 ? "constant" : fmt::format(fmt::runtime(order > 1 ? "per C^{}" : "per C"), order)));
  for (std::size_t key = 0; key < parameter_keys.size(); ++key) {
    if (!(expected.sigma.front()[Eigen::Index(key)] > 0.0)) continue;
    std::vector<Cell> row = {cell::name(parameter_keys[key]),
                             cell::text(parameter_unit(parameter_keys[key], unit.info.gyro_increment))};
    for (const ParameterVector& sigma : expected.sigma) row.push_back(cell::number(sigma[Eigen::Index(key)]));
    sigmas.row(std::move(row));
  }
  document.add(std::move(sigmas));
  document.soft("From the noise of the legs alone; the change of the bias from switch-on to switch-on comes on top.",
                Scope::all);
  return document;
}

}  // namespace turncal
