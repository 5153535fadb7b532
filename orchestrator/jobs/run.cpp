#include "orchestrator/jobs/run.h"

#include <algorithm>
#include <filesystem>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/parameter_store.h"

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
    return input_error(partial_of(unit) + ": holds " + std::to_string(writer.segments().size()) +
                       " segments, expected " + std::to_string(source->segments().size()) + " as in " +
                       recording_of(sealed));
  TRY(writer.finish());
  return rename_durably(partial_of(unit), recording_of(unit));
}

// Nothing when no parameters came of it.
Status check_parameters(const RunUnit& unit, const JournalContents& contents) {
  const JournalFields* const results = contents.results_of(unit.serial);
  const std::string expected = results != nullptr ? value_of(*results, "parameters_hash") : "";
  if (expected.empty()) return {};
  const std::string path = unit.file(parameters_name);
  const std::string text = TRY(read_whole_file(path));
  const std::string found = hash_of_text(text);
  if (found == expected) return {};
  return device_error(path + ": is not the file that this run made: expected hash " + expected + ", found " + found);
}

// An error when it is damaged, or not the one that the run of this journal sealed for that unit: nothing may be made of it.
Status check_sealed(const LoadedRecording& loaded, const JournalContents& contents, std::size_t unit) {
  const RecordingDamage& damage = loaded.damage;
  if (damage.lost_data() || !damage.complete || damage.torn_tail_bytes > 0) return damaged(loaded);
  const std::string expected = unit < contents.hashes.size() ? contents.hashes[unit] : "";
  if (expected.empty() || loaded.hash == expected) return {};
  return device_error(loaded.path + ": is not the recording that this run sealed: expected content hash " + expected +
                      ", found " + loaded.hash);
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
                         .rig = rig_of_unit(run.rig, i),
                         .mark = alone ? JournalFields{} : JournalFields{{"unit", serials[i]}}});
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
  if (!unit.folder.empty()) attempt.folder = std::filesystem::absolute(unit.folder).lexically_normal().string();
  // A run of several units has a folder for each.
  if (!run.began_utc.empty()) attempt.run = run.began_utc + " " + attempt.folder;
  attempt.unit = unit.serial;
  attempt.began_utc = run.began_utc;
  attempt.simulated = run.simulated();
  attempt.station = run.station.name;
  for (const RecordWord& record : record_words)
    for (const Field& field : fields_of(attempt))
      if (field.key == record.key) static_cast<void>(set_text(field, run.request.*record.word));
  if (unit.output) {
    attempt.temperature_min_c = unit.output->min_temperature_c;
    attempt.temperature_max_c = unit.output->max_temperature_c;
    if (const std::string* const residual = find_further(unit.output->file, "quality.normalised_rms"))
      attempt.residual = parse_number(*residual);
  }
  attempt.diagnosis = unit.verdict.diagnosis;
  if (unit.recorded_s > 0.0) attempt.recorded_s = unit.recorded_s;
  attempt.sessions = run.sessions;
  attempt.repeated_dwells = unit.repeated_dwells;
  attempt.lost_samples = static_cast<std::int64_t>(unit.lost_samples);
  return attempt;
}

Result<bool> sealed_recordings(const Run& run) {
  const RunUnit* sealed = nullptr;
  std::vector<const RunUnit*> open;
  for (const RunUnit& unit : run.units) {
    if (unit.dropped) continue;
    const bool is_sealed = TRY(sealed_recording(unit));
    if (is_sealed)
      sealed = &unit;
    else
      open.push_back(&unit);
  }
  if (!sealed) return false;
  for (const RunUnit* unit : open) TRY(seal_like(*unit, *sealed));
  return true;
}

Status check_goes_on(const Run& run, const JournalContents& contents) {
  if (!contents.last_dwell) return {};
  const std::string path = run.folder + "/" + journal_name;
  const CompletedDwell& last = *contents.last_dwell;
  if (last.item >= run.plan.items.size()) return input_error(path + ": names an item that the plan does not have");
  if (last.units.size() != run.units.size()) return input_error(path + ": a dwell is not of all units of the run");
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    const bool left_out = std::ranges::any_of(
        contents.dropped, [i](const auto& dropped) { return dropped.unit == i && !dropped.after_last_dwell; });
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

Status check_what_is_over(const Run& run, const JournalContents& contents) {
  const std::vector<RunUnit>& units = run.units;
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (units[i].dropped) continue;
    TRY(check_parameters(units[i], contents));
    if (path_exists(partial_of(units[i])))
      return input_error(partial_of(units[i]) + ": expected no recording that goes on beside " + journal_name +
                         " of a run that is complete: one of them is of another run");
    const std::string path = recording_of(units[i]);
    if (path_exists(path)) {
      const LoadedRecording loaded = TRY(load_recording(path));
      TRY(check_sealed(loaded, contents, i));
      continue;
    }
    const Result<std::string> log = read_whole_file(run.folder + "/" + log_name);
    if (!log || log->find(removed_by_prune) == std::string::npos)
      return input_error(path + ": is missing, and " + log_name + " does not say that it was pruned: expected the " +
                         journal_name + " and the recording of one run");
  }
  return {};
}

Status read_sealed_recordings(Run& run, const JournalContents& contents) {
  for (std::size_t i = 0; i < run.units.size(); ++i) {
    RunUnit& unit = run.units[i];
    if (unit.dropped) continue;
    if (!contents.seal_utc_s || !contents.last_dwell)
      return input_error(unit.folder + ": the recording is complete, but the journal knows nothing of it");
    Result<LoadedRecording> loaded = load_recording(recording_of(unit), {}, {}, run.calibration_ends_before());
    if (!loaded) return device_error(loaded.error().message + " (the recording was whole when it was sealed)");
    const RecordingInfo& info = loaded->data.info;
    if (info.simulated != run.simulated() || info.unit_serial != unit.serial)
      return input_error(unit.folder + ": the recording is of unit " + info.unit_serial + " and " +
                         (info.simulated ? "simulated" : "real") + ", the journal is of another");
    TRY(check_sealed(*loaded, contents, i));
    unit.repeated_dwells = contents.last_dwell->repeated_dwells;
    unit.lost_samples = contents.last_dwell->units[i].lost_samples;
    unit.clock = i < contents.clocks.size() ? contents.clocks[i] : std::nullopt;
    unit.recorded_s = loaded->recorded_s;
    unit.recording = std::move(*loaded);
  }
  return {};
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

}  // namespace turncal
