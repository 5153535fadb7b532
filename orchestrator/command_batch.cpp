#include "orchestrator/command_batch.h"

#include <unistd.h>

#include <chrono>
#include <memory>

#include "imu_io/clock.h"
#include "imu_io/posix_file.h"
#include "imu_io/recording_writer.h"
#include "orchestrator/command_run.h"
#include "orchestrator/mounting.h"
#include "orchestrator/parameter_store.h"
#include "orchestrator/command_diagnose.h"
#include "orchestrator/run_job.h"
#include "orchestrator/run_results.h"
#include "orchestrator/stop_signals.h"
#include "orchestrator/unit_queue.h"

namespace turncal {

namespace {

struct BatchOptions {
  std::string queue, out;
  RunRequest request;
};

std::string now_utc() {
  return format_utc(std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count());
}

// A unit that is done again gets a folder of its own: NAME, NAME.2, NAME.3 ..., the first without a whole recording.
std::string folder_for(const std::string& out, const std::string& unit, const UnitOutcome* before) {
  const std::string name = out + "/" + name_of_unit(unit);
  std::string folder = name;
  for (int i = 2; before && path_exists(folder + "/" + binary_recording_name); ++i) folder = name + "." + std::to_string(i);
  return folder;
}

// What is to be said of a unit, or the error that stops the batch.
Result<std::string> outcome_of(const Status& run) {
  if (run) return std::string("pass");
  switch (run.error().kind) {
    case ErrorKind::unit_failed: return std::string("fail");
    case ErrorKind::input: return std::string("refused");  // the station's own files were checked before the first unit
    case ErrorKind::aborted:
    case ErrorKind::device:
    case ErrorKind::internal:
    case ErrorKind::interrupted: break;
  }
  return run.error();
}

Status run_batch(const BatchOptions& options, CommandContext& context) {
  if (options.request.dry_run) context.tag = dry_run_tag;
  RunRequest check = options.request;
  check.unit = "X";
  const Result<PreparedRun> prepared = prepare(check);
  if (!prepared) return prepared.error();
  const std::string tag = options.request.dry_run ? "[dry run] [batch] " : "[batch] ";
  int passed = 0, not_passed = 0;
  for (;;) {
    const Result<std::vector<std::string>> queue = read_queue(options.queue);
    if (!queue) return queue.error();
    const Result<std::vector<UnitOutcome>> outcomes = read_outcomes(options.queue);
    if (!outcomes) return outcomes.error();
    const std::optional<std::string> unit = next_unit(*queue, *outcomes);
    if (!unit) break;
    const std::string folder = folder_for(options.out, *unit, find_outcome(*outcomes, *unit));
    context.out << tag << "unit " << *unit << " in " << folder << std::endl;
    if (!options.request.dry_run) {
      const Result<Mounted> mounted = mount_unit(prepared->station, *unit, folder, STDIN_FILENO, context.out, tag);
      if (!mounted) return mounted.error();
      if (mounted->skipped) {
        if (Status status = record_outcome(options.queue, {*unit, "skipped", now_utc(), *mounted->skipped}); !status) return status;
        context.out << tag << "unit " << *unit << ": skipped: " << *mounted->skipped << std::endl;
        ++not_passed;
        continue;
      }
    }
    RunRequest request = options.request;
    request.unit = *unit;
    RunRequest resumed;
    resumed.listen = request.listen;
    resumed.pace = request.pace;
    const Status run = path_exists(folder + "/" + journal_name) ? take_up_run(folder, resumed, context)
                                                                 : begin_run(request, folder, context);
    const Result<std::string> outcome = outcome_of(run);
    if (!outcome) return Error{outcome.error().kind, "unit " + *unit + ": " + outcome.error().message};
    if (Status status = record_outcome(options.queue, {*unit, *outcome, now_utc()}); !status) return status;
    diagnose_run(folder, run, context);
    context.out << tag << "unit " << *unit << ": " << *outcome << (run ? "" : ": " + run.error().message) << std::endl;
    ++(run ? passed : not_passed);
    if (StopSignals::any()) {  // asked for when the unit's results were being made
      return Error{ErrorKind::interrupted, "paused behind unit " + *unit + "; the same command goes on with the next"};
    }
  }
  context.out << tag << "queue done: " << passed << " passed, " << not_passed << " not" << std::endl;
  if (not_passed == 0) return {};
  return Error{ErrorKind::unit_failed, std::to_string(not_passed) + " of " + std::to_string(passed + not_passed) +
                                           " units did not pass; see turncal queue " + options.queue};
}

struct QueueOptions {
  std::string queue;
  QueueChange change;
};

Status show_queue(const QueueOptions& options, std::ostream& out) {
  const QueueChange& change = options.change;
  if (!change.add.empty() || !change.remove.empty() || !change.again.empty()) {
    if (Status status = change_queue(options.queue, change); !status) return status;
  }
  const Result<std::vector<std::string>> queue = read_queue(options.queue);
  if (!queue) return queue.error();
  const Result<std::vector<UnitOutcome>> outcomes = read_outcomes(options.queue);
  if (!outcomes) return outcomes.error();
  for (const std::string& unit : *queue) {
    const UnitOutcome* outcome = find_outcome(*outcomes, unit);
    out << unit << "  " << (outcome ? outcome->outcome + " " + outcome->time_utc : "waits") << (outcome && !outcome->reason.empty() ? ": " + outcome->reason : "") << '\n';
  }
  return {};
}

}  // namespace

void add_batch_command(CLI::App& app, CommandContext& context) {
  const auto options = std::make_shared<BatchOptions>();
  RunRequest& request = options->request;
  CLI::App* command = app.add_subcommand("batch", "calibrate the units of a queue, one after the other, unattended");
  command->add_option("queue", options->queue, "file with one serial number a line")->required();
  command->add_option("--out", options->out, "folder for the units' folders")->required();
  command->add_flag("--dry-run", request.dry_run, "use the built-in rig (mock table, simulated IMU) in virtual time");
  command->add_option("--rig", request.rig, "rig configuration; default: the built-in one");
  command->add_option("--sequence", request.sequence, "sequence file; default: the fourteen steps");
  command->add_option("--station", request.station, "station configuration; default: the built-in rig station");
  add_record_options(*command, request);
  add_view_options(*command, request);
  command->callback([options, &context] {
    if (Status status = run_batch(*options, context); !status) context.fail(status.error());
  });
}

void add_queue_command(CLI::App& app, CommandContext& context) {
  const auto options = std::make_shared<QueueOptions>();
  CLI::App* command = app.add_subcommand("queue", "show a batch's queue, add and remove units; also while it runs");
  command->add_option("queue", options->queue, "file with one serial number a line")->required();
  command->add_option("--add", options->change.add, "serial numbers to add at the end");
  command->add_option("--remove", options->change.remove, "serial numbers to take out");
  command->add_option("--again", options->change.again, "serial numbers whose outcome is forgotten: they are done again");
  command->callback([options, &context] {
    if (Status status = show_queue(*options, context.out); !status) context.fail(status.error());
  });
}

}  // namespace turncal
