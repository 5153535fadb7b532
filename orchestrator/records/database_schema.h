// The schema of the results database, and how an older one becomes it. Portable SQL, but for the migrations: only SQLite files are old.
//
//   1  calibration, value                 before versions were kept
//   2  attempt, schema_version            every attempt, whatever became of it
#pragma once

#include <string>

struct sqlite3;

namespace turncal {

inline constexpr int database_version = 2;

// 0: a database without tables; -1: it cannot be read (sqlite3_errmsg says why).
int version_of(sqlite3* database);
// From any older version to the newest, inside the caller's transaction; nothing where it is the newest. False: sqlite3_errmsg says why.
bool migrate(sqlite3* database);

}  // namespace turncal
