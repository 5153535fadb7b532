// The schema of the results database: SQL for SQLite and PostgreSQL alike. Rows are added and never changed; what is newer is another row, and the
// views show the newest.
#pragma once

#include "orchestrator/records/sql_connection.h"

namespace turncal {

inline constexpr int database_version = 4;

// 0: a database without tables.
Result<int> version_of(SqlConnection& database);
// In a database without tables, inside the caller's transaction; nothing elsewhere.
Status make_tables(SqlConnection& database);

}  // namespace turncal
