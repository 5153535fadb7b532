#include "orchestrator/commands/command_run.h"

#include <memory>
#include <sstream>

#include "orchestrator/commands/command_diagnose.h"
#include "orchestrator/jobs/run_job.h"
#include "orchestrator/jobs/run_results.h"

namespace turncal {

namespace {

struct Options {
  RunRequest request;
  std::string folder;
  bool no_diagnosis = false;
};

void add_overdue_option(CLI::App& command, RunRequest& request) {
  command.add_option("--override-due", request.overdue_reason,
                     "use a table whose calibration is overdue, for this reason, which goes on record");
}

void conclude(const RunEnd& end, bool diagnosis, CommandContext& context) {
  if (!end.status) context.fail(end.status.error());
  if (!diagnosis) return;
  for (const RunEnd::Unit& unit : end.units) diagnose_run(unit.folder, unit.status, context);
}

}  // namespace

void add_record_options(CLI::App& command, RunRequest& request) {
  command.add_option("--operator", request.operator_name, "who runs it, for the record");
  command.add_option("--part", request.part, "part number of the unit, for the record");
  command.add_option("--revision", request.revision, "revision of the unit, for the record");
  command.add_option("--ambient", request.ambient, "ambient conditions, for the record (\"22.5 C, 45 %\")");
  add_overdue_option(command, request);
}

void add_view_options(CLI::App& command, RunRequest& request) {
  command.add_option("--listen", request.listen,
                     "serve a read-only status page there (127.0.0.1:8080; port 0: any free one)");
  command.add_option("--pace", request.pace, "of a dry run: at most this many times as fast as the wall clock")
      ->check(CLI::PositiveNumber);
}

void add_run_command(CLI::App& app, CommandContext& context) {
  const auto options = std::make_shared<Options>();
  RunRequest& request = options->request;
  CLI::App* command = app.add_subcommand("run", "run a calibration: move the table, record, calibrate");
  command->add_flag("--dry-run", request.dry_run, "use the built-in rig (mock table, simulated IMU) in virtual time");
  command->add_flag(
      "--manual", request.manual,
      "the table is turned by hand, whatever the station names: an operator is told what to do (docs/tables.md)");
  command
      ->add_option(
          "--unit", request.units,
          "serial number of the unit; once for each of several on the table, in the order of the station's places")
      ->required()
      ->allow_extra_args(false);
  command->add_option("--out", options->folder, "folder for the results; must not hold a run yet")->required();
  command->add_option("--rig", request.rig, "rig configuration (docs/rig.md); default: the built-in one");
  command->add_option("--sequence", request.sequence, "sequence file; default: the fourteen steps");
  command->add_option("--station", request.station, "station configuration; default: the built-in rig station");
  add_view_options(*command, request);
  command->add_flag("--capture-only", request.capture_only, "record the sequence, do not calibrate");
  command->add_flag("--no-diagnosis", options->no_diagnosis, "leave out the diagnosis at the end");
  add_record_options(*command, request);
  command->callback([options, &context] {
    conclude(begin_run(options->request, options->folder, context), !options->no_diagnosis, context);
  });
}

void add_resume_command(CLI::App& app, CommandContext& context) {
  const auto options = std::make_shared<Options>();
  RunRequest& moved = options->request;
  CLI::App* command =
      app.add_subcommand("resume", "go on with a run that was interrupted, after its last complete dwell");
  command->add_option("folder", options->folder, "the run's folder")->required();
  command->add_option("--unit", moved.units, "the unit (or units) expected there")->allow_extra_args(false);
  command->add_option("--rig", moved.rig, "where the rig configuration is now, if it was moved");
  command->add_option("--sequence", moved.sequence, "where the sequence is now, if it was moved");
  command->add_option("--station", moved.station, "where the station configuration is now, if it was moved");
  command->add_flag("--no-diagnosis", options->no_diagnosis, "leave out the diagnosis at the end");
  add_overdue_option(*command, moved);
  add_view_options(*command, moved);
  command->callback([options, &context] {
    conclude(take_up_run(options->folder, options->request, context), !options->no_diagnosis, context);
  });
}

void add_journal_command(CLI::App& app, CommandContext& context) {
  const auto folder = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("journal", "print the journal of a run, one line a record");
  command->add_option("folder", *folder, "the run's folder")->required();
  command->callback([folder, &context] {
    const Result<std::string> text = journal_as_text(*folder + "/" + journal_name);
    if (!text) return context.fail(text.error());
    const Result<JournalContents> contents = read_journal(*folder + "/" + journal_name);
    const std::string_view tag = contents ? tag_of(*contents) : std::string_view();
    std::istringstream lines(*text);
    for (std::string line; std::getline(lines, line);) context.out << tag << line << '\n';
    context.out << std::flush;
  });
}

}  // namespace turncal
