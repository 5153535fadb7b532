#include "orchestrator/records/database_rows.h"

#include <fmt/format.h>

#include <algorithm>

#include "imu_io/base/text.h"

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

// "$1, $2, $3" for (1, 3).
std::string places(std::size_t first, std::size_t count) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) text += (i > 0 ? ", $" : "$") + std::to_string(first + i);
  return text;
}

}  // namespace

Result<int> version_of(SqlConnection& database) {
  int version = 0;
  if (TRY(database.has_table("schema_version")))
    TRY(database.run("SELECT version FROM schema_version", {},
                     [&](const SqlRow& row) { version = int(as_integer(row.front())); }));
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

std::vector<std::string> columns_in(const std::string& table) {
  std::string_view text(schema);
  const std::string head = "CREATE TABLE " + table + "(";
  text.remove_prefix(text.find(head) + head.size());
  std::vector<std::string> columns;
  for (const std::string_view one : split(text.substr(0, text.find(");")), ',')) {
    const std::string_view column = one.substr(one.find_first_not_of(" \n")), name = column.substr(0, column.find(' '));
    // A constraint begins with a capital letter, and its columns have no type.
    if (name.size() < column.size() && name != "id" && name.front() >= 'a') columns.emplace_back(name);
  }
  return columns;
}

std::string columns_of(const std::string& table) { return fmt::format("{}", fmt::join(columns_in(table), ", ")); }

std::string columns_of(const Fields& fields) {
  std::string columns;
  for (const Field& field : fields) columns += (columns.empty() ? "" : ", ") + field.key;
  return columns;
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
            return std::int64_t(*value);
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

Result<std::vector<std::int64_t>> insert(SqlConnection& database, const std::string& table,
                                         const std::vector<SqlRow>& rows, const std::string& unique) {
  constexpr std::size_t at_once = 24;  // of values: a calibration's
  const std::string columns = columns_of(table);
  std::vector<std::int64_t> ids;
  for (std::size_t from = 0; from < rows.size(); from += at_once) {
    std::string sql;
    SqlRow all;
    for (std::size_t i = from; i < std::min(rows.size(), from + at_once); ++i) {
      sql += (all.empty() ? "INSERT INTO " + table + "(" + columns + ") VALUES(" : ", (") +
             places(all.size() + 1, rows[i].size()) + ")";
      all.insert(all.end(), rows[i].begin(), rows[i].end());
    }
    if (!unique.empty()) sql += " ON CONFLICT(" + unique + ") DO NOTHING RETURNING id";
    TRY(database.run(sql, all, [&ids](const SqlRow& row) { ids.push_back(as_integer(row.front())); }));
  }
  return ids;
}

Result<AddedRow> add_calibration(SqlConnection& database, const SqlRow& row) {
  const std::string unique = "unit, recording_hash, method, content";
  const std::vector<std::int64_t> ids = TRY(insert(database, "calibration", {row}, unique));
  if (!ids.empty()) return AddedRow{ids.front(), true};
  SqlRow same;
  const std::vector<std::string> columns = columns_in("calibration");
  for (const std::string_view column : split(unique, ','))
    same.push_back(row[std::size_t(std::ranges::find(columns, trimmed(column)) - columns.begin())]);
  AddedRow there;
  TRY(database.run("SELECT id FROM calibration WHERE (" + unique + ") = (" + places(1, same.size()) + ")", same,
                   [&there](const SqlRow& found) { there.id = as_integer(found.front()); }));
  return there;
}

std::string where(const std::string& verdict) {
  return "($1 = '' OR unit = $1) AND ($2 = '' OR station = $2) AND ($3 = '' OR part = $3) AND ($4 = '' OR " + verdict +
         " = $4) AND time_utc >= $5 AND ($6 = '' OR substr(time_utc, 1, length($6)) <= $6)";
}

SqlRow values_of(RecordFilter filter) { return row_of(fields_of(filter)); }

}  // namespace turncal
