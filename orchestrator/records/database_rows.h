// Tables and rows of the results database, in SQL for SQLite and PostgreSQL alike: shared by what writes, reads and copies them. Rows are added
// and never changed; what is newer is another row, and the views show the newest.
#pragma once

#include "orchestrator/records/results_database.h"
#include "orchestrator/records/sql_connection.h"

namespace turncal {

inline constexpr int database_version = 4;

// 0: a database without tables.
Result<int> version_of(SqlConnection& database);
// In a database without tables, inside the caller's transaction; nothing elsewhere.
Status make_tables(SqlConnection& database);

// All but id, in the order in which rows are given and asked for; those of an attempt end with `calibration`. From `station` on they are the
// record.* keys of the parameter file.
inline constexpr const char* calibration_columns =
    "unit, time_utc, method, recording_hash, software_version, simulated, verdict, rule, sessions, folder, "
    "parameter_file, "
    "model, diagnosis, reason, verification, content, station, operator, part, revision, ambient, configuration_hash, "
    "sequence, sequence_hash, table_id, table_calibration_due, overdue_reason, repeated_dwells, lost_samples";
std::string attempt_columns();
inline constexpr const char* value_columns = "key, value, sigma, limit_min, limit_max, verdict";

std::string columns_of(const Fields& fields);  // "unit, time_utc, ..."
SqlRow row_of(const Fields& fields);
void take_row(const SqlRow& row, const Fields& fields);  // the columns of the row are those of the fields

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
