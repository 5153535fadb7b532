// What a run's journal says, read back whole: where a run can be taken up, and what became of its units.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/data_text.h"
#include "orchestrator/records/journal_record.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

// A command to the table, on the station's clock. No move: home.
struct JournalCommand {
  double time_s = 0.0;
  std::optional<Move> move;
};

// What a journal says about its run.
struct JournalContents {
  JournalFields begin;
  std::optional<CompletedDwell> last_dwell;
  std::vector<JournalCommand> commands;          // up to last_dwell, without those of attempts that were taken back
  std::optional<double> seal_utc_s;              // of the last attempt to seal
  std::vector<std::string> hashes;               // the same: of the recordings' contents, by unit; empty: none was kept
  std::vector<std::optional<UnitClock>> clocks;  // the same
  int sessions = 1;                              // 1 + resumes
  std::vector<JournalFields> results, verdicts;  // one a unit, as they came
  JournalFields transition, estimate;            // the newest
  bool pause_asked = false;                      // since it was begun or taken up again
  struct DroppedUnit {
    std::size_t unit = 0;
    Error why;
    bool after_last_dwell = false;  // taken back with all that came after it, unless the recordings are sealed
  };
  std::vector<DroppedUnit> dropped;

  std::vector<std::string> units() const;                          // their serial numbers
  const JournalFields* results_of(const std::string& unit) const;  // the newest; null: none yet
  const JournalFields* verdict_of(const std::string& unit) const;  // the same

  const std::string& begin_value(std::string_view key) const;  // "" when missing

 private:
  const JournalFields* newest(const std::vector<JournalFields>& records, const std::string& unit) const;
};
const std::string& value_of(const JournalFields& fields, std::string_view key);  // "" when missing

Result<JournalContents> read_journal(const std::string& path);
// One line a record, for people: "  12 move       time_s = 7  axis = pitch ...".
Result<std::string> journal_as_text(const std::string& path);
// A row for each field of each record: record, type, key, value.
Result<DataTable> journal_as_table(const std::string& path);

}  // namespace turncal
