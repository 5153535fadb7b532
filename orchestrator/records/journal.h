// The journal of a run on disk, `journal.tcj`: append-only numbered records with checksums (imu_io/base/record_log.h), each synced
// before append returns. A record's payload is `key = value` text; docs/architecture.md lists the types and keys.
//
// The file appears whole with its first record or not at all. A torn last record, left by a power loss, is cut off when
// the journal is opened again; a hole in the middle is damage, and the run it belongs to cannot be resumed. A lock admits one process
// at a time.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/station/fields.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

inline constexpr const char* journal_name = "journal.tcj";

enum class JournalType : std::uint32_t {
  begin = 1,
  transition,
  home,
  move,
  dwell,
  seal,
  resume,
  results,
  verdict,
  dropout,
  clock,
  estimate,
  settle
};
std::string_view to_string(JournalType type);

using JournalFields = KeyTexts;  // an empty value is left out of the record

std::string unescaped_value(std::string_view text);  // of a record: replaces %XX by the character

Fields fields_of(TableCommand& command);
Fields fields_of(Dropout& dropout);
// Fields for as many units as `dwell` has room for when it is read.
Fields fields_of(CompletedDwell& dwell);

class JournalFile : public RunJournal {
 public:
  static Result<JournalFile> create(const std::string& path, const JournalFields& begin);
  static Result<JournalFile> reopen(const std::string& path);  // the torn tail is cut

  // Appends a record, on disk on success. After an error every further append is refused. A journal that was moved, removed or
  // changed meanwhile is an error.
  Status append(JournalType type, const JournalFields& fields);

  Status transition(const TransitionRecord& record) override;
  Status command(const TableCommand& command) override;
  Status dwell(const CompletedDwell& dwell) override;
  Status dropout(const Dropout& dropout) override;
  Status seal(double utc_s, const std::vector<std::string>& hashes) override;
  Status check_kept() const { return status_ ? file_.check_kept() : status_; }  // as the next append would
  Status clock_set(double by_s, const RunSnapshot& at);
  // Keeps the clock errors of the units for the seal record.
  void note_clocks(std::vector<std::optional<UnitClock>> clocks) { clocks_ = std::move(clocks); }

 private:
  JournalFile(PosixFile file, std::uint32_t next_number) : file_(std::move(file)), next_number_(next_number) {}
  PosixFile file_;
  std::uint32_t next_number_ = 0;
  Status status_;  // first error; nothing is written after it
  std::vector<std::optional<UnitClock>> clocks_;
};

// What a run did at the end of its plan about confounded effects. With a sequence: its steps follow the plan.
struct Settling {
  std::string unit, doubt;  // "accel_second_order or accel_third_order"
  double added_s = 0.0;     // recorded for it; 0: nothing was found that separates them
  std::string why_not;      // why nothing was found
  std::string sequence;     // text of the legs
};
Fields fields_of(Settling& settling);

// What a journal says about its run.
struct JournalContents {
  JournalFields begin;
  std::optional<CompletedDwell> last_dwell;
  std::vector<TableCommand> commands;  // up to last_dwell, without those of discarded attempts
  std::optional<double> seal_utc_s;    // last attempt to seal
  std::vector<std::string> hashes;     // at that attempt: content hashes of the recordings, by unit; empty: none
  std::vector<std::optional<UnitClock>> clocks;  // at that attempt
  int sessions = 1;                              // 1 + resumes
  std::vector<Settling> settled;                 // in order
  std::vector<JournalFields> results, verdicts;  // one for each unit, in order
  JournalFields transition, estimate;            // the newest
  std::optional<RunState> ended;                 // empty: it goes on, or its program ended without a final state
  struct Failed {
    double utc_s, last_dwell_utc_s;  // 0: no dwell was complete
  };
  std::vector<Failed> failed;  // each fault that ended a session
  bool pause_asked = false;    // since the last begin or resume, and nothing else has stopped the run
  bool table_unknown = false;  // drives went on since it was last seen at rest with its drives off
  struct DroppedUnit : Dropout {
    bool after_last_dwell = true;  // discarded with what came after the dwell, unless the recordings are sealed
  };
  std::vector<DroppedUnit> dropped;

  std::vector<std::string> units() const;  // serial numbers
  // Returns a unit's newest record among `results` or `verdicts`; null: none yet.
  const JournalFields* newest(const std::vector<JournalFields>& records, const std::string& unit) const;

  // Returns what to do first when the run's program has ended and the table is unknown; empty: it is known.
  std::string table_warning() const;
  const std::string& begin_value(std::string_view key) const { return value_of(begin, key); }  // "" when missing
};

Result<JournalContents> read_journal(const std::string& path);
// Returns one line for each record, for people: "  12 move       time_s = 7  axis = pitch ...".
Result<std::string> journal_as_text(const std::string& path);
// Returns a row for each field of each record: record, type, key, value.
Result<DataTable> journal_as_table(const std::string& path);

// Returns the folders that hold a journal, that with the newest first.
std::vector<std::string> runs_newest_first(std::vector<std::string> folders);

struct RunFolder {
  std::string path;
  std::optional<pid_t> process;  // works on it
};
// Returns the run that a process works on, else the one with the newest journal.
std::optional<RunFolder> newest_run(const std::string& runs);

// A run's recording on disk. It is called `recording.partial.tcr` while it grows, and `recording.tcr` only when it is complete and
// synced, so that part of a run cannot be taken for a whole one.
class RecordingSink : public RunSink {
 public:
  explicit RecordingSink(std::string folder) : folder_(std::move(folder)) {}
  Status start(const RecordingInfo& info) override;
  Status resume(const RecordingInfo& info, std::int64_t end_sample, std::optional<std::uint32_t> written) override;
  Status begin_segment(const Segment& segment) override { return writer_->begin_segment(segment); }
  Status add(std::span<const ImuSample> samples) override { return writer_->add(samples); }
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) override {
    return writer_->end_segment(kind, end_sample, angles_deg);
  }
  // Sets aside a rest that another take replaces.
  Status set_aside(const Segment& rest) { return writer_->set_aside(rest); }
  Status sync() override { return writer_->sync(); }
  std::optional<std::uint32_t> written() const override {
    return writer_ ? std::optional(writer_->hash()) : std::nullopt;
  }
  Status finish() override;

  std::string path() const { return folder_ + "/" + binary_recording_name; }  // of the finished recording

 private:
  std::string folder_;
  std::optional<RecordingWriter> writer_;
};

}  // namespace turncal
