#include "orchestrator/records/database_schema.h"

namespace turncal {

namespace {

// Columns of calibration from station on come from the parameter file's record.* keys of the same name; content is the hash of that file.
// run: as AttemptRecord has it; NULL: there was none. Nothing is ever changed: what is newer is another row, and the views show the newest.
constexpr const char* newest_schema = R"(
CREATE TABLE calibration(
  id @ID, unit TEXT NOT NULL, time_utc TEXT NOT NULL, method TEXT NOT NULL, recording_hash TEXT NOT NULL,
  software_version TEXT, simulated BIGINT NOT NULL, verdict TEXT NOT NULL, rule TEXT, sessions BIGINT, folder TEXT,
  parameter_file TEXT NOT NULL, model TEXT, diagnosis TEXT, reason TEXT, verification TEXT, content TEXT NOT NULL,
  station TEXT, operator TEXT, part TEXT, revision TEXT, ambient TEXT, configuration_hash TEXT, sequence TEXT,
  sequence_hash TEXT, table_id TEXT, table_calibration_due TEXT, overdue_reason TEXT, repeated_dwells TEXT,
  lost_samples TEXT, UNIQUE(unit, recording_hash, method, content));
CREATE TABLE value(
  calibration BIGINT NOT NULL REFERENCES calibration(id) ON DELETE CASCADE, key TEXT NOT NULL,
  value DOUBLE PRECISION NOT NULL, sigma DOUBLE PRECISION, limit_min DOUBLE PRECISION, limit_max DOUBLE PRECISION,
  verdict TEXT, PRIMARY KEY(calibration, key));
CREATE TABLE attempt_note(
  id @ID, key TEXT NOT NULL UNIQUE, run TEXT, unit TEXT NOT NULL, began_utc TEXT NOT NULL, time_utc TEXT NOT NULL,
  outcome TEXT NOT NULL, reason TEXT, simulated BIGINT NOT NULL, station TEXT, operator TEXT, part TEXT, revision TEXT,
  ambient TEXT, temperature_min_c DOUBLE PRECISION, temperature_max_c DOUBLE PRECISION, residual DOUBLE PRECISION,
  diagnosis TEXT, recorded_s DOUBLE PRECISION, sessions BIGINT NOT NULL, repeated_dwells BIGINT, lost_samples BIGINT,
  folder TEXT, calibration BIGINT REFERENCES calibration(id));
CREATE INDEX attempt_note_run ON attempt_note(run, unit);
CREATE INDEX attempt_note_time ON attempt_note(time_utc);
CREATE INDEX attempt_note_calibration ON attempt_note(calibration);
CREATE VIEW attempt AS SELECT * FROM attempt_note AS note WHERE NOT EXISTS(
  SELECT 1 FROM attempt_note AS later
  WHERE later.run = note.run AND later.unit = note.unit AND later.station = note.station AND later.id > note.id);
CREATE VIEW newest_calibration AS SELECT * FROM calibration AS one WHERE NOT EXISTS(
  SELECT 1 FROM calibration AS later
  WHERE later.unit = one.unit AND later.recording_hash = one.recording_hash AND later.method = one.method
    AND later.id > one.id);
CREATE TABLE statistics(
  calibration BIGINT PRIMARY KEY REFERENCES calibration(id) ON DELETE CASCADE, contents BYTEA NOT NULL);
CREATE TABLE schema_version(version BIGINT NOT NULL);
INSERT INTO schema_version VALUES(4);
)";

constexpr const char* from_version_3 = R"(
CREATE TABLE statistics(
  calibration BIGINT PRIMARY KEY REFERENCES calibration(id) ON DELETE CASCADE, contents BYTEA NOT NULL);
UPDATE schema_version SET version = 4;
)";

constexpr const char* attempts_of_version_2 = R"(
CREATE TABLE attempt(
  id INTEGER PRIMARY KEY, run TEXT, unit TEXT NOT NULL, began_utc TEXT NOT NULL, time_utc TEXT NOT NULL,
  outcome TEXT NOT NULL, reason TEXT, simulated INTEGER NOT NULL, station TEXT, operator TEXT, part TEXT, revision TEXT,
  ambient TEXT, temperature_min_c REAL, temperature_max_c REAL, residual REAL, diagnosis TEXT, recorded_s REAL,
  sessions INTEGER NOT NULL, repeated_dwells INTEGER, lost_samples INTEGER, folder TEXT, calibration INTEGER);
CREATE TABLE schema_version(version INTEGER NOT NULL);
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

// The tables of version 2 under other names, the new ones, and what was in the old ones. The keys of old rows follow from the rows: a
// database that is copied before and after it was brought up to date gives no row twice.
constexpr const char* set_aside = R"(
ALTER TABLE value RENAME TO old_value;
ALTER TABLE attempt RENAME TO old_attempt;
ALTER TABLE calibration RENAME TO old_calibration;
DROP TABLE schema_version;
)";
constexpr const char* taken_over = R"(
INSERT INTO calibration SELECT id, unit, time_utc, method, recording_hash, software_version, simulated, verdict, rule, sessions,
  folder, parameter_file, model, diagnosis, reason, verification, '', station, operator, part, revision, ambient,
  configuration_hash, sequence, sequence_hash, table_id, table_calibration_due, overdue_reason, repeated_dwells, lost_samples
  FROM old_calibration ORDER BY id;
INSERT INTO value SELECT calibration, key, value, sigma, limit_min, limit_max, verdict FROM old_value ORDER BY rowid;
INSERT INTO attempt_note SELECT id,
  'old|' || COALESCE(run, '') || '|' || unit || '|' || COALESCE(station, '') || '|' || began_utc || '|' || time_utc || '|' ||
  outcome || '|' || id, run, unit, began_utc, time_utc, outcome, reason, simulated, station, operator, part, revision, ambient,
  temperature_min_c, temperature_max_c, residual, diagnosis, recorded_s, sessions, repeated_dwells, lost_samples, folder,
  calibration FROM old_attempt ORDER BY id;
DROP TABLE old_value; DROP TABLE old_attempt; DROP TABLE old_calibration;
)";

Status make_tables(SqlConnection& database) {
  std::string sql = newest_schema;
  for (std::size_t at = sql.find("@ID"); at != std::string::npos; at = sql.find("@ID"))
    sql.replace(at, 3, database.identity());
  return database.run(sql);
}

Status from_version_1(SqlConnection& database) {
  for (const std::string column : {"model", "diagnosis", "reason", "verification"}) {
    if (database.run("SELECT " + column + " FROM calibration LIMIT 0")) continue;
    TRY(database.run("ALTER TABLE calibration ADD COLUMN " + column + " TEXT"));
  }
  TRY(database.run(attempts_of_version_2));
  return database.run(attempts_of_version_1);
}

}  // namespace

Result<int> version_of(SqlConnection& database) {
  const bool versioned = TRY(database.has_table("schema_version"));
  if (!versioned) {
    const Result<bool> any = database.has_table("calibration");
    return any ? Result<int>(*any ? 1 : 0) : Result<int>(any.error());
  }
  int version = 0;
  if (Status status = database.run("SELECT version FROM schema_version", {},
                                   [&](const SqlRow& row) { version = static_cast<int>(as_integer(row.front())); });
      !status)
    return status.error();
  return version;
}

Status migrate(SqlConnection& database) {
  TRY(database.hold_schema());
  const int version = TRY(version_of(database));
  if (version >= database_version) return {};
  if (version == 0) return make_tables(database);
  if (version == 3) return database.run(from_version_3);
  if (version == 1) {
    TRY(from_version_1(database));
  }
  TRY(database.run(set_aside));
  TRY(make_tables(database));
  return database.run(taken_over);
}

}  // namespace turncal
