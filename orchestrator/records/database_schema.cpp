#include "orchestrator/records/database_schema.h"

#include "orchestrator/records/sqlite_statement.h"

namespace turncal {

namespace {

// The columns after folder come from the parameter file's record.* keys of the same name.
constexpr const char* calibrations = R"(
CREATE TABLE IF NOT EXISTS calibration(
  id INTEGER PRIMARY KEY, unit TEXT NOT NULL, time_utc TEXT NOT NULL, method TEXT NOT NULL, recording_hash TEXT NOT NULL,
  software_version TEXT, simulated INTEGER NOT NULL, verdict TEXT NOT NULL, rule TEXT, sessions INTEGER, folder TEXT,
  station TEXT, operator TEXT, part TEXT, revision TEXT, ambient TEXT, configuration_hash TEXT, sequence TEXT,
  sequence_hash TEXT, table_id TEXT, table_calibration_due TEXT, overdue_reason TEXT, repeated_dwells TEXT,
  lost_samples TEXT, parameter_file TEXT NOT NULL, model TEXT, diagnosis TEXT, reason TEXT,
  verification TEXT,
  UNIQUE(unit, recording_hash, method));
CREATE TABLE IF NOT EXISTS value(
  calibration INTEGER NOT NULL REFERENCES calibration(id) ON DELETE CASCADE, key TEXT NOT NULL, value REAL NOT NULL,
  sigma REAL, limit_min REAL, limit_max REAL, verdict TEXT, PRIMARY KEY(calibration, key));
)";

// run: as AttemptRecord has it; NULL: there was none.
constexpr const char* attempts = R"(
CREATE TABLE attempt(
  id INTEGER PRIMARY KEY, run TEXT, unit TEXT NOT NULL, began_utc TEXT NOT NULL, time_utc TEXT NOT NULL,
  outcome TEXT NOT NULL, reason TEXT, simulated INTEGER NOT NULL, station TEXT, operator TEXT, part TEXT, revision TEXT,
  ambient TEXT, temperature_min_c REAL, temperature_max_c REAL, residual REAL, diagnosis TEXT, recorded_s REAL,
  sessions INTEGER NOT NULL, repeated_dwells INTEGER, lost_samples INTEGER, folder TEXT,
  calibration INTEGER REFERENCES calibration(id) ON DELETE SET NULL, UNIQUE(run, unit));
CREATE INDEX attempt_time ON attempt(time_utc);
CREATE TABLE schema_version(version INTEGER NOT NULL);
INSERT INTO schema_version VALUES(2);
)";

// What a calibration of version 1 tells of its attempt: the residual stands in its parameter file.
constexpr const char* attempts_of_version_1 = R"(
INSERT INTO attempt(unit, began_utc, time_utc, outcome, reason, simulated, station, operator, part, revision, ambient,
                    residual, diagnosis, sessions, repeated_dwells, lost_samples, folder, calibration)
SELECT unit, time_utc, time_utc, verdict, reason, simulated, station, operator, part, revision, ambient,
  CASE WHEN instr(parameter_file, 'quality.normalised_rms = ') > 0 THEN
    CAST(substr(parameter_file, instr(parameter_file, 'quality.normalised_rms = ') + 25, 25) AS REAL) END,
  diagnosis, COALESCE(sessions, 1), repeated_dwells, lost_samples, folder, id FROM calibration ORDER BY time_utc, id;
)";

bool execute(sqlite3* database, const char* sql) {
  return sqlite3_exec(database, sql, nullptr, nullptr, nullptr) == SQLITE_OK;
}

bool to_version_1(sqlite3* database) {
  if (!execute(database, calibrations)) return false;
  for (const std::string column : {"model", "diagnosis", "reason", "verification"}) {
    if (Statement(database, "SELECT " + column + " FROM calibration")) continue;  // made before this column was
    if (!execute(database, ("ALTER TABLE calibration ADD COLUMN " + column + " TEXT").c_str())) return false;
  }
  return true;
}

}  // namespace

int version_of(sqlite3* database) {
  Statement tables(database, "SELECT name FROM sqlite_master WHERE name IN ('calibration', 'schema_version')");
  bool any = false, versioned = false;
  while (tables && tables.row()) {
    any = true;
    versioned = versioned || tables.text(0) == "schema_version";
  }
  if (!tables || !tables.ended_well()) return -1;
  if (!versioned) return any ? 1 : 0;
  Statement version(database, "SELECT version FROM schema_version");
  return version && version.row() ? static_cast<int>(version.integer(0)) : -1;
}

bool migrate(sqlite3* database) {
  const int version = version_of(database);
  if (version < 0) return false;
  if (version >= database_version) return true;
  return to_version_1(database) && execute(database, attempts) && execute(database, attempts_of_version_1);
}

}  // namespace turncal
