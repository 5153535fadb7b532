#include "orchestrator/jobs/run_request.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <tuple>
#include <utility>

#include "calib/navigation/alignment.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/version.h"

namespace turncal {

namespace {

// Returns the text of a file; of a built-in one only the version, which identifies it.
Result<std::string> text_of(std::string& path, const std::string& built_in) {
  if (path.empty()) return built_in;
  path = std::filesystem::absolute(path).lexically_normal().string();
  return read_whole_file(path);
}

std::string of_this_version(const char* what) { return std::string(what) + " of turncal " + software_version(); }

// `given`: the path as the user gave it, for messages.
Result<StationConfig> station_from(const std::string& path, const std::string& text, const std::string& given) {
  if (path.empty()) return default_station_config();
  Result<StationConfig> station = parse_station_config(text, given);
  if (station) station->file = path;
  return station;
}

Status check_words(const RunRequest& request) {
  for (const std::string& unit : request.units) {
    TRY(check_serial(unit, "--unit"));
    if (std::ranges::count(request.units, unit) > 1)
      return input_error("--unit " + turncal::quoted(unit) + ": given twice, expected each unit once");
  }
  for (const RecordWord& record : record_words) {
    const std::string& word = request.*record.word;
    if (!word.empty() && !is_plain_text(word))
      return input_error("{} {}: expected printable characters without '#'", record.option, turncal::quoted(word));
  }
  return {};
}

Status check_seeks_north(const StationConfig& station) {
  const Status status = check_navigation_latitude(station.latitude_deg);
  if (status || station.file.empty()) return status;
  return input_error(station.file + ": site." + status.error().message);
}

// Checks a chamber that a run would switch on.
Status check_chamber(const RunPlan& run) {
  const auto& chamber = run.station.chamber;
  if (run.request.temperature_c) {
    if (!chamber)
      return input_error("--temperature: station '{}' has no chamber: expected chamber.file in its file",
                         run.station.name);
    if (const Status fits = check_temperature(*chamber, *run.request.temperature_c); !fits)
      return input_error("--temperature: " + fits.error().message);
  }
  if (!run.temperature_c() || run.request.dry_run || chamber->described.commissioned) return {};
  return input_error(chamber->described.file +
                     ": commissioned = false: expected a chamber that turncal commission --chamber has tried");
}

// Any position that the operator may enter has to count as arrived.
void turn_by_hand(StationConfig& station) {
  station.table.driver = TableDriver::manual;
  station.motion.position_tolerance_deg =
      std::max(station.motion.position_tolerance_deg, 1.1 * station.table.manual.tolerance_deg);
}

// Prepares what is to be verified, and appends the north seeking to the calibration where there is one.
Status prepare_verification(RunPlan& run) {
  RunRequest& wanted = run.request;
  if (wanted.verify && wanted.verified.empty() && (wanted.capture_only || wanted.partial))
    return input_error("--verify: expected neither --capture-only nor --partial, which give no result to verify");
  wanted.verify =
      wanted.verify || (run.station.verify_run && !wanted.capture_only && !wanted.partial && wanted.continues.empty());
  if (!wanted.verify) return {};
  if (wanted.verified.empty()) {
    run.verify_from = TRY(append_north_seeking(run.station, run.sequence));
    return {};
  }
  TRY(check_seeks_north(run.station));
  const std::string given = wanted.verified;
  const std::string text = TRY(text_of(wanted.verified, ""));
  run.verified = TRY(read_parameter_file(given));
  run.hashes.verified = hash_of_text(text);
  run.verify_from = run.sequence.steps.front().number;
  return {};
}

// Checks that the station says what is enough to end a run early.
Status check_until_sigma(const RunPlan& run) {
  if (!run.request.until_sigma) return {};
  if (run.request.capture_only || run.request.partial)
    return input_error("--until-sigma: expected neither --capture-only nor --partial, which make no estimate to judge");
  if (says_when(run.station.stop_sigma, run.station.limits)) return {};
  return input_error("--until-sigma: station " + run.station.name +
                     " does not say what is enough: expected stop.sigma.<key> or limit.<key>.* in its file");
}

// Returns a time after the last attempt at the station that leaves time to change the unit.
Result<double> next_beginning(const StationConfig& station, const RigConfig& rig) {
  double next_s = rig.start_utc_s;
  std::string server_away;
  const std::vector<AttemptRecord> attempts = TRY(recorded_attempts(station, {.station = station.name}, server_away));
  for (const AttemptRecord& attempt : attempts) {
    const std::optional<double> ended_s = parse_utc(attempt.time_utc);
    if (attempt.simulated && !attempt.run.empty() && ended_s)
      next_s = std::max(next_s, *ended_s + std::floor(3600.0 * rig.lot.between_h));
  }
  return next_s;
}

// Continues with the same unit, later and switched on again: the same unit seed, another noise seed.
Status turn_on_again(RunPlan& run) {
  if (run.request.continues.empty()) return {};
  const JournalContents before = TRY(read_journal(run.request.continues + "/" + journal_name));
  if (before.begin_value("rig_hash") != run.hashes.rig)
    return input_error("{}: is not the rig of the run in {}",
                       run.request.rig.empty() ? "the built-in rig" : run.request.rig, run.request.continues);
  run.rig.unit_seed = run.rig.unit_seed.value_or(run.rig.seed);
  run.rig.noise_seed = run.rig.noise_seed.value_or(run.rig.seed);
  constexpr std::uint64_t another = 1000003;
  for (JournalContents one = before;;) {
    *run.rig.noise_seed += another;
    const std::string further = one.begin_value("continues");
    if (further.empty()) break;
    one = TRY(read_journal(further + "/" + journal_name));
  }
  constexpr double between_s = 600.0;
  if (before.seal_utc_s) run.rig.start_utc_s = std::floor(*before.seal_utc_s + between_s);
  return {};
}

// Draws a unit of a lot from its serial number; the clock goes on from run to run.
Status turn_on_of_lot(RunPlan& run) {
  if (!run.rig.lot.seed || run.request.units.empty()) return {};
  if (run.request.units.size() > 1)
    return input_error("{}: lot.seed: expected one unit at a time, found {}", run.request.rig,
                       run.request.units.size());
  const std::optional<double> began_s = parse_utc(run.request.began_utc);
  run.rig.start_utc_s = TRY(began_s ? Result<double>(*began_s) : next_beginning(run.station, run.rig));
  run.rig = rig_of_lot(run.rig, run.unit());
  return {};
}

Status prepare_rig(RunPlan& run) {
  RunRequest& wanted = run.request;
  const std::string rig_given = wanted.rig.empty() ? run.station.rig_file : wanted.rig;
  wanted.rig = rig_given;
  const std::string rig_text = TRY(text_of(wanted.rig, of_this_version("built-in rig")));
  run.rig = TRY(rig_of(run.station, rig_given));
  run.hashes.rig = hash_of_text(rig_text);
  if (wanted.station.empty()) {  // the built-in station is at the rig's site
    run.station.latitude_deg = run.rig.site.latitude_deg;
    run.station.gravity_mps2 = run.rig.site.gravity_mps2;
  }
  TRY(turn_on_again(run));
  return turn_on_of_lot(run);
}

// Returns the fields of the first record, in order, for as many units as there is room for; the first unit stands among the files.
Fields fields_of(RunRequest& request, FileHashes& hashes) {
  Fields fields = {chosen("live", request.dry_run, {"true", ""}, ""),
                   {"began_utc", &request.began_utc},
                   {"manual", &request.manual, {}, true},
                   {"capture_only", &request.capture_only},
                   {"partial", &request.partial, {}, true},
                   {"no_diagnosis", &request.no_diagnosis, {}, true},
                   {"verify", &request.verify, {}, true},
                   {"until_sigma", &request.until_sigma, {}, true},
                   {"continues", &request.continues},
                   {"verified", &request.verified},
                   {"verified_hash", &hashes.verified},
                   {"unit", &request.units.front()},
                   {"station", &request.station},
                   {"station_hash", &hashes.station},
                   {"rig", &request.rig},
                   {"rig_hash", &hashes.rig},
                   {"sequence", &request.sequence},
                   {"sequence_hash", &hashes.sequence}};
  for (const RecordWord& record : record_words) fields.push_back({record.key, &(request.*record.word)});
  for (std::size_t unit = 1; unit < request.units.size(); ++unit)
    fields.push_back({"unit." + std::to_string(unit + 1), &request.units[unit]});
  fields.push_back({"temperature_c", &request.temperature_c});
  fields.push_back({"settle_minutes", &request.settle_minutes});
  return fields;
}

std::pair<RunRequest, FileHashes> beginning_of(const JournalContents& journal) {
  std::pair<RunRequest, FileHashes> began;
  began.first.units.resize(journal.units().size());
  set_texts(journal.begin, fields_of(began.first, began.second));
  began.first.settled = journal.settled;
  return began;
}

}  // namespace

std::size_t places(const RunPlan& run) { return run.request.dry_run ? most_units : run.station.imu_places(); }

RecordingInfo planned_info(const StationConfig& station, const RigConfig* rig) {
  RecordingInfo info;
  if (rig != nullptr) {
    info.sample_period_s = rig->sample_period_s;
    info.accel_pulse_mps = rig->accel_pulse_mps;
  } else {
    station.imu->frame.describe(info);
  }
  info.latitude_deg = station.latitude_deg;
  info.gravity_mps2 = station.gravity_mps2;
  return info;
}

RecordingInfo planned_info(const RunPlan& run) {
  return planned_info(run.station, run.request.dry_run ? &run.rig : nullptr);
}

std::vector<std::string> no_real_devices(const StationConfig& station) {
  std::vector<std::string> why;
  std::map<std::string, std::string> taken;  // key of each lock taken
  for (const auto& [key, line] : device_lines(station)) {
    if (line.find("SET-ME") != std::string::npos) {
      why.push_back(station.keys.error_at(key, "the name of this station's line").message);
      continue;
    }
    const auto [at, is_first] = taken.emplace(lock_path_of(line), key);
    if (!is_first) why.push_back(station.keys.error_at(key, "a line of its own, not that of " + at->second).message);
  }
  const std::string whose = (station.file.empty() ? "station '" + station.name + "'" : station.file) + ": ";
  if (station.chamber && station.chamber->described.language == ChamberDescription::Language::rig)
    why.push_back(station.chamber->described.file +
                  ": link.kind = rig: expected a chamber on a line, or --dry-run to rehearse");
  const bool mock = station.table.driver == TableDriver::mock, rig = !station.imu;
  if (mock && rig)
    why.push_back(
        whose +
        "only mock devices (table.driver = mock, imu.driver = rig): nothing real would move; turncal run --dry-run "
        "rehearses");
  else if (mock || rig)
    why.push_back(fmt::format("{}a mock {}: expected table and unit both real, or --dry-run to rehearse", whose,
                              mock ? "table (table.driver = mock)" : "unit (imu.driver = rig)"));
  return why;
}

Status check_real_devices(const StationConfig& station) {
  const std::vector<std::string> why = no_real_devices(station);
  return why.empty() ? Status() : Status(input_error(why.front()));
}

Result<int> append_north_seeking(const StationConfig& station, Sequence& sequence) {
  TRY(check_seeks_north(station));
  const Sequence seeking = TRY(parse_sequence(std::string(builtin_verify_text), builtin_verify_name));
  const std::size_t steps = sequence.steps.size();
  append_steps(seeking, sequence);
  return sequence.steps[steps].number;
}

Result<RunPlan> plan_run(const RunRequest& request) {
  RunPlan run = TRY(read_run(request));
  if (!request.dry_run) TRY(check_real_devices(run.station));
  TRY(check_chamber(run));
  return run;
}

Result<RunPlan> read_run(const RunRequest& request) {
  if (request.capture_only && request.partial) return input_error("--capture-only and --partial: expected one of them");
  RunPlan run;
  run.request = request;
  RunRequest& wanted = run.request;
  TRY(check_words(wanted));

  const std::string station_text = TRY(text_of(wanted.station, of_this_version("built-in station")));
  run.station = TRY(station_from(wanted.station, station_text, request.station));
  if (wanted.manual) turn_by_hand(run.station);
  if (wanted.rehearsal() && wanted.units.size() > 1)
    return input_error("--manual --dry-run with {} units: expected one, a rehearsal has one rig", wanted.units.size());
  run.hashes.station = hash_of_text(station_text);

  if (!wanted.dry_run && !wanted.rig.empty())
    return input_error("--rig describes a simulated table and unit: it needs --dry-run");
  if (!wanted.dry_run && wanted.session.pace > 0.0)
    return input_error("--pace slows virtual time down: it needs --dry-run");
  TRY(wanted.dry_run ? prepare_rig(run) : run.station.imu ? Status{} : check_real_devices(run.station));
  if (wanted.units.size() > places(run))
    return input_error(
        "--unit: {} units: expected at most {}{}", wanted.units.size(), places(run),
        wanted.dry_run ? " in a dry run" : ", as station '" + run.station.name + "' has places (imu.2.device ...)");

  const bool seeks = wanted.sequence == builtin_verify_name, built_in = seeks || wanted.sequence.empty();
  run.sequence = TRY(!built_in ? read_sequence(wanted.sequence)
                     : seeks   ? parse_sequence(std::string(builtin_verify_text), builtin_verify_name)
                               : parse_sequence(std::string(builtin_sequence_text), builtin_sequence_name));
  if (!built_in) wanted.sequence = std::filesystem::absolute(run.sequence.file).lexically_normal().string();
  run.hashes.sequence = hash_of_text(run.sequence.text);
  TRY(prepare_verification(run));
  TRY(check_until_sigma(run));
  if (wanted.settle_minutes && *wanted.settle_minutes > 0.0 && settling_allowed_s(run) <= 0.0)
    return input_error(
        "--settle: expected a table that turns by itself, and a run that is diagnosed alone (none of --continue, "
        "--capture-only, --partial, --no-diagnosis)");
  run.plan = make_plan(run.sequence, plan_limits(run.station, run.sample_period_s()));
  for (const Settling& settling : std::exchange(wanted.settled, {})) TRY(lengthen(run, settling));
  return run;
}

double settling_allowed_s(const RunPlan& run) {
  const RunRequest& asked = run.request;
  const bool diagnosed = !asked.no_diagnosis && !asked.capture_only && !asked.partial && asked.continues.empty();
  if (!diagnosed || run.verified || asked.rehearsal() || run.station.table.driver == TableDriver::manual) return 0.0;
  return 60.0 * asked.settle_minutes.value_or(run.station.settle_minutes);
}

Status lengthen(RunPlan& run, const Settling& settling) {
  if (!settling.sequence.empty()) {
    Sequence sequence = run.sequence;
    int verify_from = run.verify_from;
    if (verify_from > 0) std::erase_if(sequence.steps, [&](const Step& step) { return step.number >= verify_from; });
    append_steps(TRY(parse_sequence(settling.sequence, settling_name)), sequence);
    if (verify_from > 0) verify_from = TRY(append_north_seeking(run.station, sequence));
    Plan plan = make_plan(sequence, plan_limits(run.station, run.sample_period_s()));
    if (!plan.ok()) return input_error(plan.violations.front());
    run.sequence = std::move(sequence);
    run.verify_from = verify_from;
    run.plan = std::move(plan);
  }
  run.request.settled.push_back(settling);
  return {};
}

JournalFields begin_fields(RunPlan run) {
  JournalFields fields = {
      {"format", "1"}, {"software_version", software_version()}, {"simulated", run.simulated() ? "true" : "false"}};
  const JournalFields asked = texts_of(fields_of(run.request, run.hashes));
  fields.insert(fields.end(), asked.begin(), asked.end());
  if (!run.request.manual) fields.emplace_back("planned_s", format_number(run.plan.station_s));
  return fields;
}

RunRequest request_of(const JournalContents& journal) { return beginning_of(journal).first; }

Result<RunRequest> request_again(const JournalContents& journal, const RunRequest& now) {
  RunRequest request = request_of(journal);
  if (!now.units.empty() && now.units != request.units)
    return input_error("--unit '{}': expected '{}', whose run this is", fmt::join(now.units, "', '"),
                       fmt::join(request.units, "', '"));
  for (std::string RunRequest::*file : {&RunRequest::station, &RunRequest::sequence, &RunRequest::rig})
    if (!(now.*file).empty()) request.*file = now.*file;
  if (request.overdue_reason.empty()) request.overdue_reason = now.overdue_reason;
  request.no_diagnosis = request.no_diagnosis || now.no_diagnosis;
  request.session = now.session;
  return request;
}

Result<RunRequest> continuing(const RunRequest& asked) {
  for (const auto& [option, given] : {std::pair{"--unit", !asked.units.empty()},
                                      {"--station", !asked.station.empty()},
                                      {"--rig", !asked.rig.empty()},
                                      {"--verify", asked.verify},
                                      {"--until-sigma", asked.until_sigma},
                                      {"--settle", asked.settle_minutes.has_value()},
                                      {"--partial", asked.partial},
                                      {"--capture-only", asked.capture_only}})
    if (given)
      return input_error(
          "{}: expected no such option beside --continue, which goes on with the unit and the station of {}", option,
          asked.continues);
  if (asked.sequence.empty()) return input_error("--continue: expected --sequence, the sequence to record");
  const std::string journal = asked.continues + "/" + journal_name;
  if (!path_exists(journal))
    return input_error(asked.continues + ": holds no " + journal_name + ": expected the folder of a run");
  const RunRequest before = request_of(TRY(read_journal(journal)));
  if (before.units.size() != 1)
    return input_error("{}: is a run of {} units: expected a run of one", asked.continues, before.units.size());
  if (!path_exists(asked.continues + "/" + binary_recording_name))
    return input_error("{}: holds no {}: expected a run whose recording is complete (turncal resume completes it)",
                       asked.continues, binary_recording_name);
  if (asked.dry_run && !before.dry_run)
    return input_error("--dry-run: expected none, " + asked.continues + " is a run of a real unit");
  RunRequest request = asked;
  request.continues = std::filesystem::absolute(asked.continues).lexically_normal().string();
  request.dry_run = before.dry_run;
  request.manual = before.manual || asked.manual;
  request.units = before.units;
  request.station = before.station;
  request.rig = before.rig;
  if (!asked.temperature_c) request.temperature_c = before.temperature_c;
  for (const RecordWord& record : record_words)
    if ((asked.*record.word).empty()) request.*record.word = before.*record.word;
  return request;
}

Status check_unchanged(const RunPlan& run, const JournalContents& journal) {
  const RunRequest& request = run.request;
  const FileHashes began = beginning_of(journal).second;
  const std::tuple<const char*, std::string FileHashes::*, const std::string&> files[] = {
      {"station", &FileHashes::station, request.station},
      {"rig", &FileHashes::rig, request.rig},
      {"sequence", &FileHashes::sequence, request.sequence},
      {"parameter file", &FileHashes::verified, request.verified}};
  for (const auto& [what, hash, path] : files)
    if (began.*hash != run.hashes.*hash)
      return input_error("{}: is not the {} that the run began with: expected hash {}, found {}",
                         path.empty() ? std::string("the built-in ") + what : path, what, began.*hash,
                         run.hashes.*hash);
  return {};
}

}  // namespace turncal
