#include "orchestrator/jobs/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <sstream>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/jobs/navigation/verification_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/station/number_text.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

namespace {

// The results of one unit in the making.
struct Making {
  Run& run;
  RunUnit& unit;
  std::string time_utc;
  std::vector<LoadedRecording> recordings;  // of the unit, this run's last
  std::string diagnosis = "not_made", finding = {};
  std::string distrust = {};  // what the diagnosis objects to in the parameters without effects
  KeyTexts settled = {};      // record.settle.1 and so on
};

// Returns "accel_second_order (31 sigma), gyro_bias_drift (7 sigma)".
std::string finding_of(const Diagnosis& d) {
  std::vector<std::string> parts;
  for (const std::string& name : d.effect_names)
    parts.push_back(name + " (" + significant(z_of(*strongest_of(d.extended, name).front()), 2) + " sigma)");
  return join(parts);
}

// Returns the path of the samples: a recording that is not sealed yet still has its partial name.
std::string samples_of(const Making& m) {
  const std::string& path = m.recordings.back().path;
  return path_exists(path) ? path : m.unit.file(partial_recording_name);
}

bool is_diagnosed(const Making& m) {
  double recorded_s = 0.0;
  for (const LoadedRecording& one : m.recordings)
    recorded_s += double(one.data.samples) * one.data.info.sample_period_s;
  return !m.run.request.no_diagnosis && !m.run.request.partial && recorded_s >= least_diagnosed_s;
}

// Reports each round of settling doubts: what was in doubt, what was done, and what is known now.
void describe_settling(Making& m) {
  if (!m.unit.diagnosis) return;
  const Diagnosis& d = m.unit.diagnosis->diagnosis;
  int round = 0;
  for (const Settling& one : m.run.request.settled) {
    if (one.unit != m.unit.serial) continue;
    const std::optional<Doubt> left = doubt_of(d);
    const std::string now = d.verdict == Verdict::extended && !left ? "it is " + join(d.effect_names)
                            : left                                  ? "still in doubt: " + words_of(*left)
                                                                    : "the diagnosis is " + m.diagnosis;
    const std::string done =
        one.sequence.empty() ? one.why_not : format_duration(one.added_s) + " of legs were added; " + now;
    m.settled.push_back({"settle." + std::to_string(++round), one.doubt + "; " + done});
    say_settled("In doubt was " + one.doubt + ": " + done, m.unit.diagnosis->files.report);
  }
}

// Diagnoses effects beyond the 24 parameters.
void diagnose_unit(Making& m) {
  if (!is_diagnosed(m)) return;
  const bool alone = m.recordings.size() == 1;
  const JointResult* const fit = alone && m.unit.output && m.unit.output->fit ? &*m.unit.output->fit : nullptr;
  Result<DiagnosisOutput> output =
      diagnose_recordings(m.recordings, {.time_utc = m.time_utc,
                                         .noise = {},
                                         .base = fit,
                                         .samples = alone ? samples_of(m) : m.recordings.front().path,
                                         .of_run = true});
  m.diagnosis = output ? to_string(output->diagnosis.verdict) : "failed";
  m.finding = output ? finding_of(output->diagnosis) : output.error().message;
  m.distrust = output ? output->diagnosis.why_base_not_trusted() : m.finding;
  if (output) m.unit.diagnosis = std::move(*output);
  describe_settling(m);
}

// Estimates and diagnoses the unit. Where parameters stay undetermined, the diagnosis says why, and the unit is left without parameters.
Status estimate(Making& m) {
  if (m.run.request.capture_only) return {};
  const bool partial = m.run.request.partial, diagnosed = is_diagnosed(m);
  Result<CalibrationOutput> output = calibrate_recordings(
      m.recordings, {.time_utc = m.time_utc, .partial = partial || diagnosed, .test_fit = !diagnosed});
  if (output) m.unit.output = std::move(*output);
  diagnose_unit(m);
  // The unit was measured, so a failure to calibrate lies in the unit or its recording, not in the request.
  if (!output)
    return Error{output.error().kind == ErrorKind::input ? ErrorKind::unit_failed : output.error().kind,
                 output.error().message};
  const std::optional<JointResult>& fit = m.unit.output->fit;
  if (partial || !fit || undetermined_parameters(*fit).empty()) return {};
  const Diagnosis* const found = m.unit.diagnosis ? &m.unit.diagnosis->diagnosis : nullptr;
  const std::string open = found ? what_is_open(m.recordings, *fit, found) : m.finding;
  m.unit.output.reset();
  return not_determined(open);
}

// Seeks north with the estimated parameters, or with the given file. The verdict becomes part of the unit's.
Status verify_unit(Making& m) {
  if (!m.run.request.verify) return {};
  RunUnit& unit = m.unit;
  const bool own = unit.output.has_value();
  Result<VerificationReport> report = verify_recording({.recording = samples_of(m),
                                                        .parameters = own ? parameters_name : m.run.request.verified,
                                                        .file = own ? unit.output->file : *m.run.verified,
                                                        .limits = m.run.station.limits,
                                                        .first_step = m.run.verify_from});
  if (!report && !own) return Error{ErrorKind::unit_failed, report.error().message};
  if (!report) {                                                            // the calibration is kept
    const bool not_judged = report.error().kind == ErrorKind::unit_failed;  // too many samples were lost
    const std::string& why = report.error().message;
    judge_verification(not_judged ? UnitVerdict::hold : UnitVerdict::fail, why, why, unit.verdict);
    return {};
  }
  // Whether its own parameters are trusted the unit's verdict says already.
  const std::string figures = verdict_of_figures(*report) == UnitVerdict::pass ? "" : figures_words(*report);
  const std::string words = verification_words(*report);
  judge_verification(report->verdict, words, own ? figures : words, unit.verdict);
  unit.verification = std::move(*report);
  return {};
}

// Widens the sigmas by aliases; a clean diagnosis, too, knows the effects that it nearly claimed.
void widen_by_alias(const Diagnosis& diagnosis, ParameterFile& file) {
  describe_alias(diagnosis, file);
  for (std::size_t k = 0; k < parameter_keys.size(); ++k)
    if (find_further(file, alias_key_prefix + parameter_key(k)))
      file.sigma[k] = diagnosis.extended.sigma[Eigen::Index(k)];
}

// Chooses the file that the unit is to load.
void choose_file(Making& m) {
  ParameterFile& file = m.unit.output->file;
  if (m.diagnosis == to_string(Verdict::extended) && m.run.station.diagnosis.load_extended)
    file = *m.unit.diagnosis->files.parameters;
  else if (!m.distrust.empty())
    describe_trust(m.distrust, file);
  else if (m.unit.diagnosis)
    widen_by_alias(m.unit.diagnosis->diagnosis, file);
  for (const auto& [key, value] : facts_of(m.run, m.unit)) file.add_further("record." + key, value);
  for (const auto& [key, value] : m.settled) file.add_further("record." + key, value);
}

Status judge(Making& m) {
  RunUnit& unit = m.unit;
  if (!unit.output) return verify_unit(m);
  choose_file(m);
  const CalibrationOutput& output = *unit.output;
  const bool partial = m.run.request.partial;  // a partial estimate does not judge the unit
  std::optional<ClockLimit> clock;
  if (unit.clock && m.run.station.imu) clock = {*unit.clock, m.run.station.imu->settings.clock_max_ppm};
  if (!partial)
    unit.verdict =
        turncal::judge(output.file, {output.min_temperature_c, output.max_temperature_c}, m.run.station.limits, clock);
  const std::string distrust = unit.diagnosis ? unit.diagnosis->diagnosis.why_not_trusted : output.distrust;
  judge_diagnosis(m.diagnosis, m.finding, partial ? "" : distrust, m.run.station.diagnosis, unit.verdict);
  TRY(verify_unit(m));
  add_verdict(unit.verdict, unit.output->file);
  return {};
}

// Writes a journal record about a unit; in a run of several it names the unit.
Status note(Making& m, JournalType type, JournalFields fields) {
  if (m.run.units.size() > 1) fields.emplace_back("unit", m.unit.serial);
  return m.run.journal->append(type, fields);
}

// Makes the results durable, in this order. Each step may take its time with the storage.
Status publish(Making& m, const std::function<Status(const std::function<Status()>&)>& keep) {
  const StationConfig& station = m.run.station;
  RunUnit& unit = m.unit;
  const auto write_report = [&]() -> Status {
    const std::string& verified = unit.verdict.verification;  // outcome of the verification
    if (!verified.empty()) say_verification(verified, unit.diagnosis->files.report);
    TRY(make_folder(unit.file(diagnosis_folder)));
    TRY(write_diagnosis(unit.file(diagnosis_folder), unit.diagnosis->files));
    return {};
  };
  if (unit.verification)
    TRY(keep([&] { return write_verification(unit.file(verification_name), *unit.verification); }));
  if (unit.diagnosis) TRY(keep(write_report));
  if (unit.output) {
    const ParameterFile& file = unit.output->file;
    TRY(keep([&] { return write_parameter_file(file, unit.file(parameters_name)); }));
    SqlBytes statistics;  // for the fleet
    const auto write_statistics = [&]() -> Status {
      const std::optional<UnitStatistics> found = statistics_of(m.recordings, *unit.output);
      if (!found) return {};
      statistics = TRY(format_statistics({file, *found}));
      return write_file_atomically(unit.file(statistics_name),
                                   {reinterpret_cast<const char*>(statistics.data()), statistics.size()});
    };
    TRY(keep(write_statistics));
    const auto note_parameters = [&]() -> Status {
      return note(m, JournalType::results, {{"parameters_hash", hash_of_text(TRY(format_parameter_file(file)))}});
    };
    TRY(keep(note_parameters));
    const auto add_to_database = [&]() -> Status {
      const std::string records = records_file(station);
      if (records.empty()) return {};
      ResultsDatabase database = TRY(ResultsDatabase::open(records));
      AttemptRecord attempt = attempt_record(m.run, unit);
      attempt.time_utc = file.time_utc;
      attempt.outcome = to_string(unit.verdict.verdict);
      attempt.reason = unit.verdict.reason;
      return database.add(file, attempt, statistics);
    };
    TRY(keep(add_to_database));
    if (!station.store.empty() && !m.run.request.partial && is_accepted(unit.verdict.verdict))
      TRY(keep([&] { return put_in_use(station.store, file); }));
  }
  return keep([&] { return note(m, JournalType::verdict, texts_of(unit.verdict)); });
}

Status make_unit(Run& run, RunUnit& unit, double utc_s, CommandContext& context) {
  unit.output = {};
  unit.diagnosis = {};
  unit.verification = {};
  unit.verdict = {};
  Making making{run, unit, format_utc(utc_s), {}};
  if (!run.request.continues.empty()) {
    Result<std::vector<LoadedRecording>> earlier = recordings_up_to(run.request.continues);
    if (!earlier) return device_error(earlier.error().message);
    making.recordings = std::move(*earlier);
  }
  making.recordings.push_back(*unit.recording);
  const Status estimated = estimate(making);
  const auto keep = [&](const std::function<Status()>& step) {
    const auto limit = limit_storage(unit.folder, resuming(run.folder), context);
    return stored(step());
  };
  if (run.request.dry_run)
    TRY(keep([&] {
      const std::optional<double> reference_c = unit.output ? unit.output->mean_temperature_c : std::nullopt;
      return write_file_atomically(unit.file(truth_name), format_truth(Rig(unit.rig), reference_c));
    }));
  if (!estimated) {  // all is recorded, and repeating it would not help
    unit.verdict.verdict = UnitVerdict::fail;
    unit.verdict.reason = estimated.error().message;
    unit.verdict.diagnosis = unit.diagnosis ? making.diagnosis : "";
    TRY(publish(making, keep));
    return estimated;
  }
  TRY(judge(making));
  return publish(making, keep);
}

void print_unit(const Run& run, const RunUnit& unit, double wall_s, std::ostream& printed) {
  std::ostringstream out;
  out << fmt::format(
      "{} complete: {} recorded ({:.10g} s of station time) in {:.1f} s; dwells repeated: {}, samples lost: {}.\n",
      run.request.dry_run ? "Dry run" : "Run", format_duration(unit.recorded_s), unit.recorded_s, wall_s,
      unit.repeated_dwells, unit.lost_samples);
  if (unit.output) {
    for (const std::string& note : unit.output->notes) out << note << '\n';
    const Result<ParameterVector> truth = run.request.dry_run
                                              ? read_truth(unit.file(truth_name))
                                              : Result<ParameterVector>(input_error("a real unit has no known truth"));
    out << '\n' << as_text(result_table(unit.output->file, truth ? std::optional(*truth) : std::nullopt)) << '\n';
    if (unit.diagnosis) out << as_text(unit.diagnosis->files.report, diagnosis_lines) << '\n';
  }
  if (unit.verification)
    out << (unit.output ? "" : "\n")
        << as_text(verification_document(*unit.verification, unit.output ? "north seeking" : "verdict")) << '\n';
  if (unit.output) {
    const VerdictReport& verdict = unit.verdict;
    for (const std::string& line : judged_lines(verdict)) out << line << '\n';
    const std::string why = reason_of(run, verdict);
    const std::string word = in_words(to_string(verdict.verdict));
    const bool judged = verdict.verdict != UnitVerdict::not_judged;
    out << "verdict     " << (judged ? in_tone(printed, tone_of(verdict.verdict), word) : word)
        << (why.empty() ? "" : ": ") << why << (verdict.rule.empty() ? "" : "  (" + verdict.rule + ")") << '\n';
    out << "parameters  " << unit.file(parameters_name) << '\n';
    if (unit.diagnosis) out << "report      " << unit.file(diagnosis_folder) << '/' << report_name << '\n';
  }
  if (unit.verification) out << "verification  " << unit.file(verification_page) << '\n';
  if (run.request.dry_run) out << "truth       " << unit.file(truth_name) << '\n';
  out << "recording   " << unit.file(binary_recording_name) << "\nlog         " << run.folder << '/' << log_name
      << '\n';
  printed << out.str() << std::flush;
}

}  // namespace

KeyTexts facts_of(const Run& run, const RunUnit& unit) {
  const auto clock = [&unit](double UnitClock::*part) {
    return unit.clock ? format_number(*unit.clock.*part) : std::string();
  };
  const RunRequest& asked = run.request;
  KeyTexts facts = {{"part", asked.part},
                    {"lot", asked.lot},
                    {"revision", asked.revision},
                    {"began_utc", asked.began_utc},
                    {"station", run.station.name},
                    {"operator", asked.operator_name},
                    {"ambient", asked.ambient},
                    {"configuration_hash", run.hashes.station},
                    {"sequence", run.sequence.name},
                    {"sequence_hash", run.hashes.sequence},
                    {"table_id", run.station.table_id},
                    {"table_calibration_due", run.station.table_calibration_due},
                    {"overdue_reason", asked.overdue_reason},
                    {"ended_after_s", asked.until_sigma ? format_number(unit.recorded_s) : ""},
                    {"repeated_dwells", format_number(unit.repeated_dwells)},
                    {"lost_samples", format_number(unit.lost_samples)},
                    {"clock_ppm", clock(&UnitClock::ppm)},
                    {"clock_uncertainty_ppm", clock(&UnitClock::uncertainty_ppm)}};
  std::erase_if(facts, [](const auto& fact) { return fact.second.empty(); });
  return facts;
}

void end_without_storage(const std::string& why, const std::string& path, const std::string& then,
                         CommandContext& context) {
  context.err << context.tag << error_prefix << why << "; nothing more could be written to " << path
              << ", and the program ends without waiting for it; when the disk answers again: turncal " << then
              << std::endl;
  std::_Exit(exit_code(ErrorKind::device));
}

std::unique_ptr<StorageLimit> limit_storage(const std::string& path, const std::string& then, CommandContext& context) {
  return std::make_unique<StorageLimit>([path, then, &context] {
    end_without_storage("the disk has not answered for " + format_number(StorageLimit::together_s) + " s", path, then,
                        context);
  });
}

Status stored(Status status) {
  if (status || status.error().kind != ErrorKind::input) return status;
  return device_error(status.error().message);
}

Status make_results(Run& run, double utc_s, CommandContext& context) {
  bool any = false;
  Status first;
  for (RunUnit& unit : run.units) {
    if (unit.dropped) continue;
    unit.status = make_unit(run, unit, utc_s, context);
    if (!unit.status && unit.status.error().kind == ErrorKind::device) return unit.status;  // the storage's fault
    if (unit.status)
      any = true;
    else if (first)
      first = unit.status;
  }
  return any ? Status{} : first;
}

std::string reason_of(const RunPlan& run, const VerdictReport& verdict) {
  if (run.request.partial) return "estimated in part";
  return verdict.reason.empty() && verdict.verdict == UnitVerdict::not_judged ? "the station has no limits"
                                                                              : verdict.reason;
}

Status verdict_status(const std::string& unit, const VerdictReport& report) {
  if (is_accepted(report.verdict)) return {};
  return Error{ErrorKind::unit_failed, outcome_words(unit, to_string(report.verdict), report.reason)};
}

std::string outcome_words(const std::string& unit, std::string_view outcome, const std::string& reason) {
  return "unit " + unit + ": " + in_words(outcome) + (reason.empty() ? "" : ": " + reason);
}

std::string reason_alone(const Status& status, const std::string& unit, std::string_view outcome,
                         const VerdictReport& verdict) {
  if (status) return verdict.reason;
  const std::string& message = status.error().message;
  for (const std::string& head : {outcome_words(unit, outcome, "") + ": ", dropout_words(unit, {})})
    if (message.starts_with(head)) return message.substr(head.size());
  return message;
}

void print_results(Run& run, double wall_s, std::ostream& out) {
  for (RunUnit& unit : run.units) {
    if (unit.dropped || !unit.status) continue;
    if (run.units.size() > 1 && !run.request.session.brief) out << "unit " << unit.serial << ":\n";
    if (!run.request.session.brief) print_unit(run, unit, wall_s, out);
    unit.status = verdict_status(unit.serial, unit.verdict);
  }
}

}  // namespace turncal
