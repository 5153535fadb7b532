// `turncal run`, `resume`, `journal` (orchestrator/jobs/run.h); `batch`, `queue`.
// A batch continues with the next unit after one that fails, drops out while others go on, or is not the one on the table. A fault of table, link
// or disk, and the operator, even by a pause, stop it; the same command goes on with the units that were interrupted.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "imu_io/base/console.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/records/unit_queue.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/station/child_program.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

struct RunOptions {
  RunRequest request;
  std::string folder;
};

Status run(const RunOptions& options, CommandContext& context) {
  if (!options.request.continues.empty()) {
    const RunRequest further = TRY(continuing(options.request));
    const std::string& out = options.folder;
    return begin_run(further, out.empty() ? further.continues + "/continued" : out, context).status;
  }
  if (options.request.units.empty()) return input_error("--unit is required: the serial number of the unit");
  if (options.folder.empty()) return input_error("--out is required: the folder for the results");
  const RunEnd end = begin_run(options.request, options.folder, context);
  const std::string page = options.folder + "/" + diagnosis_folder + "/" + report_name;
  if (end.units.empty() || !options.request.dry_run || !path_exists(page)) return end.status;
  context.out << dry_run_tag << "open " << shell_path(page) << "\n";
  if (end.status)
    context.out << dry_run_tag << "next: turncal navigate " << shell_path(options.folder) << " --parameters "
                << shell_path(options.folder + "/" + parameters_name) << " --out "
                << shell_path(options.folder + "-navigated") << "\n";
  return end.status;
}

Status resume(const RunOptions& options, CommandContext& context) {
  return resume_run(options.folder, options.request, context).status;
}

struct JournalOptions {
  std::string folder, format;
};

Status print_journal(const JournalOptions& options, CommandContext& context) {
  const std::string path = options.folder + "/" + journal_name;
  if (!options.format.empty()) {
    context.out << TRY(journal_as_table(path)).as(options.format) << std::flush;
    return {};
  }
  const std::string text = TRY(journal_as_text(path));
  const Result<JournalContents> contents = read_journal(path);
  const LinePrefix marked(context.out, std::string(contents ? tag_of(*contents) : ""));
  context.out << text << std::flush;
  return {};
}

struct BatchOptions {
  std::string queue, out;
  std::size_t at_once = 1;
  bool mount_again = false;
  RunRequest request;
};

// Returns the folder of a unit: a repeated one gets a folder of its own, NAME, NAME.2, NAME.3 ..., the first without a whole recording.
std::string folder_for(const std::string& out, const std::string& unit, const UnitOutcome* before) {
  const std::string name = out + "/" + name_of_unit(unit);
  std::string folder = name;
  for (int i = 2; before && path_exists(folder + "/" + binary_recording_name); ++i)
    folder = name + "." + std::to_string(i);
  return folder;
}

struct Turn {
  std::vector<std::string> units;
  std::string folder;
};

// Returns the folder of a run of several units: OUT/group.1, group.2, ...; the last of these may have been interrupted.
std::string group_folder(const std::string& out, int number) { return fmt::format("{}/group.{}", out, number); }

int last_group(const std::string& out) {
  int last = 0;
  while (path_exists(group_folder(out, last + 1))) ++last;
  return last;
}

Result<Turn> next_turn(const BatchOptions& options) {
  const std::vector<std::string> queue = TRY(read_queue(options.queue));
  const std::vector<UnitOutcome> outcomes = TRY(read_outcomes(options.queue));
  const std::vector<std::string> to_do = next_units(queue, outcomes, queue.size());
  // The newest run that was begun and is not done comes first: its units are on the table.
  std::vector<std::string> folders = {group_folder(options.out, last_group(options.out))};
  for (const std::string& unit : to_do) folders.push_back(folder_for(options.out, unit, find_outcome(outcomes, unit)));
  for (const std::string& folder : runs_newest_first(folders)) {
    const JournalContents journal = TRY(read_journal(folder + "/" + journal_name));
    // A run that is over has told the queue of all its units, unless it was interrupted just then.
    const auto waits = [&, over = is_over(journal)](const std::string& unit) {
      return holds(to_do, unit) && (!over || !find_outcome(outcomes, unit));
    };
    const std::vector<std::string> units = journal.units();
    if (std::ranges::any_of(units, waits)) return Turn{units, folder};
  }
  Turn turn{next_units(queue, outcomes, options.at_once), ""};
  if (turn.units.size() == 1)
    turn.folder = folder_for(options.out, turn.units.front(), find_outcome(outcomes, turn.units.front()));
  else
    turn.folder = group_folder(options.out, last_group(options.out) + 1);
  return turn;
}

// Returns a note when a run that was begun goes on with its own sequence, not with the requested one; empty: they are the same.
std::string another_sequence(const RunPlan& asked, const std::string& folder) {
  const Result<JournalContents> journal = read_journal(folder + "/" + journal_name);
  if (!journal || journal->begin_value("sequence_hash") == asked.hashes.sequence) return "";
  const std::string began = journal->begin_value("sequence");
  if (began == asked.request.sequence) return "";  // a changed file, which the run itself refuses
  const auto called = [](const std::string& file) { return file.empty() ? "the fourteen steps" : file; };
  return fmt::format("goes on with the sequence that it began with, {}, not with {}", called(began),
                     called(asked.request.sequence));
}

// Performs one run and records the outcome of each unit. `asked`: the plan for any unit of the batch.
Status run_turn(const BatchOptions& options, const RunPlan& asked, const Turn& turn, const std::string& tag,
                CommandContext& context) {
  const std::string name = (turn.units.size() > 1 ? "units " : "unit ") + join(turn.units);
  RunRequest request = options.request;
  request.units = turn.units;
  request.session.brief = !request.session.verbose;
  request.session.part = true;
  if (!request.session.brief) context.out << tag << name << " in " << turn.folder << std::endl;
  RunRequest resumed;
  resumed.session = request.session;
  const bool begun = path_exists(turn.folder + "/" + journal_name);
  if (const std::string other = begun ? another_sequence(asked, turn.folder) : ""; !other.empty())
    for (const std::string& unit : turn.units) context.out << tag << "unit " << unit << ": " << other << std::endl;
  RunEnd end = begun ? resume_run(turn.folder, resumed, context) : begin_run(request, turn.folder, context);
  if (!end.to_the_end) {
    // A refusal before anything was measured, such as the wrong unit on the table, concerns the unit. Anything else concerns the station, and so does
    // what stopped it before there was a run: a table overdue since midnight is no fault of the units that wait.
    const bool refused = !begun && !end.units.empty() && end.status.error().kind == ErrorKind::input &&
                         std::ranges::all_of(end.units, [](const auto& unit) { return unit.outcome == "refused"; });
    if (!refused) {
      // Nobody is there, and what stopped the batch came before there was a run that could tell.
      const HookCall call{"", join(turn.units), turn.folder, "", "", request.dry_run};
      if (end.units.empty()) call_operator(asked.station.hooks, call, end.status.error(), context.out, tag);
      return Error{end.status.error().kind, name + ": " + end.status.error().message};
    }
    end.units.clear();
    for (const std::string& unit : turn.units)
      end.units.push_back({unit, turn.folder, "refused", end.status, end.status.error().message});
  }
  Status stops;
  const std::string time_utc = format_utc(wall_utc_s());  // one for the run, by which its units are known
  for (const RunEnd::Unit& unit : end.units) {
    if (unit.outcome.empty()) {
      stops = Error{unit.status.error().kind, "unit " + unit.serial + ": " + unit.status.error().message};
      continue;
    }
    TRY(record_outcome(options.queue, {unit.serial, unit.outcome, time_utc, unit.reason}));
    context.out << tag << outcome_words(unit.serial, unit.outcome, unit.reason)
                << (path_exists(unit.folder) ? "; " + unit.folder : "") << std::endl;
  }
  return stops;
}

// Returns false when a unit was skipped, which changes the turn.
Result<bool> mount_units(const BatchOptions& options, const StationConfig& station, const Turn& turn,
                         const std::string& tag, CommandContext& context) {
  const auto last = newest_run(options.out);  // whose units stay on the table if it was paused or told to end
  const Result<JournalContents> before = read_journal((last ? last->path : turn.folder) + "/" + journal_name);
  const std::string warning = before ? before->table_warning() : "";
  const Result<JournalContents> journal = read_journal(turn.folder + "/" + journal_name);
  if (options.request.dry_run || (journal && is_over(*journal))) return true;  // nothing is left to measure
  const bool stays = !options.mount_again && last && std::filesystem::path(last->path) == turn.folder &&
                     warning.empty() && (!journal->ended || journal->ended == RunState::interrupted);
  const std::vector<UnitOutcome> outcomes = TRY(read_outcomes(options.queue));
  const std::string waited_for = mounting_file(options.queue);
  for (const std::string& unit : turn.units) {
    HookCall call{"mount", unit, turn.folder, warning};
    const bool there = stays && !find_outcome(outcomes, unit);
    if (there) call.message = "it is still on the table: its run was interrupted";
    TRY(write_file_atomically(waited_for, unit + "\n" + call.message));
    const auto mounted = mount_unit(station, call, there, context.quiet ? -1 : STDIN_FILENO, context.out, tag);
    ::unlink(waited_for.c_str());
    if (!mounted) return mounted.error();
    if (!mounted->skipped) continue;
    TRY(record_outcome(options.queue, {unit, "skipped", format_utc(wall_utc_s()), *mounted->skipped}));
    context.out << tag << "unit " << unit << ": skipped: " << *mounted->skipped << std::endl;
    return false;
  }
  return true;
}

Status run_batch(const BatchOptions& options, CommandContext& context) {
  if (options.request.dry_run) context.tag = dry_run_tag;
  RunRequest check = options.request;
  check.units = {"X"};
  const RunPlan prepared = TRY(plan_run(check));
  context.tag = tag_of(prepared);
  if (options.at_once > places(prepared))
    return input_error("--at-once {}: expected at most {}, the places on the table", options.at_once, places(prepared));
  TRY(check_sequence(prepared));
  const LockFile queue = TRY(hold_queue(options.queue));
  const std::string tag = context.tag + "[batch] ";
  for (;;) {
    const Turn turn = TRY(next_turn(options));
    if (turn.units.empty()) break;
    if (!TRY(mount_units(options, prepared.station, turn, tag, context))) continue;
    TRY(run_turn(options, prepared, turn, tag, context));
    if (StopSignals::any())  // requested while the results were made
      return Error{ErrorKind::interrupted,
                   "paused after unit " + join(turn.units) + "; the same command continues with the next"};
  }
  // Counts the whole queue, whichever command measured the units.
  const std::vector<std::string> queue_done = TRY(read_queue(options.queue));
  const std::vector<UnitOutcome> outcomes = TRY(read_outcomes(options.queue));
  std::map<Standing, int> units;
  for (const std::string& unit : queue_done) ++units[standing_of(find_outcome(outcomes, unit))];
  const int passed = units[Standing::passed], unjudged = units[Standing::unjudged],
            others = units[Standing::not_passed];
  context.out << fmt::format("{}queue done: {} passed, {}{} not passed\n", tag, passed,
                             unjudged > 0 ? fmt::format("{} without a verdict, ", unjudged) : "", others)
              << std::flush;
  if (others == 0) return {};
  return Error{ErrorKind::unit_failed,
               fmt::format("{} of {} did not pass; see turncal queue {}", counted(others, "unit"),
                           passed + unjudged + others, shell_path(options.queue))};
}

struct QueueOptions {
  std::string queue, format;
  QueueChange change;
};

Status show_queue(const QueueOptions& options, CommandContext& context) {
  std::ostream& out = context.out;
  const QueueChange& change = options.change;
  if (!change.add.empty() || !change.remove.empty() || !change.again.empty()) TRY(change_queue(options.queue, change));
  const std::vector<std::string> queue = TRY(read_queue(options.queue));
  const std::vector<UnitOutcome> outcomes = TRY(read_outcomes(options.queue));
  if (!options.format.empty()) {
    DataTable table({"unit", "outcome", "time_utc", "reason"});
    for (const std::string& unit : queue) {
      const UnitOutcome* outcome = find_outcome(outcomes, unit);
      if (outcome)
        table.row({unit, outcome->outcome, outcome->time_utc, outcome->reason});
      else
        table.row({unit, "waits", {}, {}});
    }
    out << table.as(options.format) << std::flush;
    return {};
  }
  for (const std::string& unit : queue) {
    const UnitOutcome* outcome = find_outcome(outcomes, unit);
    out << unit << "  " << (outcome ? in_words(outcome->outcome) + " " + outcome->time_utc : "waits")
        << (outcome && !outcome->reason.empty() ? ": " + outcome->reason : "") << '\n';
  }
  return {};
}

}  // namespace

void add_record_option(const Command& command, const RecordWord& record, RunRequest& request) {
  command.option(record.option, request.*record.word, record.help);
}

void add_record_options(const Command& command, RunRequest& request) {
  for (const RecordWord& record : record_words) add_record_option(command, record, request);
}

void add_watch_options(const Command& command, RunRequest& request) {
  command.option("--listen", request.session.listen,
                 "serve a read-only status page at this address (127.0.0.1:8080; port 0: any free port)");
  command.option("--pace", request.session.pace, {is::positive},
                 "run a dry run at most this many times as fast as the wall clock");
  command.flag("--verbose", request.session.verbose, "print every transition, as in run.log");
}

// Adds the options of a run, and of each run of a batch.
void add_run_options(const Command& command, RunRequest& request) {
  command.flag("--dry-run", request.dry_run, "simulate table and unit, in virtual time");
  command.option("--rig", request.rig, "rig configuration (docs/rig.md); default: the built-in one");
  command.option("--sequence", request.sequence, "sequence file; default: the fourteen steps");
  command.option("--station", request.station, "station configuration; default: the built-in rig station");
  command.option("--temperature", request.temperature_c,
                 "bring the station's chamber to this temperature first, degrees C (docs/thermal.md); default: "
                 "chamber.temperature_c of the station");
  command.flag("--verify", request.verify, "seek north with the new parameters after the calibration");
  command.flag(
      "--until-sigma", request.until_sigma,
      "end as soon as the sigmas are small enough for the station's stop.sigma.* and limit.* (docs/sequences.md)");
  command.option(
      "--settle", request.settle_minutes, {is::time(0.0, 60.0, "min")},
      "time that the run may add to tell confounded effects apart (docs/sequences.md); default: settle.minutes of "
      "the station");
  add_record_options(command, request);
  add_watch_options(command, request);
}

void add_run_command(CommandLine& line) {
  const auto [command, options] = line.command<RunOptions>(
      "run", "run a calibration: move the table, record the unit, estimate its parameters", run);
  RunRequest& request = options.request;
  command.flag("--manual", request.manual, "turn the table by hand: the operator is told what to do (docs/tables.md)");
  command.option("--unit", request.units, {is::one_word_each},
                 "serial number of the unit; repeat it for several units, in the order of the station's places");
  command.option("--out", options.folder, "folder for the results; must not contain a run yet");
  command.option("--continue", request.continues,
                 "folder of an earlier run of the unit: record more, and diagnose both recordings together "
                 "(docs/sequences.md); default of --out: DIR/continued");
  command.flag("--capture-only", request.capture_only, "record the sequence, do not calibrate");
  command.flag("--partial", request.partial,
               "estimate only the parameters that the sequence determines; the unit gets no verdict, and the file is "
               "not put in use");
  command.flag("--no-diagnosis", options.request.no_diagnosis, "skip the diagnosis at the end");
  add_run_options(command, request);
}

void add_resume_command(CommandLine& line) {
  const auto [command, options] =
      line.command<RunOptions>("resume", "resume an interrupted run after its last complete dwell", resume);
  RunRequest& moved = options.request;
  command.option("folder", options.folder, {is::required}, "the run's folder");
  command.option("--unit", moved.units, {is::one_word_each},
                 "serial number expected on the table; repeat it for several units");
  command.option("--rig", moved.rig, "rig configuration, if it was moved");
  command.option("--sequence", moved.sequence, "sequence, if it was moved");
  command.option("--station", moved.station, "station configuration, if it was moved");
  command.flag("--no-diagnosis", options.request.no_diagnosis, "skip the diagnosis at the end");
  add_record_option(command, overdue_word, moved);
  add_watch_options(command, moved);
}

void add_journal_command(CommandLine& line) {
  const auto [command, options] =
      line.command<JournalOptions>("journal", "print the journal of a run, one line a record", print_journal);
  command.option("folder", options.folder, {is::required}, "the run's folder");
  command.format(options.format, "print every field of every record in this form");
}

void add_batch_command(CommandLine& line) {
  const auto [command, options] =
      line.command<BatchOptions>("batch", "calibrate the units of a queue one after the other, unattended", run_batch);
  RunRequest& request = options.request;
  command.option("queue", options.queue, {is::required}, "file with one serial number a line");
  command.option("--out", options.out, {is::required}, "folder for the units' folders");
  command.option("--at-once", options.at_once, {is::in(1, 16)}, "units on the table at the same time; default: 1");
  command.flag("--mount-again", options.mount_again,
               "ask for the unit of an interrupted run to be mounted, as if it had been taken off");
  add_run_options(command, request);
}

void add_queue_command(CommandLine& line) {
  const auto [command, options] =
      line.command<QueueOptions>("queue", "show or change the queue of a batch, also while it runs", show_queue);
  command.option("queue", options.queue, {is::required}, "file with one serial number a line");
  command.option("--add", options.change.add, "serial numbers to add at the end");
  command.option("--remove", options.change.remove, "serial numbers to remove");
  command.option("--again", options.change.again, "serial numbers to calibrate again");
  command.format(options.format, "print the queue in this form");
}

}  // namespace turncal
