// Rows of the results database as they are added and asked for: shared by what writes, reads and copies them.
#pragma once

#include "orchestrator/records/attempt_record.h"
#include "orchestrator/records/sql_connection.h"

namespace turncal {

// All but id, in the order in which rows are given and asked for; those of an attempt end with `calibration`.
inline constexpr const char* calibration_columns =
    "unit, time_utc, method, recording_hash, software_version, simulated, verdict, rule, sessions, folder, "
    "parameter_file, "
    "model, diagnosis, reason, verification, content, station, operator, part, revision, ambient, configuration_hash, "
    "sequence, sequence_hash, table_id, table_calibration_due, overdue_reason, repeated_dwells, lost_samples";
inline constexpr const char* attempt_columns =
    "run, unit, began_utc, time_utc, outcome, reason, simulated, station, operator, part, revision, ambient, "
    "temperature_min_c, temperature_max_c, residual, diagnosis, recorded_s, sessions, repeated_dwells, lost_samples, "
    "folder, calibration";
inline constexpr const char* value_columns = "key, value, sigma, limit_min, limit_max, verdict";

struct AddedRow {
  std::int64_t id = 0;
  bool is_new = false;  // false: it was there
};

// Inside the caller's transaction. values: of value_columns. statistics: the bytes of statistics.tcs; empty: there are none.
Result<AddedRow> add_calibration_row(SqlConnection& database, const SqlRow& row, const std::vector<SqlRow>& values,
                                     const SqlBytes& statistics);
// key: the same for the same row, wherever it comes from. True: it was not there.
Result<bool> add_attempt_row(SqlConnection& database, const std::string& key, SqlRow row);

// "$1, $2, $3" for (1, 3).
std::string places(std::size_t first, std::size_t count);

// Which rows a filter lets through, with parameters $1 to $6. verdict: what the column of the verdict is called.
std::string where(const std::string& verdict);
SqlRow values_of(const RecordFilter& filter);

}  // namespace turncal
