// The run's journal on disk, `journal.tcj`: append-only numbered records with checksums (imu_io/base/record_log.h), each synced
// before append returns. A record's payload is `key = value` text; docs/journal.md lists the types and keys.
//
// The file appears whole with its first record or not at all. A torn last record, as a power loss leaves it, is cut off when
// the journal is opened again; a hole in the middle is damage, and the run it belongs to is not taken up. One process at a
// time, enforced by a lock.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "imu_io/base/posix_file.h"
#include "orchestrator/records/journal_record.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

class JournalFile : public RunJournal {
 public:
  static Result<JournalFile> create(const std::string& path, const JournalFields& begin);
  static Result<JournalFile> reopen(const std::string& path);  // the torn tail is cut

  // On disk when this returns success. After an error every further append is refused. A journal that somebody has moved, removed or
  // changed meanwhile is an error.
  Status append(JournalType type, const JournalFields& fields);

  Status transition(const TransitionRecord& record) override;
  Status home(double time_s) override;
  Status move(const Move& move, double time_s) override;
  Status dwell(const CompletedDwell& dwell) override;
  Status dropout(const Dropout& dropout) override;
  Status seal(double utc_s, const std::vector<std::string>& hashes) override;
  Status clock_set(double by_s, const RunSnapshot& at);
  // What is known of the units' clocks; goes with the seal.
  void note_clocks(std::vector<std::optional<UnitClock>> clocks) { clocks_ = std::move(clocks); }

 private:
  JournalFile(PosixFile file, std::uint32_t next_number) : file_(std::move(file)), next_number_(next_number) {}
  PosixFile file_;
  std::uint32_t next_number_ = 0;
  bool failed_ = false;
  std::vector<std::optional<UnitClock>> clocks_;
};

}  // namespace turncal
