#include "orchestrator/records/database_rows.h"

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

std::string places(std::size_t first, std::size_t count) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) text += (i > 0 ? ", $" : "$") + std::to_string(first + i);
  return text;
}

std::string columns_of(const Fields& fields) {
  std::string columns;
  for (const Field& field : fields) columns += (columns.empty() ? "" : ", ") + field.key;
  return columns;
}

std::string attempt_columns() {
  AttemptRecord attempt;
  return columns_of(fields_of(attempt));
}

SqlRow row_of(const Fields& fields) {
  SqlRow row;
  for (const Field& field : fields)
    row.push_back(std::visit(
        [&field](const auto& value) -> SqlValue {
          using Place = std::decay_t<decltype(value)>;
          if constexpr (std::is_same_v<Place, Choice>)
            return text_of(field);
          else if constexpr (std::is_same_v<Place, std::string*> || std::is_same_v<Place, double*>)
            return *value;
          else if constexpr (std::is_same_v<Place, std::optional<double>*>)
            return as_value(*value);
          else if constexpr (std::is_integral_v<std::remove_pointer_t<Place>>)
            return static_cast<std::int64_t>(*value);
          else
            return *value ? SqlValue(std::int64_t{**value}) : SqlValue();
        },
        field.value));
  return row;
}

void take_row(const SqlRow& row, const Fields& fields) {
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const SqlValue& from = row[i];
    const std::optional<double> number = as_number(from);
    std::visit(
        [&](const auto& value) {
          using Place = std::decay_t<decltype(value)>;
          if constexpr (std::is_same_v<Place, Choice>)
            static_cast<void>(set_text(fields[i], as_text(from)));
          else if constexpr (std::is_same_v<Place, std::string*>)
            *value = as_text(from);
          else if constexpr (std::is_same_v<Place, double*>)
            *value = number.value_or(0.0);
          else if constexpr (std::is_same_v<Place, std::optional<double>*>)
            *value = number;
          else if constexpr (std::is_integral_v<std::remove_pointer_t<Place>>)
            *value = static_cast<std::remove_pointer_t<Place>>(as_integer(from));
          else if (number)
            *value = static_cast<typename std::remove_pointer_t<Place>::value_type>(as_integer(from));
        },
        fields[i].value);
  }
}

Result<AddedRow> add_calibration_row(SqlConnection& database, const SqlRow& row, const std::vector<SqlRow>& values,
                                     const SqlBytes& statistics) {
  AddedRow added;
  TRY(database.run(std::string("INSERT INTO calibration(") + calibration_columns + ") VALUES(" + places(1, row.size()) +
                       ") ON CONFLICT(unit, recording_hash, method, content) DO NOTHING RETURNING id",
                   row, [&](const SqlRow& inserted) {
                     added = {as_integer(inserted.front()), true};
                   }));
  if (!added.is_new) {
    constexpr std::size_t content = 15;
    TRY(database.run(
        "SELECT id FROM calibration WHERE unit = $1 AND method = $2 AND recording_hash = $3 AND content = $4",
        {row[0], row[2], row[3], row[content]}, [&](const SqlRow& there) { added.id = as_integer(there.front()); }));
    return added;
  }
  if (!values.empty()) {
    std::string sql = std::string("INSERT INTO value(calibration, ") + value_columns + ") VALUES";
    SqlRow all;
    for (const SqlRow& value : values) {
      sql += (all.empty() ? "(" : ", (") + places(all.size() + 1, 1 + value.size()) + ")";
      all.emplace_back(added.id);
      all.insert(all.end(), value.begin(), value.end());
    }
    TRY(database.run(sql, all));
  }
  if (!statistics.empty())
    TRY(database.run("INSERT INTO statistics(calibration, contents) VALUES($1, $2)", {SqlValue(added.id), statistics}));
  return added;
}

Result<bool> add_attempt_row(SqlConnection& database, const std::string& key, SqlRow row) {
  row.insert(row.begin(), key);
  bool is_new = false;
  TRY(database.run("INSERT INTO attempt_note(key, " + attempt_columns() + ") VALUES(" + places(1, row.size()) +
                       ") ON CONFLICT(key) DO NOTHING RETURNING id",
                   row, [&](const SqlRow&) { is_new = true; }));
  return is_new;
}

std::string where(const std::string& verdict) {
  return "($1 = '' OR unit = $1) AND ($2 = '' OR station = $2) AND ($3 = '' OR part = $3) AND ($4 = '' OR " + verdict +
         " = $4) AND time_utc >= $5 AND ($6 = '' OR substr(time_utc, 1, length($6)) <= $6)";
}

SqlRow values_of(const RecordFilter& f) { return {f.unit, f.station, f.part, f.verdict, f.from, f.to}; }

}  // namespace turncal
