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

// All but id, in the order of the schema.
std::vector<std::string> columns_in(const std::string& table);
std::string columns_of(const std::string& table);  // "unit, time_utc, ..."

std::string columns_of(const Fields& fields);
SqlRow row_of(const Fields& fields);
void take_row(const SqlRow& row, const Fields& fields);  // the columns of the row are those of the fields

struct AddedRow {
  std::int64_t id = 0;
  bool is_new = false;  // false: it was there
};

// Inside the caller's transaction. unique: columns that no two rows share, of a table with ids: a row that is there already is left as it
// is. The ids of the new rows.
Result<std::vector<std::int64_t>> insert(SqlConnection& database, const std::string& table,
                                         const std::vector<SqlRow>& rows, const std::string& unique = "");
// A row of calibration.
Result<AddedRow> add_calibration(SqlConnection& database, const SqlRow& row);
// Of attempt_note: the same for the same row, wherever it comes from.
inline constexpr const char* unique_attempt = "key";

// Which rows a filter lets through, with parameters $1 to $6. verdict: what the column of the verdict is called.
std::string where(const std::string& verdict);
SqlRow values_of(RecordFilter filter);

}  // namespace turncal
