// `turncal run`: the whole main job. Checks everything, walks the sequence, calibrates, judges, writes the results.
// `turncal run --continue`: a further recording of the same unit (continued_run.h). `turncal resume`: goes on with one that was interrupted. `turncal journal`: what happened. See run_job.h.
#include "orchestrator/commands/command_run.h"

#include <memory>
#include <sstream>

#include "imu_io/base/console.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/continued_run.h"
#include "orchestrator/jobs/run_job.h"
#include "orchestrator/jobs/run_results.h"

namespace turncal {

namespace {

struct RunOptions {
  RunRequest request;
  std::string folder;
};

void add_overdue_option(const Command& command, RunRequest& request) {
  command.option("--override-due", request.overdue_reason,
                 "use a table whose calibration is overdue, for this reason, which goes on record");
}

}  // namespace

void add_record_options(const Command& command, RunRequest& request) {
  command.option("--operator", request.operator_name, "who runs it, for the record");
  command.option("--part", request.part, "part number of the unit, for the record");
  command.option("--lot", request.lot, "lot that the unit is of, for the record and the fleet");
  command.option("--revision", request.revision, "revision of the unit, for the record");
  command.option("--ambient", request.ambient, "ambient conditions, for the record (\"22.5 C, 45 %\")");
  add_overdue_option(command, request);
}

void add_verify_option(const Command& command, RunRequest& request) {
  command.flag("--verify", request.verify, "seek north with the new parameters, right after the calibration");
}

void add_until_option(const Command& command, RunRequest& request) {
  command.flag(
      "--until-sigma", request.until_sigma,
      "end after the dwell at which stop.sigma.* and limit.* of the station are met with certainty (docs/design.md)");
}

void add_watch_options(const Command& command, RunRequest& request) {
  command.option("--listen", request.listen,
                 "serve a read-only status page there (127.0.0.1:8080; port 0: any free one)");
  command.option("--pace", request.pace, "of a dry run: at most this many times as fast as the wall clock").positive();
  command.flag("--verbose", request.verbose, "print every transition, as run.log has it");
}

void add_run_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<RunOptions>();
  RunRequest& request = options->request;
  const Command command = line.command("run", "run a calibration: move the table, record, calibrate");
  command.flag("--dry-run", request.dry_run, "use the built-in rig (mock table, simulated IMU) in virtual time");
  command.flag(
      "--manual", request.manual,
      "the table is turned by hand, whatever the station names: an operator is told what to do (docs/tables.md)");
  command
      .option("--unit", request.units,
              "serial number of the unit; once for each of several on the table, in the order of the station's places")
      .one_word_each();
  command.option("--out", options->folder, "folder for the results; must not hold a run yet");
  command.option("--continue", request.continues,
                 "folder of a run: record more of its unit, and diagnose both together (docs/design.md); --out is "
                 "DIR/continued then, where not given");
  command.option("--rig", request.rig, "rig configuration (docs/rig.md); default: the built-in one");
  command.option("--sequence", request.sequence, "sequence file; default: the fourteen steps");
  command.option("--station", request.station, "station configuration; default: the built-in rig station");
  add_watch_options(command, request);
  command.flag("--capture-only", request.capture_only, "record the sequence, do not calibrate");
  command.flag("--partial", request.partial,
               "of a sequence that does not determine all: estimate what it does; no verdict, not put in use");
  command.flag("--no-diagnosis", options->request.no_diagnosis, "leave out the diagnosis at the end");
  add_verify_option(command, request);
  add_until_option(command, request);
  add_record_options(command, request);
  command.runs(context, [options, &context]() -> Status {
    if (!options->request.continues.empty()) {
      const RunRequest further = TRY(continuing(options->request));
      const std::string& out = options->folder;
      return begin_run(further, out.empty() ? further.continues + "/continued" : out, context).status;
    }
    if (options->request.units.empty()) return input_error("--unit is required: the serial number of the unit");
    if (options->folder.empty()) return input_error("--out is required: the folder for the results");
    return begin_run(options->request, options->folder, context).status;
  });
}

void add_resume_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<RunOptions>();
  RunRequest& moved = options->request;
  const Command command =
      line.command("resume", "go on with a run that was interrupted, after its last complete dwell");
  command.option("folder", options->folder, "the run's folder").required();
  command.option("--unit", moved.units, "the unit (or units) expected there").one_word_each();
  command.option("--rig", moved.rig, "where the rig configuration is now, if it was moved");
  command.option("--sequence", moved.sequence, "where the sequence is now, if it was moved");
  command.option("--station", moved.station, "where the station configuration is now, if it was moved");
  command.flag("--no-diagnosis", options->request.no_diagnosis, "leave out the diagnosis at the end");
  add_overdue_option(command, moved);
  add_watch_options(command, moved);
  command.runs(context, [options, &context] { return resume_run(options->folder, options->request, context).status; });
}

void add_journal_command(CommandLine& line, CommandContext& context) {
  struct JournalOptions {
    std::string folder, format;
  };
  const auto options = std::make_shared<JournalOptions>();
  const Command command = line.command("journal", "print the journal of a run, one line a record");
  command.option("folder", options->folder, "the run's folder").required();
  command.option("--format", options->format, "print every field of every record in this form").one_of(data_formats);
  command.prints(context, [options, &context]() -> Status {
    const std::string path = options->folder + "/" + journal_name;
    if (!options->format.empty()) {
      const DataTable table = TRY(journal_as_table(path));
      context.out << table.as(options->format) << std::flush;
      return {};
    }
    const std::string text = TRY(journal_as_text(path));
    const Result<JournalContents> contents = read_journal(path);
    const LinePrefix marked(context.out, std::string(contents ? tag_of(*contents) : ""));
    context.out << text << std::flush;
    return {};
  });
}

}  // namespace turncal
