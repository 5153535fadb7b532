#include "orchestrator/jobs/unit_run.h"

#include <algorithm>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/run_attempt.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/records/recording_sink.h"

namespace turncal {

namespace {

std::string recording_of(const UnitRun& unit) { return unit.folder + "/" + binary_recording_name; }
std::string partial_of(const UnitRun& unit) { return unit.folder + "/" + partial_recording_name; }

// A recording that was finished but not yet renamed when the run was interrupted. Returns whether there is a sealed one.
Result<bool> sealed_recording(const UnitRun& unit) {
  if (path_exists(recording_of(unit))) return true;
  if (!path_exists(partial_of(unit))) return false;
  const Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(partial_of(unit));
  if (!source || !(*source)->damage().complete) return false;
  TRY(rename_durably(partial_of(unit), recording_of(unit)));
  return true;
}

Error damaged(const LoadedRecording& loaded) {
  return device_error(loaded.path + ": the recording is damaged: " + describe(loaded.damage) +
                      ": nothing is made of it, the unit has to be measured again");
}

// Every recording was synced whole before the first was finished: what is missing is the end mark.
Status seal_like(const UnitRun& unit, const UnitRun& sealed) {
  const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(recording_of(sealed)));
  RecordingWriter writer = TRY(RecordingWriter::reopen(partial_of(unit), RecordingWriter::OpenSegment::drop));
  if (writer.segments().size() != source->segments().size()) {
    return input_error(partial_of(unit) + ": holds " + std::to_string(writer.segments().size()) +
                       " segments, expected " + std::to_string(source->segments().size()) + " as in " +
                       recording_of(sealed));
  }
  TRY(writer.finish());
  return rename_durably(partial_of(unit), recording_of(unit));
}

// Nothing when no parameters came of it.
Status check_parameters(const UnitRun& unit, const JournalContents& contents) {
  const JournalFields* const results = contents.results_of(unit.run.unit());
  const std::string expected = results != nullptr ? value_of(*results, "parameters_hash") : "";
  if (expected.empty()) return {};
  const std::string path = unit.folder + "/" + parameters_name;
  const std::string text = TRY(read_whole_file(path));
  const std::string found = hash_of_text(text);
  if (found == expected) return {};
  return device_error(path + ": is not the file that this run made: expected hash " + expected + ", found " + found);
}

}  // namespace

Status check_sealed(const LoadedRecording& loaded, const JournalContents& contents, std::size_t unit) {
  const RecordingDamage& damage = loaded.damage;
  if (damage.lost_data() || !damage.complete || damage.torn_tail_bytes > 0) return damaged(loaded);
  const std::string expected = unit < contents.hashes.size() ? contents.hashes[unit] : "";
  if (expected.empty() || loaded.hash == expected) return {};
  return device_error(loaded.path + ": is not the recording that this run sealed: expected content hash " + expected +
                      ", found " + loaded.hash);
}

std::vector<UnitRun> units_of(const PreparedRun& run, const std::string& folder) {
  std::vector<UnitRun> units;
  const bool alone = run.request.units.size() == 1;
  for (std::size_t i = 0; i < run.request.units.size(); ++i) {
    const std::string& serial = run.request.units[i];
    UnitRun unit{.run = run, .folder = alone ? folder : folder + "/" + name_of_unit(serial), .mark = {}};
    unit.run.request.units = {serial};
    unit.run.rig = rig_of_unit(run.rig, i);
    if (!alone) unit.mark = {{"unit", serial}};
    units.push_back(std::move(unit));
  }
  return units;
}

Status calibrate_units(std::vector<UnitRun>& units, double utc_s, JournalFile& journal) {
  bool any = false;
  Status first;
  for (UnitRun& unit : units) {
    if (unit.dropped) continue;
    unit.status =
        write_results(unit.run, unit.folder, *unit.recording, utc_s, unit.counts, journal, unit.mark, unit.results);
    if (!unit.status && unit.status.error().kind == ErrorKind::device) return unit.status;  // the storage's fault
    if (unit.status)
      any = true;
    else if (first)
      first = unit.status;
  }
  return any ? Status{} : first;
}

void conclude_units(std::vector<UnitRun>& units, double wall_s, const std::string& log, std::ostream& out) {
  for (UnitRun& unit : units) {
    if (unit.dropped || !unit.status) continue;
    if (units.size() > 1) out << "unit " << unit.run.unit() << ":\n";
    print_summary(unit.run, unit.folder, unit.counts, unit.results, wall_s, log, out);
    unit.status = verdict_status(unit.run.unit(), unit.results.verdict);
  }
}

std::string outcome_of(const UnitRun& unit) {
  const bool measured = unit.counts.recorded_s > 0.0;
  if (unit.dropped) return unit.status.error().kind == ErrorKind::input && !measured ? "refused" : "dropped";
  if (unit.status) return unit.run.only_captures() ? "captured" : std::string(to_string(unit.results.verdict.verdict));
  const ErrorKind kind = unit.status.error().kind;
  if (kind == ErrorKind::unit_failed && !is_accepted(unit.results.verdict.verdict))
    return std::string(to_string(unit.results.verdict.verdict));
  if (kind == ErrorKind::unit_failed || (kind == ErrorKind::input && measured)) return "fail";
  return kind == ErrorKind::input ? "refused" : "";
}

Status status_of(const std::vector<UnitRun>& units) {
  if (units.size() == 1) return units.front().status;
  Error worst{ErrorKind::input, ""};
  for (const UnitRun& unit : units) {
    if (unit.status) continue;
    const Error& error = unit.status.error();
    const ErrorKind kind = unit.dropped ? ErrorKind::device : error.kind;
    if (exit_code(kind) > exit_code(worst.kind)) worst.kind = kind;
    const std::string name = "unit " + unit.run.unit();
    const bool named = error.message.starts_with(name);
    worst.message += (worst.message.empty() ? "" : "; ") + (named ? "" : name + ": ") + error.message;
  }
  return worst.message.empty() ? Status{} : worst;
}

Result<bool> sealed_recordings(const std::vector<UnitRun>& units) {
  const UnitRun* sealed = nullptr;
  std::vector<const UnitRun*> open;
  for (const UnitRun& unit : units) {
    if (unit.dropped) continue;
    const bool is_sealed = TRY(sealed_recording(unit));
    if (is_sealed)
      sealed = &unit;
    else
      open.push_back(&unit);
  }
  if (!sealed) return false;
  for (const UnitRun* unit : open) {
    TRY(seal_like(*unit, *sealed));
  }
  return true;
}

Result<std::vector<std::string>> read_recordings(std::vector<UnitRun>& units) {
  std::vector<std::string> hashes;
  for (UnitRun& unit : units) {
    hashes.emplace_back();
    if (unit.dropped) continue;
    Result<LoadedRecording> loaded = load_recording(partial_of(unit), {}, {}, unit.run.calibration_ends_before());
    if (!loaded) return loaded.error();
    if (loaded->damage.lost_data()) return damaged(*loaded);
    loaded->damage = {};  // the end mark is still to come
    loaded->path = recording_of(unit);
    hashes.back() = loaded->hash;
    unit.recording = std::move(*loaded);
  }
  return hashes;
}

Status check_what_is_over(const std::vector<UnitRun>& units, const std::string& folder,
                          const JournalContents& contents) {
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (units[i].dropped) continue;
    TRY(check_parameters(units[i], contents));
    if (path_exists(partial_of(units[i]))) {
      return input_error(partial_of(units[i]) + ": expected no recording that goes on beside " + journal_name +
                         " of a run that is complete: one of them is of another run");
    }
    const std::string path = recording_of(units[i]);
    if (path_exists(path)) {
      const LoadedRecording loaded = TRY(load_recording(path));
      TRY(check_sealed(loaded, contents, i));
      continue;
    }
    const Result<std::string> log = read_whole_file(folder + "/" + log_name);
    if (!log || log->find(removed_by_prune) == std::string::npos) {
      return input_error(path + ": is missing, and " + log_name + " does not say that it was pruned: expected the " +
                         journal_name + " and the recording of one run");
    }
  }
  return {};
}

Status verify_recordings(std::vector<UnitRun>& units, const JournalContents& contents) {
  for (std::size_t i = 0; i < units.size(); ++i) {
    UnitRun& unit = units[i];
    if (unit.dropped) continue;
    if (!contents.seal_utc_s || !contents.last_dwell) {
      return input_error(unit.folder + ": the recording is complete, but the journal knows nothing of it");
    }
    Result<LoadedRecording> loaded = load_recording(recording_of(unit), {}, {}, unit.run.calibration_ends_before());
    if (!loaded) return device_error(loaded.error().message + " (the recording was whole when it was sealed)");
    const RecordingInfo& info = loaded->data.info;
    if (info.simulated != unit.run.simulated() || info.unit_serial != unit.run.unit()) {
      return input_error(unit.folder + ": the recording is of unit " + info.unit_serial + " and " +
                         (info.simulated ? "simulated" : "real") + ", the journal is of another");
    }
    TRY(check_sealed(*loaded, contents, i));
    unit.counts.repeated_dwells = contents.last_dwell->repeated_dwells;
    unit.counts.lost_samples = contents.last_dwell->units[i].lost_samples;
    unit.counts.sessions = contents.sessions + 1;
    unit.counts.clock = i < contents.clocks.size() ? contents.clocks[i] : std::nullopt;
    unit.counts.recorded_s = loaded->recorded_s;
    unit.recording = std::move(*loaded);
  }
  return {};
}

}  // namespace turncal
