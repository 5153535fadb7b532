#include "orchestrator/jobs/run_results.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <sstream>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/devices/truth.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/continued_run.h"
#include "orchestrator/jobs/navigation/verification_job.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/records/recording_sink.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/records/station_records.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/watch/progress.h"
#include "orchestrator/watch/tone.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

namespace {

// Nothing here may depend on how often the run was interrupted: the file is the same for an uninterrupted one.
void add_record(const PreparedRun& run, const RunCounts& counts, ParameterFile& file) {
  const RunRequest& request = run.request;
  const std::pair<const char*, std::string> fields[] = {
      {"record.part", request.part},
      {"record.lot", request.lot},
      {"record.revision", request.revision},
      {"record.began_utc", run.began_utc},
      {"record.station", run.station.name},
      {"record.operator", request.operator_name},
      {"record.ambient", request.ambient},
      {"record.configuration_hash", run.station_hash},
      {"record.sequence", run.sequence.name},
      {"record.sequence_hash", run.sequence_hash},
      {"record.table_id", run.station.table_id},
      {"record.table_calibration_due", run.station.table_calibration_due},
      {"record.overdue_reason", request.overdue_reason},
      {"record.ended_after_s", request.until_sigma ? format_number(counts.recorded_s) : ""},
      {"record.repeated_dwells", format_number(counts.repeated_dwells)},
      {"record.lost_samples", format_number(counts.lost_samples)},
      {"record.clock_ppm", counts.clock ? format_number(counts.clock->ppm) : ""},
      {"record.clock_uncertainty_ppm", counts.clock ? format_number(counts.clock->uncertainty_ppm) : ""}};
  for (const auto& [key, value] : fields) {
    if (!value.empty()) file.add_further(key, value);
  }
}

// "accel_second_order (31 sigma), gyro_bias_drift (7 sigma)"; what is wrong where no effect was added.
std::string finding_of(const Diagnosis& d) {
  if (d.verdict != Verdict::extended) return d.reason;
  std::vector<std::string> parts;
  for (const std::string& name : d.effect_names) {
    double strongest = 0.0;
    for (const EstimatedEffect& e : d.extended.effects)
      if (e.column.entry && e.column.entry->name == name && e.sigma > 0.0)
        strongest = std::max(strongest, std::abs(e.value) / e.sigma);
    parts.push_back(name + " (" + significant(strongest, 2) + " sigma)");
  }
  return join(parts);
}

// Where the samples are: what is not sealed yet still has its name of the run.
std::string samples_of(const std::string& folder, const LoadedRecording& recording) {
  return path_exists(recording.path) ? recording.path : folder + "/" + partial_recording_name;
}

struct Finding {
  std::string diagnosis = "not_made", text;
};

// recordings: this one is the last of them.
bool is_diagnosed(const PreparedRun& run, const std::vector<LoadedRecording>& recordings) {
  double recorded_s = 0.0;
  for (const LoadedRecording& one : recordings)
    recorded_s += static_cast<double>(one.data.samples) * one.data.info.sample_period_s;
  return !run.request.no_diagnosis && !run.request.partial && recorded_s >= least_diagnosed_s;
}

// Beyond the 24 parameters.
Finding diagnose_unit(const PreparedRun& run, const std::string& folder, const std::vector<LoadedRecording>& recordings,
                      RunResults& results) {
  if (!is_diagnosed(run, recordings)) return Finding{};
  DiagnosisRequest request;
  request.time_utc = results.output->file.time_utc;
  request.base = results.output->fit && recordings.size() == 1 ? &*results.output->fit : nullptr;
  request.of_run = true;
  request.samples = recordings.size() == 1 ? samples_of(folder, recordings.front()) : recordings.front().path;
  std::vector<const LoadedRecording*> all;
  for (const LoadedRecording& one : recordings) all.push_back(&one);
  Result<DiagnosisOutput> output = diagnose_recordings(all, request);
  if (!output) return Finding{"failed", output.error().message};
  results.diagnosis = std::move(*output);
  const Diagnosis& diagnosis = results.diagnosis->diagnosis;
  return Finding{to_string(diagnosis.verdict), finding_of(diagnosis)};
}

// North sought with what was estimated, or with the file that was given. Its verdict becomes part of the unit's.
Status verify_unit(const PreparedRun& run, const std::string& folder, const LoadedRecording& recording,
                   RunResults& results) {
  if (!run.request.verify) return {};
  const bool own = results.output.has_value();
  Result<VerificationReport> report = verify_recording({.recording = samples_of(folder, recording),
                                                        .parameters = own ? parameters_name : run.request.verified,
                                                        .file = own ? results.output->file : *run.verified,
                                                        .limits = run.station.limits,
                                                        .first_step = run.verify_from});
  if (!report && !own) return Error{ErrorKind::unit_failed, report.error().message};
  if (!report) {                                                            // what was calibrated is kept
    const bool not_judged = report.error().kind == ErrorKind::unit_failed;  // too much of it was lost
    judge_verification(not_judged ? UnitVerdict::hold : UnitVerdict::fail, report.error().message, results.verdict);
    return {};
  }
  judge_verification(report->verdict, verification_words(*report), results.verdict);
  results.verification = std::move(*report);
  return stored(write_file_atomically(folder + "/" + verification_name, format_verification(*results.verification)));
}

// Into FOLDER/diagnosis, with how the verification ended.
Status write_diagnosis_of(const std::string& folder, RunResults& results) {
  if (!results.diagnosis) return {};
  const std::string own = folder + "/" + diagnosis_folder;
  TRY(make_folder(own));
  DiagnosisFiles& files = results.diagnosis->files;
  if (!results.verdict.verification.empty()) say_verification(results.verdict.verification, files.report);
  TRY(write_diagnosis(own, files));
  return {};
}

// A clean diagnosis, too, knows what came near to being claimed.
void widen_by_alias(const Diagnosis& diagnosis, ParameterFile& file) {
  describe_alias(diagnosis, file);
  for (std::size_t k = 0; k < parameter_keys.size(); ++k)
    if (find_further(file, alias_key_prefix + std::string(parameter_keys[k])))
      file.sigma[k] = diagnosis.extended.sigma[static_cast<Eigen::Index>(k)];
}

// The file the unit is to load, judged.
void choose_file(const PreparedRun& run, const RunCounts& counts, const Finding& finding, RunResults& results) {
  CalibrationOutput& output = *results.output;
  if (finding.diagnosis == to_string(Verdict::extended) && run.station.diagnosis.load_extended)
    output.file = *results.diagnosis->files.parameters;
  else if (finding.diagnosis == to_string(Verdict::clean))
    widen_by_alias(results.diagnosis->diagnosis, output.file);
  else if (finding.diagnosis != "clean" &&
           finding.diagnosis != "not_made")  // the base model alone is not the whole truth
    for (auto& [key, value] : output.file.further)
      if (key == "quality.trusted") value = "false";
  add_record(run, counts, output.file);
  std::optional<ClockLimit> clock;
  if (counts.clock && run.station.imu) clock = {*counts.clock, run.station.imu->settings.clock_max_ppm};
  if (!run.request.partial) {  // an estimate in part is no judgement of the unit
    results.verdict =
        judge(output.file, {output.min_temperature_c, output.max_temperature_c}, run.station.limits, clock);
  }
  judge_diagnosis(finding.diagnosis, finding.text, run.station.diagnosis, results.verdict);
  if (finding.diagnosis == "not_made" && !run.request.partial) judge_trust(output.distrust, results.verdict);
}

Status write_truth(const PreparedRun& run, const std::string& folder, const RunResults& results) {
  if (!run.request.dry_run) return {};
  const std::optional<double> reference_c = results.output ? results.output->mean_temperature_c : std::nullopt;
  return stored(write_file_atomically(folder + "/" + truth_name, format_truth(Rig(run.rig), reference_c)));
}

JournalFields marked(JournalFields fields, const JournalFields& mark) {
  fields.insert(fields.end(), mark.begin(), mark.end());
  return fields;
}

Status keep_results(const PreparedRun& run, const std::string& folder, const std::vector<LoadedRecording>& recordings,
                    const RunCounts& counts, JournalFile& journal, const JournalFields& mark,
                    const RunResults& results) {
  const ParameterFile& file = results.output->file;
  const std::string path = folder + "/" + parameters_name;
  const std::string text = TRY(format_parameter_file(file));
  TRY(write_file_atomically(path, text));
  SqlBytes statistics;
  if (const std::optional<UnitStatistics> found = statistics_of(recordings, *results.output)) {  // for the fleet
    Result<SqlBytes> bytes = format_statistics({file, *found});
    if (!bytes) return bytes.error();
    statistics = std::move(*bytes);
    if (Status status = write_file_atomically(folder + "/" + statistics_name,
                                              {reinterpret_cast<const char*>(statistics.data()), statistics.size()});
        !status)
      return status;
  }
  const JournalFields hash = marked({{"parameters_hash", hash_of_text(text)}}, mark);
  TRY(journal.append(JournalType::results, hash));
  if (const std::string records = records_file(run.station); !records.empty()) {
    ResultsDatabase database = TRY(ResultsDatabase::open(records));
    AttemptRecord attempt = attempt_record(run, folder, counts, results);
    attempt.time_utc = file.time_utc;
    attempt.outcome = to_string(results.verdict.verdict);
    attempt.reason = results.verdict.reason;
    TRY(database.add(file, results.verdict, attempt, statistics));
  }
  if (!run.station.store.empty() && !run.request.partial && is_accepted(results.verdict.verdict)) {
    TRY(put_in_use(run.station.store, file));
  }
  return {};
}

}  // namespace

Status stored(Status status) {
  if (status || status.error().kind != ErrorKind::input) return status;
  return device_error(status.error().message);
}

std::string_view tag_of(const PreparedRun& run) {
  if (run.request.dry_run) return dry_run_tag;
  return run.simulated() ? simulated_tag : std::string_view();
}

std::string_view tag_of(const JournalContents& journal) {
  if (journal.begin_value("simulated") != "true") return {};
  return journal.begin_value("live") == "true" ? simulated_tag : dry_run_tag;
}

Status write_results(const PreparedRun& run, const std::string& folder, const LoadedRecording& recording, double utc_s,
                     const RunCounts& counts, JournalFile& journal, const JournalFields& mark, RunResults& results) {
  results = {};
  Status calibrated;
  std::vector<LoadedRecording> recordings;
  if (!run.request.continues.empty()) {
    Result<std::vector<LoadedRecording>> earlier = recordings_up_to(run.request.continues);
    if (!earlier) return device_error(earlier.error().message);
    recordings = std::move(*earlier);
  }
  recordings.push_back(recording);
  if (!run.request.capture_only) {
    CalibrationRequest request;
    request.time_utc = format_utc(utc_s);
    request.partial = run.request.partial;
    request.test_fit = !is_diagnosed(run, recordings);
    Result<CalibrationOutput> output = calibrate_recordings(recordings, request);
    if (output)
      results.output = std::move(*output);
    else  // it was measured; what kept it from being calibrated is the unit's or its recording's, not of what was asked
      calibrated = Error{output.error().kind == ErrorKind::input ? ErrorKind::unit_failed : output.error().kind,
                         output.error().message};
  }
  TRY(write_truth(run, folder, results));
  if (!calibrated) {  // all of it is recorded: nothing that is done again would help
    const Status kept = journal.append(
        JournalType::verdict,
        marked({{"result", std::string(to_string(UnitVerdict::fail))}, {"reason", calibrated.error().message}}, mark));
    return kept ? calibrated : stored(kept);
  }
  if (results.output) {
    choose_file(run, counts, diagnose_unit(run, folder, recordings, results), results);
    TRY(verify_unit(run, folder, recording, results));
    if (Status status = write_diagnosis_of(folder, results); !status) return stored(status);
    add_verdict(results.verdict, results.output->file);
    if (Status status = keep_results(run, folder, recordings, counts, journal, mark, results); !status)
      return stored(status);
  }
  if (!results.output) {
    TRY(verify_unit(run, folder, recording, results));
  }
  const VerdictReport& verdict = results.verdict;
  return journal.append(JournalType::verdict, marked({{"result", std::string(to_string(verdict.verdict))},
                                                      {"rule", verdict.rule},
                                                      {"diagnosis", verdict.diagnosis},
                                                      {"verification", verdict.verification},
                                                      {"reason", verdict.reason}},
                                                     mark));
}

AttemptRecord attempt_record(const PreparedRun& run, const std::string& folder, const RunCounts& counts,
                             const RunResults& results) {
  AttemptRecord attempt;
  if (!folder.empty()) attempt.folder = std::filesystem::absolute(folder).lexically_normal().string();
  const RunRequest& request = run.request;
  // A run of several units has a folder for each.
  if (!run.began_utc.empty()) attempt.run = run.began_utc + " " + attempt.folder;
  attempt.unit = run.unit();
  attempt.began_utc = run.began_utc;
  attempt.simulated = run.simulated();
  attempt.station = run.station.name;
  attempt.operator_name = request.operator_name;
  attempt.part = request.part;
  attempt.revision = request.revision;
  attempt.ambient = request.ambient;
  if (results.output) {
    attempt.temperature_min_c = results.output->min_temperature_c;
    attempt.temperature_max_c = results.output->max_temperature_c;
    if (const std::string* const residual = find_further(results.output->file, "quality.normalised_rms"))
      attempt.residual = parse_number(*residual);
  }
  attempt.diagnosis = results.verdict.diagnosis;
  if (counts.recorded_s > 0.0) attempt.recorded_s = counts.recorded_s;
  attempt.sessions = counts.sessions;
  attempt.repeated_dwells = counts.repeated_dwells;
  attempt.lost_samples = static_cast<std::int64_t>(counts.lost_samples);
  return attempt;
}

std::string reason_of(const PreparedRun& run, const VerdictReport& verdict) {
  if (run.request.partial) return "estimated in part";
  return verdict.verdict == UnitVerdict::not_judged ? "the station has no limits" : verdict.reason;
}

Status verdict_status(const std::string& unit, const VerdictReport& report) {
  if (is_accepted(report.verdict)) return {};
  return Error{ErrorKind::unit_failed,
               "unit " + unit + ": " + std::string(to_string(report.verdict)) + ": " + report.reason};
}

void print_summary(const PreparedRun& run, const std::string& folder, const RunCounts& counts,
                   const RunResults& results, double wall_s, const std::string& log, std::ostream& printed) {
  std::ostringstream out;
  char text[200];
  std::snprintf(text, sizeof text,
                "%s complete: %s recorded (%.10g s of station time) in %.1f s; %d dwells repeated, %llu samples lost.",
                run.request.dry_run ? "Dry run" : "Run", format_duration(counts.recorded_s).c_str(), counts.recorded_s,
                wall_s, counts.repeated_dwells, static_cast<unsigned long long>(counts.lost_samples));
  out << text << '\n';
  const auto path = [&folder](const char* name) { return folder + "/" + name; };
  if (results.output) {
    for (const std::string& note : results.output->notes) out << note << '\n';
    const Result<ParameterVector> truth = run.request.dry_run
                                              ? read_truth(path(truth_name))
                                              : Result<ParameterVector>(input_error("a real unit has no known truth"));
    out << '\n';
    out << as_text(result_table(results.output->file, truth ? std::optional(*truth) : std::nullopt)) << '\n';
    if (results.diagnosis) out << as_text(results.diagnosis->files.report, diagnosis_lines) << '\n';
    const VerdictReport& verdict = results.verdict;
    for (const std::string& line : describe(verdict)) out << line << '\n';
    const std::string why = reason_of(run, verdict);
    const std::string word(to_string(verdict.verdict));
    const bool judged = verdict.verdict != UnitVerdict::not_judged;
    out << "verdict     " << (judged ? in_tone(printed, tone_of(verdict.verdict), word) : word)
        << (why.empty() ? "" : ": ") << why << (verdict.rule.empty() ? "" : "  (" + verdict.rule + ")") << '\n';
    out << "parameters  " << path(parameters_name) << '\n';
    if (results.diagnosis) out << "report      " << path(diagnosis_folder) << '/' << report_name << '\n';
  }
  if (results.verification) {
    out << '\n';
    out << as_text(verification_document(*results.verification));
    out << "verification  " << path(verification_name) << '\n';
  }
  if (run.request.dry_run) out << "truth       " << path(truth_name) << '\n';
  out << "recording   " << path(binary_recording_name) << '\n' << "log         " << log << '\n';
  printed << out.str() << std::flush;
}

}  // namespace turncal
