// The schema of the results database, and how an older one becomes it. SQL for SQLite and PostgreSQL alike, but for the migrations from 1 and
// 2: only SQLite files are that old.
//
//   1  calibration, value                 before versions were kept
//   2  attempt, schema_version            every attempt, whatever became of it
//   3  attempt_note, views                rows are added and never changed; what is newer is another row
//   4  statistics                         what a calibration leaves for the fleet: statistics.tcs, docs/fleet.md
#pragma once

#include "orchestrator/records/sql_connection.h"

namespace turncal {

inline constexpr int database_version = 4;

// 0: a database without tables.
Result<int> version_of(SqlConnection& database);
// From any older version to the newest, inside the caller's transaction; nothing where it is the newest.
Status migrate(SqlConnection& database);

}  // namespace turncal
