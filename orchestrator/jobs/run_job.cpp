#include "orchestrator/jobs/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "imu_io/base/clock.h"
#include "imu_io/base/console.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/navigation/verification_job.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/station/child_program.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/station/version.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

std::string recording_of(const RunUnit& unit) { return unit.file(binary_recording_name); }
std::string partial_of(const RunUnit& unit) { return unit.file(partial_recording_name); }

// A recording that was finished but not yet renamed when the run was interrupted. Returns whether there is a sealed one.
Result<bool> sealed_recording(const RunUnit& unit) {
  if (path_exists(recording_of(unit))) return true;
  if (!path_exists(partial_of(unit))) return false;
  const Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(partial_of(unit));
  if (!source || !(*source)->damage().complete) return false;
  TRY(rename_durably(partial_of(unit), recording_of(unit)));
  return true;
}

Error damaged(const LoadedRecording& loaded) {
  return device_error(loaded.path + ": the recording is damaged: " + describe(loaded.damage) +
                      ": no results come of it, the unit has to be measured again");
}

// Every recording was synced whole before the first was finished: what is missing is the end mark.
Status seal_like(const RunUnit& unit, const RunUnit& sealed) {
  const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(recording_of(sealed)));
  RecordingWriter writer = TRY(RecordingWriter::reopen(partial_of(unit), RecordingWriter::OpenSegment::drop));
  if (writer.segments().size() != source->segments().size())
    return input_error("{}: holds {}, expected {} as in {}", partial_of(unit),
                       counted(std::ssize(writer.segments()), "segment"), source->segments().size(),
                       recording_of(sealed));
  TRY(writer.finish());
  return rename_durably(partial_of(unit), recording_of(unit));
}

// Checks the parameter file against the journal; success when no parameters were estimated.
Status check_parameters(const RunUnit& unit, const JournalContents& contents) {
  const JournalFields* const results = contents.newest(contents.results, unit.serial);
  const std::string expected = results != nullptr ? value_of(*results, "parameters_hash") : "";
  if (expected.empty()) return {};
  const std::string path = unit.file(parameters_name);
  const std::string found = hash_of_text(TRY(read_whole_file(path)));
  if (found == expected) return {};
  return device_error(
      fmt::format("{}: is not the file that this run made: expected hash {}, found {}", path, expected, found));
}

// Returns an error, so that nothing is made of it, when the recording is damaged or is not the one that this run sealed for the unit.
Status check_sealed(const LoadedRecording& loaded, const JournalContents& contents, std::size_t unit) {
  const RecordingDamage& damage = loaded.damage;
  if (damage.lost_data() || !damage.complete || damage.torn_tail_bytes > 0) return damaged(loaded);
  const std::string expected = unit < contents.hashes.size() ? contents.hashes[unit] : "";
  if (expected.empty() || loaded.hash == expected) return {};
  return device_error(fmt::format("{}: is not the recording that this run sealed: expected content hash {}, found {}",
                                  loaded.path, expected, loaded.hash));
}

// Completes recordings that were whole when the run was interrupted, one that had no time to be finished among them. False: they are
// not whole, and the run has to go on with devices.
Result<bool> sealed_recordings(const Run& run) {
  const RunUnit* sealed = nullptr;
  std::vector<const RunUnit*> open;
  for (const RunUnit& unit : run.units) {
    if (unit.dropped) continue;
    if (TRY(sealed_recording(unit)))
      sealed = &unit;
    else
      open.push_back(&unit);
  }
  if (!sealed) return false;
  for (const RunUnit* unit : open) TRY(seal_like(*unit, *sealed));
  return true;
}

// Checks a run that is over: its parameter files are those it made; its recordings are as they were sealed, or were pruned, and no
// partial one is left.
Status check_what_is_over(const Run& run, const JournalContents& contents) {
  const std::vector<RunUnit>& units = run.units;
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (units[i].dropped) continue;
    TRY(check_parameters(units[i], contents));
    if (path_exists(partial_of(units[i])))
      return input_error(
          "{}: an unfinished recording beside {} of a complete run: one of the two belongs to another run",
          partial_of(units[i]), journal_name);
    const std::string path = recording_of(units[i]);
    if (path_exists(path)) {
      const LoadedRecording loaded = TRY(load_recording(path));
      TRY(check_sealed(loaded, contents, i));
      continue;
    }
    const Result<std::string> log = read_whole_file(run.folder + "/" + log_name);
    if (!log || log->find(removed_by_prune) == std::string::npos)
      return input_error(
          "{}: is missing, and {} does not say that it was pruned: expected the {} and the recording of one run", path,
          log_name, journal_name);
  }
  return {};
}

// Reads the sealed recordings and what the journal says of them.
Status read_sealed_recordings(Run& run, const JournalContents& contents) {
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    RunUnit& unit = run.units[i];
    if (unit.dropped) continue;
    if (!contents.seal_utc_s || !contents.last_dwell)
      return input_error(unit.folder + ": the recording is complete, but the journal does not say so");
    Result<LoadedRecording> loaded = load_recording(recording_of(unit), {}, {}, run.calibration_ends_before());
    if (!loaded) return device_error(loaded.error().message + " (the recording was whole when it was sealed)");
    const RecordingInfo& info = loaded->data.info;
    if (info.simulated != run.simulated() || info.unit_serial != unit.serial)
      return input_error("{}: the recording is of unit {} and {}, the journal is of another", unit.folder,
                         info.unit_serial, info.simulated ? "simulated" : "real");
    TRY(check_sealed(*loaded, contents, i));
    unit.repeated_dwells = contents.last_dwell->repeated_dwells;
    unit.lost_samples = contents.last_dwell->units[i].lost_samples;
    unit.clock = i < contents.clocks.size() ? contents.clocks[i] : std::nullopt;
    unit.recorded_s = loaded->recorded_s;
    unit.recording = std::move(*loaded);
  }
  return {};
}

std::string and_more(std::size_t found) {
  return found > 1 ? fmt::format("; turncal check shows {} more", found - 1) : "";
}

Status first_of(const std::vector<Error>& found) {
  if (found.empty()) return {};
  return Error{found.front().kind, found.front().message + and_more(found.size())};
}

Status look_ahead(const RunPlan& run, const std::string& folder, double utc_s) {
  if (!run.request.continues.empty())
    if (const auto earlier = recordings_up_to(run.request.continues); !earlier) return earlier.error();
  return first_of(preflight(run, folder, utc_s));
}

std::string first_line(const RunPlan& run) {
  return fmt::format("turncal {}, {} {}, station {}, sequence {}{}", software_version(),
                     run.request.units.size() > 1 ? "units" : "unit", join(run.request.units), run.station.name,
                     run.sequence.name,
                     run.request.dry_run ? fmt::format(", rig seed {}", run.rig.seed)
                     : run.simulated()   ? ", simulated devices"
                                         : "");
}

Status note_attempt(const Run& run, const RunUnit& unit, const std::string& outcome, const Status& why, double utc_s) {
  const std::string records = records_file(run.station);
  if (records.empty()) return {};
  ResultsDatabase database = TRY(ResultsDatabase::open(records));
  AttemptRecord attempt = attempt_record(run, unit);
  attempt.outcome = outcome;
  attempt.time_utc = format_utc(utc_s);
  if (attempt.began_utc.empty()) attempt.began_utc = attempt.time_utc;
  attempt.reason = reason_alone(why, unit.serial, outcome, unit.verdict);
  return stored(database.note(attempt));
}

// Sends rows to the server; a failure is logged and does not hold up a run.
void send_on(Run& run) {
  if (const std::string trouble = send_records(run.station); !trouble.empty()) run.say(trouble);
}

Status note_running(Run& run, double utc_s) {
  for (const RunUnit& unit : run.units)
    if (!unit.dropped) TRY(note_attempt(run, unit, outcome_running, {}, utc_s));
  return {};
}

// Notes a run that was refused before it began. A refusal makes no database, and its reason is reported whether or not it can be noted.
Error refused(const RunPlan& plan, const Error& why, CommandContext& context) {
  auto limit = limit_storage(records_file(plan.station), "run", context);
  const double utc_s = plan.request.dry_run ? plan.rig.start_utc_s : wall_utc_s();
  Run run = run_of(plan, "");
  for (const RunUnit& unit : run.units) {
    if (!path_exists(records_file(run.station))) break;
    if (!note_attempt(run, unit, "refused", why, utc_s)) break;
  }
  limit.reset();
  send_on(run);
  return why;
}

// Notes the outcome of units without a calibration; the others were noted with theirs.
Status note_outcomes(const Run& run) {
  for (const RunUnit& unit : run.units) {
    std::string outcome = outcome_of(run, unit);
    if (unit.ended_utc_s <= 0.0 || (unit.output && !outcome.empty())) continue;
    if (outcome.empty()) {
      const ErrorKind kind = unit.status.error().kind;
      outcome = kind == ErrorKind::aborted ? "aborted" : kind == ErrorKind::interrupted ? "interrupted" : "failed";
    }
    TRY(note_attempt(run, unit, outcome, unit.status, unit.ended_utc_s));
  }
  return {};
}

RunEnd with_units(RunEnd end, const Run& run) {
  for (const RunUnit& unit : run.units) {
    const std::string outcome = outcome_of(run, unit);
    end.units.push_back({unit.serial, unit.folder, outcome, unit.status,
                         reason_alone(unit.status, unit.serial, outcome, unit.verdict)});
  }
  return end;
}

// Notes the outcomes and runs the hooks of every unit; the outcomes do not change by that.
RunEnd conclude(RunEnd end, Run& run, CommandContext& context) {
  for (RunUnit& unit : run.units)
    if (!end.to_the_end && unit.status) unit.status = end.status;
  auto limit = limit_storage(run.folder, resuming(run.folder), context);
  const Status noted = note_outcomes(run);
  limit.reset();
  if (!noted) {
    run.say(noted.error().message);
    if (end.status || end.to_the_end) end.status = noted;
    end.to_the_end = false;
  }
  send_on(run);
  end = with_units(std::move(end), run);
  for (const RunEnd::Unit& unit : end.units)
    if (!unit.outcome.empty()) run.say(outcome_words(unit.serial, unit.outcome, unit.reason));
  for (const RunUnit& unit : run.units) {
    HookCall call = call_for(unit.status);
    call.unit = unit.serial;
    call.folder = unit.folder;
    call.outcome = outcome_of(run, unit);
    if (unit.status && call.outcome == to_string(UnitVerdict::not_judged)) {  // there is no verdict that it is good
      call.event = "needs_operator";
      call.message = outcome_words(call.unit, call.outcome, reason_of(run, unit.verdict));
    }
    call.dry_run = run.request.dry_run;
    if (Status status = run_hook(run.station.hooks, call); !status) run.say(status.error().message);
  }
  return end;
}

// Everything is recorded: no device is needed any more.
RunEnd finish_sealed(Run& run, const JournalContents& contents, CommandContext& context) {
  const double began_s = monotonic_s();
  for (RunUnit& unit : run.units) unit.ended_utc_s = contents.seal_utc_s.value_or(0.0);
  TRY(read_sealed_recordings(run, contents));
  TRY(make_results(run, *contents.seal_utc_s, context));
  print_results(run, monotonic_s() - began_s, context.out);
  return {status_of(run), true};
}

// Marks the units that had dropped out. late: also those after the last completed dwell, which a resumed run takes back.
void mark_dropped(const JournalContents& contents, bool late, std::vector<RunUnit>& units) {
  for (RunUnit& unit : units) {
    unit.dropped = false;
    unit.status = {};
  }
  for (const JournalContents::DroppedUnit& dropped : contents.dropped) {
    if (dropped.place > units.size() || (dropped.after_last_dwell && !late)) continue;
    units[dropped.place - 1].drop(dropped.why);
  }
}

RunEnd say_over(const JournalContents& contents, const std::string& folder, std::ostream& out) {
  RunPlan named;
  named.request = request_of(contents);
  Run run = run_of(named, folder);
  mark_dropped(contents, true, run.units);
  TRY(check_what_is_over(run, contents));
  for (RunUnit& unit : run.units) {
    if (unit.dropped) continue;
    const JournalFields& verdict = *contents.newest(contents.verdicts, unit.serial);
    out << "The run of unit " << unit.serial << " is complete, verdict " << in_words(value_of(verdict, "result"))
        << ": nothing to resume." << std::endl;
    set_texts(verdict, fields_of(unit.verdict));
    unit.status = verdict_status(unit.serial, unit.verdict);
  }
  return with_units({status_of(run), true}, run);
}

// Removes faults of the rig that would strike again, because its time stands where the last dwell ended. Whoever resumes has repaired them.
void repair(const JournalContents& contents, RigConfig& rig) {
  for (const auto& at : contents.failed)
    std::erase_if(rig.faults, [&](const RigFault& fault) {
      const double utc_s = rig.start_utc_s + fault.time_s;
      const bool since_dwell = utc_s >= at.last_dwell_utc_s || fault.kind >= RigFaultKind::chamber_never_settles;
      return !concerns_unit(fault.kind) && since_dwell && utc_s <= at.utc_s;
    });
}

// Returns where a run with a completed dwell resumes; its simulated devices are put back there.
Result<ResumePoint> resume_point(const Run& run, const JournalContents& contents, RunDevices& devices) {
  const CompletedDwell& last = *contents.last_dwell;
  // The journal's commands do not hold the chamber's effect on the unit: it is brought to temperature again, and time passes.
  ResumePoint point{last, devices.rig && !devices.prompts && !devices.chamber};
  for (const RunUnit& unit : run.units) point.dropped.push_back(unit.dropped);
  if (devices.rig) TRY(devices.rig->put_back(contents.commands, last.time_s));
  return point;
}

}  // namespace

std::string_view tag_of(const RunPlan& run) {
  if (run.request.dry_run) return dry_run_tag;
  return run.simulated() ? simulated_tag : std::string_view();
}

std::string_view tag_of(const JournalContents& journal) {
  if (journal.begin_value("simulated") != "true") return {};
  return journal.begin_value("live") == "true" ? simulated_tag : dry_run_tag;
}

Run run_of(RunPlan plan, const std::string& folder) {
  Run run{std::move(plan), folder, {}, 1, {}, {}, {}};
  const std::vector<std::string>& serials = run.request.units;
  const bool alone = serials.size() == 1;
  for (std::size_t i = 0; i < serials.size(); ++i)
    run.units.push_back({.serial = serials[i],
                         .folder = alone ? folder : folder + "/" + name_of_unit(serials[i]),
                         .rig = rig_of_unit(run.rig, i)});
  return run;
}

std::string outcome_of(const Run& run, const RunUnit& unit) {
  const bool measured = unit.recorded_s > 0.0;
  const std::string verdict(to_string(unit.verdict.verdict));
  if (unit.dropped) return unit.status.error().kind == ErrorKind::input && !measured ? "refused" : "dropped";
  if (unit.status) return run.only_captures() ? "captured" : verdict;
  const ErrorKind kind = unit.status.error().kind;
  if (kind == ErrorKind::unit_failed && !is_accepted(unit.verdict.verdict)) return verdict;
  if (kind == ErrorKind::unit_failed || (kind == ErrorKind::input && measured)) return "fail";
  return kind == ErrorKind::input ? "refused" : "";
}

Status status_of(const Run& run) {
  if (run.units.size() == 1) return run.units.front().status;
  Error worst{ErrorKind::input, ""};
  for (const RunUnit& unit : run.units) {
    if (unit.status) continue;
    const Error& error = unit.status.error();
    const ErrorKind kind = unit.dropped ? ErrorKind::device : error.kind;
    if (exit_code(kind) > exit_code(worst.kind)) worst.kind = kind;
    const std::string name = "unit " + unit.serial;
    const bool named = error.message.starts_with(name);
    worst.message += (worst.message.empty() ? "" : "; ") + (named ? "" : name + ": ") + error.message;
  }
  return worst.message.empty() ? Status{} : worst;
}

AttemptRecord attempt_record(const Run& run, const RunUnit& unit) {
  AttemptRecord attempt;
  set_texts(facts_of(run, unit), fields_of(attempt));
  const auto absolute = [](const auto& path) { return std::filesystem::absolute(path).lexically_normal().string(); };
  if (!unit.folder.empty()) attempt.folder = absolute(unit.folder);
  if (!run.request.began_utc.empty()) attempt.run = run.request.began_utc + " " + absolute(run.folder);
  attempt.unit = unit.serial;
  attempt.simulated = run.simulated();
  if (unit.output) {
    attempt.temperature_min_c = unit.output->min_temperature_c;
    attempt.temperature_max_c = unit.output->max_temperature_c;
    attempt.residual = residual_of(unit.output->file);
  }
  attempt.diagnosis = unit.verdict.diagnosis;
  if (unit.recorded_s > 0.0) attempt.recorded_s = unit.recorded_s;
  attempt.sessions = run.sessions;
  return attempt;
}

Status check_goes_on(const Run& run, const JournalContents& contents) {
  if (!contents.last_dwell) return {};
  const std::string path = run.folder + "/" + journal_name;
  const CompletedDwell& last = *contents.last_dwell;
  if (last.item >= run.plan.items.size()) return input_error(path + ": names an item that the plan does not have");
  if (last.units.size() != run.units.size())
    return input_error(path + ": a dwell does not contain all units of the run");
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    const bool left_out = std::ranges::any_of(
        contents.dropped, [i](const auto& dropped) { return dropped.place == i + 1 && !dropped.after_last_dwell; });
    if (left_out || path_exists(recording_of(run.units[i]))) continue;
    TRY(RecordingWriter::check_reopens(partial_of(run.units[i]), last.units[i].next_sample, last.units[i].written));
  }
  return {};
}

Result<std::vector<std::string>> read_recordings(Run& run) {
  std::vector<std::string> hashes;
  for (RunUnit& unit : run.units) {
    hashes.emplace_back();
    if (unit.dropped) continue;
    LoadedRecording loaded = TRY(load_recording(partial_of(unit), {}, {}, run.calibration_ends_before()));
    if (loaded.damage.lost_data()) return damaged(loaded);
    loaded.damage = {};  // the end mark is still to come
    loaded.path = recording_of(unit);
    hashes.back() = loaded.hash;
    unit.recording = std::move(loaded);
  }
  return hashes;
}

Result<std::vector<LoadedRecording>> recordings_up_to(const std::string& folder) {
  const JournalContents contents = TRY(read_journal(folder + "/" + journal_name));
  std::vector<LoadedRecording> recordings;
  if (const std::string& before = contents.begin_value("continues"); !before.empty())
    recordings = TRY(recordings_up_to(before));
  LoadedRecording loaded = TRY(load_recording(folder + "/" + binary_recording_name));
  TRY(check_sealed(loaded, contents, 0));
  recordings.push_back(std::move(loaded));
  return recordings;
}

bool is_over(const JournalContents& journal) {
  if (journal.verdicts.empty()) return false;
  const std::vector<std::string> units = journal.units();
  for (std::size_t i = 0; i < units.size(); ++i) {
    const bool dropped = std::ranges::any_of(journal.dropped, [i](const auto& gone) { return gone.place == i + 1; });
    if (!dropped && !journal.newest(journal.verdicts, units[i])) return false;
  }
  return true;
}

std::vector<Error> sequence_refusals(const RunPlan& run, const std::string& otherwise) {
  std::vector<Error> found;
  const auto add = [&found](const Status& status) {
    if (!status) found.push_back(status.error());
  };
  for (const std::string& violation : run.plan.violations) add(input_error(violation));
  RecordingInfo info = planned_info(run);
  if (run.verified) {
    info.unit_serial = run.unit();
    info.simulated = run.simulated();
    add(check_applicable(*run.verified, run.request.verified, info));
  }
  if (run.request.verify)
    add(check_north_seeking(planned_segments(run.plan), run.verify_from, run.sample_period_s(), run.sequence.file));
  if (run.request.capture_only || run.request.partial || !run.request.continues.empty()) return found;
  Sequence calibrating = run.sequence;
  if (run.verify_from > 0)
    std::erase_if(calibrating.steps, [&](const Step& step) { return step.number >= run.verify_from; });
  const Plan plan = make_plan(calibrating, plan_limits(run.station, run.sample_period_s()));
  const std::vector<std::string> keys = undetermined_by(calibrating, plan, info);
  if (!keys.empty()) add(input_error("sequence " + run.sequence.name + " " + coverage_text(keys) + otherwise));
  return found;
}

Status check_sequence(const RunPlan& run, const std::string& otherwise) {
  return first_of(sequence_refusals(run, otherwise));
}

RunEnd begin_run(const RunRequest& request, const std::string& folder_path, CommandContext& context) {
  if (request.dry_run) context.tag = dry_run_tag;
  RunPlan plan = TRY(plan_run(request));
  context.tag = tag_of(plan);
  const LinePrefix marked(context.out, context.tag);
  if (Status status = check_sequence(plan, in_part); !status) return refused(plan, status.error(), context);
  Result<RunDevices> devices = make_devices(plan, context);
  if (!devices) return refused(plan, devices.error(), context);
  const double utc_s = devices->devices().clock.utc_s();
  if (Status status = look_ahead(plan, folder_path, utc_s); !status) return refused(plan, status.error(), context);

  const StopSignals signals(FirstInterrupt::pauses);  // from here on others see the run and can pause it
  auto limit = limit_storage(folder_path, "run", context);
  Result<OutputFolder> folder = OutputFolder::prepare(
      folder_path,
      {binary_recording_name, partial_recording_name, parameters_name, truth_name, log_name, journal_name});
  if (!folder) return refused(plan, folder.error(), context);
  plan.request.began_utc = format_utc(utc_s);
  Run run = run_of(std::move(plan), folder->path());
  std::vector<OutputFolder> unit_folders;
  for (std::size_t i = 0; run.units.size() > 1 && i < run.units.size(); ++i)
    unit_folders.push_back(TRY(OutputFolder::prepare(
        run.units[i].folder, {binary_recording_name, partial_recording_name, parameters_name, truth_name})));
  run.journal = TRY(JournalFile::create(folder->file(journal_name), begin_fields(run)));
  run.log = TRY(RunLog::create(folder->file(log_name), std::string(tag_of(run))));
  run.say(first_line(run));
  TRY(note_running(run, utc_s));
  limit.reset();
  send_on(run);

  RunEnd end = record_run(run, *devices, context);
  const bool interrupted = !end.status && end.status.error().kind == ErrorKind::interrupted;  // can be resumed
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    if (run.units[i].recorded_s <= 0.0 && !interrupted && !end.moved) continue;
    folder->keep();
    if (!unit_folders.empty()) unit_folders[i].keep();
  }
  return conclude(std::move(end), run, context);
}

RunEnd resume_run(const std::string& folder, const RunRequest& now, CommandContext& context) {
  const std::string path = folder + "/" + journal_name;
  if (!path_exists(path)) return input_error(folder + ": holds no " + journal_name + ": expected the folder of a run");
  const StopSignals signals(FirstInterrupt::pauses);     // from here on others see the run and can pause it
  JournalFile journal = TRY(JournalFile::reopen(path));  // locked, so that nobody else resumes this run
  const LockFile held = TRY(hold_folder(folder));
  const JournalContents contents = TRY(read_journal(path));
  context.tag = tag_of(contents);
  const LinePrefix marked(context.out, context.tag);
  const RunRequest request = TRY(request_again(contents, now));
  if (is_over(contents)) return say_over(contents, folder, context.out);
  Run run = run_of(TRY(plan_run(request)), folder);
  run.sessions = contents.sessions + 1;
  run.journal = std::move(journal);
  context.tag = tag_of(run);
  TRY(check_unchanged(run, contents));
  run.log = TRY(RunLog::append(folder + "/" + log_name, std::string(tag_of(run))));

  mark_dropped(contents, true, run.units);
  if (TRY(sealed_recordings(run))) return conclude(finish_sealed(run, contents, context), run, context);

  mark_dropped(contents, false, run.units);
  if (!run.plan.ok()) return input_error(run.plan.violations.front() + and_more(run.plan.violations.size()));
  TRY(check_goes_on(run, contents));
  repair(contents, run.rig);
  RunDevices devices = TRY(make_devices(run, context));
  std::string what = "no dwell was complete: starts again from the beginning";
  if (contents.last_dwell) {
    run.resume = TRY(resume_point(run, contents, devices));
    what = "goes on after item " + std::to_string(contents.last_dwell->item + 1) + " of " +
           std::to_string(run.plan.items.size());
  } else {
    std::error_code ignored;
    for (const RunUnit& unit : run.units) {
      std::filesystem::create_directories(unit.folder, ignored);
      std::filesystem::remove(unit.file(partial_recording_name), ignored);
    }
  }
  const double utc_s = devices.devices().clock.utc_s();
  TRY(look_ahead(run, folder, utc_s));
  if (contents.last_dwell && utc_s < contents.last_dwell->utc_s - ClockWatch::step_s)
    what +=
        "; the clock was set back: it stands before the end of that item, " + format_utc(contents.last_dwell->utc_s);
  auto limit = limit_storage(folder, resuming(folder), context);
  TRY(run.journal->append(
      JournalType::resume,
      {{"software_version", software_version()}, {"what", what}, {"overdue_reason", run.request.overdue_reason}}));
  run.say("resumed by turncal " + std::string(software_version()) + ": " + what);
  if (const std::string warning = contents.table_warning(); !warning.empty()) context.warn(warning);
  TRY(note_running(run, utc_s));
  limit.reset();
  send_on(run);
  return conclude(record_run(run, devices, context), run, context);
}

}  // namespace turncal
