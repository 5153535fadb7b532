#include "orchestrator/jobs/run_results.h"

#include <cstdio>
#include <sstream>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/devices/truth.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/records/recording_sink.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/watch/progress.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

namespace {

// Nothing here may depend on how often the run was interrupted: the file is the same for an uninterrupted one.
void add_record(const PreparedRun& run, const RunCounts& counts, ParameterFile& file) {
  const RunRequest& request = run.request;
  const std::pair<const char*, std::string> fields[] = {
      {"record.part", request.part},
      {"record.revision", request.revision},
      {"record.station", run.station.name},
      {"record.operator", request.operator_name},
      {"record.ambient", request.ambient},
      {"record.configuration_hash", run.station_hash},
      {"record.sequence", run.sequence.name},
      {"record.sequence_hash", run.sequence_hash},
      {"record.table_id", run.station.table_id},
      {"record.table_calibration_due", run.station.table_calibration_due},
      {"record.overdue_reason", request.overdue_reason},
      {"record.repeated_dwells", format_number(counts.repeated_dwells)},
      {"record.lost_samples", format_number(counts.lost_samples)}};
  for (const auto& [key, value] : fields) {
    if (!value.empty()) file.add_further(key, value);
  }
}

Result<CalibrationOutput> calibrate_capture(const std::string& folder, double utc_s, bool partial) {
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(folder + "/" + binary_recording_name);
  if (!source) return source.error();
  CalibrationRequest request;
  request.time_utc = format_utc(utc_s);
  request.partial = partial;
  return calibrate_recording(**source, request);
}

Status write_truth(const PreparedRun& run, const std::string& folder, const RunResults& results) {
  if (!run.request.dry_run) return {};
  const std::optional<double> reference_c = results.output ? results.output->mean_temperature_c : std::nullopt;
  return write_file_atomically(folder + "/" + truth_name, format_truth(Rig(run.rig), reference_c));
}

JournalFields marked(JournalFields fields, const JournalFields& mark) {
  fields.insert(fields.end(), mark.begin(), mark.end());
  return fields;
}

Status keep_results(const PreparedRun& run, const std::string& folder, const RunCounts& counts, JournalFile& journal,
                    const JournalFields& mark, const RunResults& results) {
  const ParameterFile& file = results.output->file;
  const std::string path = folder + "/" + parameters_name;
  const Result<std::string> text = format_parameter_file(file);
  if (!text) return text.error();
  if (Status status = write_file_atomically(path, *text); !status) return status;
  const JournalFields hash = marked({{"parameters_hash", hash_of_text(*text)}}, mark);
  if (Status status = journal.append(JournalType::results, hash); !status) return status;
  if (!run.station.database.empty()) {
    Result<ResultsDatabase> database = ResultsDatabase::open(run.station.database);
    if (!database) return database.error();
    if (Status status = database->add(file, results.verdict, folder, counts.sessions); !status) return status;
  }
  if (!run.station.store.empty() && !run.request.partial && is_accepted(results.verdict.verdict)) {
    if (Status status = put_in_use(run.station.store, file); !status) return status;
  }
  return {};
}

}  // namespace

std::string_view tag_of(const PreparedRun& run) {
  if (run.request.dry_run) return dry_run_tag;
  return run.simulated() ? simulated_tag : std::string_view();
}

std::string_view tag_of(const JournalContents& journal) {
  if (journal.begin_value("simulated") != "true") return {};
  return journal.begin_value("live") == "true" ? simulated_tag : dry_run_tag;
}

Status write_results(const PreparedRun& run, const std::string& folder, double utc_s, const RunCounts& counts,
                     JournalFile& journal, const JournalFields& mark, RunResults& results) {
  Status calibrated;
  if (!run.request.capture_only) {
    Result<CalibrationOutput> output = calibrate_capture(folder, utc_s, run.request.partial);
    if (output) {
      add_record(run, counts, output->file);
      // An estimate in part is no judgement of the unit.
      if (!run.request.partial)
        results.verdict =
            judge(output->file, {output->min_temperature_c, output->max_temperature_c}, run.station.limits);
      add_verdict(results.verdict, output->file);
      results.output = std::move(*output);
    } else {
      calibrated = output.error();
    }
  }
  if (Status status = write_truth(run, folder, results); !status && calibrated) return status;
  if (!calibrated) return calibrated;
  if (results.output) {
    if (Status status = keep_results(run, folder, counts, journal, mark, results); !status) return status;
  }
  return journal.append(
      JournalType::verdict,
      marked({{"result", std::string(to_string(results.verdict.verdict))}, {"rule", results.verdict.rule}}, mark));
}

Status verdict_status(const std::string& unit, const VerdictReport& report) {
  if (is_accepted(report.verdict)) return {};
  const std::vector<std::string> lines = describe(report);
  std::string worst;
  for (std::size_t i = 0; i < report.values.size() && worst.empty(); ++i) {
    const JudgedValue& judged = report.values[i];
    if (judged.verdict != report.verdict) continue;
    for (const std::string& line : lines) {
      if (line.starts_with(judged.key + " = ")) worst = line;
    }
  }
  return Error{ErrorKind::unit_failed,
               "unit " + unit + " is outside its limits: " + worst +
                   (lines.size() > 1 ? " (and " + std::to_string(lines.size() - 1) + " more)" : "")};
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
    print_results(results.output->file, truth ? std::optional(*truth) : std::nullopt, out);
    out << '\n';
    for (const std::string& line : describe(results.verdict)) out << line << '\n';
    if (results.verdict.verdict == UnitVerdict::not_judged) {
      out << "verdict     not judged: " << (run.request.partial ? "estimated in part" : "the station has no limits")
          << '\n';
    } else {
      out << "verdict     " << to_string(results.verdict.verdict) << "  (" << results.verdict.rule << ")\n";
    }
    out << "parameters  " << path(parameters_name) << '\n';
  }
  if (run.request.dry_run) out << "truth       " << path(truth_name) << '\n';
  out << "recording   " << path(binary_recording_name) << '\n' << "log         " << log << '\n';
  const std::string whole = out.str();
  const std::string_view tag = tag_of(run);
  for (std::string_view rest = whole; !rest.empty();) {
    const std::string_view line = take_line(rest);
    printed << (line.empty() && !tag.empty() ? tag.substr(0, tag.size() - 1) : tag) << line << '\n';
  }
  printed << std::flush;
}

}  // namespace turncal
