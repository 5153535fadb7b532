#include "orchestrator/records/database_schema.h"

namespace turncal {

namespace {

// Columns of calibration from station on come from the parameter file's record.* keys of the same name; content is the hash of that file.
// run: as AttemptRecord has it; NULL: there was none. Nothing is ever changed: what is newer is another row, and the views show the newest.
constexpr const char* schema = R"(
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

}  // namespace

Result<int> version_of(SqlConnection& database) {
  const bool versioned = TRY(database.has_table("schema_version"));
  if (!versioned) {
    const bool any = TRY(database.has_table("calibration"));
    return any ? 1 : 0;
  }
  int version = 0;
  TRY(database.run("SELECT version FROM schema_version", {},
                   [&](const SqlRow& row) { version = static_cast<int>(as_integer(row.front())); }));
  return version;
}

Status make_tables(SqlConnection& database) {
  TRY(database.hold_schema());
  const int version = TRY(version_of(database));
  if (version != 0) return {};
  std::string sql = schema;
  for (std::size_t at = sql.find("@ID"); at != std::string::npos; at = sql.find("@ID"))
    sql.replace(at, 3, database.identity());
  return database.run(sql);
}

}  // namespace turncal
