// `turncal verify`: north seeking on the table with a calibration (Wang (2020), 4.2), and `--references`: readings of references beside
// those of the unit (4.3). The table is moved and the unit recorded as in a run (run_job.h), with verify.seq in place of the fourteen
// steps; an interrupted one is taken up by `turncal resume DIR`; judged again by `turncal verify --recording DIR`.
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/console.h"
#include "imu_io/base/data_text.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/commands/command_run.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/navigation/verification_job.h"
#include "orchestrator/jobs/run_job.h"
#include "orchestrator/jobs/run_results.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/station/builtin_sequence.h"

namespace turncal {

namespace {

struct VerifyOptions {
  RunRequest run;
  std::string unit;
  std::string parameters;
  std::string folder;
  std::string recording;
  std::string references;
  std::string format;
  int first_step = 0;
};

// Whether an option was given that only a measurement has a use for.
bool measures(const VerifyOptions& o) {
  return !o.unit.empty() || o.run.dry_run || o.run.manual || !o.run.rig.empty() || !o.run.sequence.empty() ||
         !o.run.operator_name.empty() || !o.run.ambient.empty() || !o.run.listen.empty() || o.run.pace > 0.0;
}

Status check_together(const VerifyOptions& o) {
  if (!o.references.empty()) {
    if (measures(o) || !o.parameters.empty() || !o.recording.empty() || !o.run.station.empty() || o.first_step != 0)
      return input_error("--references: expected no other option than --out: the readings say everything");
    return {};
  }
  if (o.parameters.empty()) return input_error("--parameters is required: the calibration that is verified");
  if (o.folder.empty()) return input_error("--out is required: the folder for " + std::string(verification_name));
  if (o.recording.empty() && o.unit.empty())
    return input_error("--unit is required (or --recording, of a verification that was recorded)");
  if (o.recording.empty() && !o.format.empty())
    return input_error("--format: expected --recording or --references: a measurement is watched as it goes on");
  if (!o.recording.empty() && measures(o))
    return input_error(
        "--recording: expected --parameters, --out, --station and --from-step alone: nothing is measured");
  return {};
}

Status verify_by_references(const VerifyOptions& options, CommandContext& context) {
  const ReferenceReport report = TRY(verify_references(options.references));
  if (!options.folder.empty()) {
    Result<OutputFolder> folder = OutputFolder::prepare(options.folder, {});
    if (!folder) return folder.error();
    const std::string file = folder->file("references.conf");
    TRY(write_file_atomically(file, format_references(report)));
    folder->keep();
  }
  context.out << (options.format.empty() ? as_text(reference_document(report))
                                         : key_values_as(options.format, format_references(report)));
  return verification_status(options.references, report.pass ? UnitVerdict::pass : UnitVerdict::fail);
}

// Records the north seeking as a run that calibrates nothing. What cannot be used is refused before anything moves.
Status measure(const VerifyOptions& options, CommandContext& context) {
  RunRequest run = options.run;
  run.units = {options.unit};
  run.capture_only = run.verify = true;
  run.verified = options.parameters;
  if (run.sequence.empty()) run.sequence = builtin_verify_name;
  return begin_run(run, options.folder, context).status;
}

Status judge_again(const VerifyOptions& options, CommandContext& context) {
  VerdictLimits limits;
  if (!options.run.station.empty()) {
    const StationConfig station = TRY(read_station_config(options.run.station));
    limits = station.limits;
  }
  ParameterFile parameters = TRY(read_parameter_file(options.parameters));
  Result<OutputFolder> folder = OutputFolder::prepare(options.folder, {});
  if (!folder) return folder.error();
  const Result<VerificationReport> report =
      verify_recording({options.recording, options.parameters, std::move(parameters), limits, options.first_step});
  if (!report) return report.error();
  const std::string file = folder->file(verification_name);
  const std::string conf = format_verification(*report);
  TRY(write_file_atomically(file, conf));
  folder->keep();
  if (!options.format.empty()) {
    context.out << key_values_as(options.format, conf) << std::flush;
    return verification_status("unit " + report->info.unit_serial, report->verdict);
  }
  const LinePrefix marked(context.out,
                          report->info.simulated && context.tag.empty() ? std::string(simulated_tag) : context.tag);
  context.out << as_text(verification_document(*report)) << "verification  " << file << std::endl;
  return verification_status("unit " + report->info.unit_serial, report->verdict);
}

Status verify(const VerifyOptions& options, CommandContext& context) {
  TRY(check_together(options));
  if (!options.references.empty()) return verify_by_references(options, context);
  return options.recording.empty() ? measure(options, context) : judge_again(options, context);
}

}  // namespace

void add_verify_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<VerifyOptions>();
  RunRequest& run = options->run;
  const Command command = line.command("verify", "north seeking with a calibration, or readings beside references");
  command.option("--parameters", options->parameters, "parameter file of the unit");
  command.option("--unit", options->unit, "serial number of the unit");
  command.option("--out", options->folder, "folder for the recording and verification.conf");
  command.option("--station", run.station, "station configuration, with its limits; default: the built-in rig station");
  command.flag("--dry-run", run.dry_run, "use the built-in rig in virtual time");
  command.flag("--manual", run.manual, "the table is turned by hand");
  command.option("--rig", run.rig, "rig configuration (docs/rig.md); default: the built-in one");
  command.option("--sequence", run.sequence, "another sequence than verify.seq: align sets the zero, dwell counts");
  command.option("--recording", options->recording, "judge what was recorded before; nothing moves");
  command
      .option("--from-step", options->first_step, "of a recording: where the north seeking begins, after a calibration")
      .range(0, 1'000'000);
  command.option("--references", options->references,
                 "CSV of readings: heading_deg,roll_deg,pitch_deg and the same with reference_ in front");
  command
      .option("--format", options->format,
              "of --recording and --references: print the file in this form instead of words")
      .one_of(data_formats);
  add_watch_options(command, run);
  add_record_options(command, run);
  command.runs(context, [options, &context] { return verify(*options, context); });
}

}  // namespace turncal
