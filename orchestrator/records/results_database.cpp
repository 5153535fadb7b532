#include "orchestrator/records/results_database.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <set>

#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

namespace {

// Columns of calibration from `station` on come from the parameter file's record.* keys of the same name; `content` is the hash of that file.
// run: as in AttemptRecord; NULL: there was none. Nothing is ever changed: newer data are another row, and the views show the newest.
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

// Returns "$1, $2, $3" for (1, 3).
std::string places(std::size_t first, std::size_t count) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) text += (i > 0 ? ", $" : "$") + std::to_string(first + i);
  return text;
}

// Returns the schema's version; 0: a database without tables.
Result<int> version_of(SqlConnection& database) {
  int version = 0;
  if (TRY(database.has_table("schema_version")))
    TRY(database.run("SELECT version FROM schema_version", {},
                     [&](const SqlRow& row) { version = int(sql_as<std::int64_t>(row.front())); }));
  return version;
}

// Makes the tables within the caller's transaction, unless there are any.
Status make_tables_in(SqlConnection& database) {
  if (TRY(version_of(database)) != 0) return {};
  std::string sql = schema;
  for (std::size_t at = sql.find("@ID"); at != std::string::npos; at = sql.find("@ID"))
    sql.replace(at, 3, database.identity());
  return database.run(sql);
}

// Returns all columns except id, in the order of the schema.
std::vector<std::string> columns_in(const std::string& table) {
  std::string_view text(schema);
  const std::string head = "CREATE TABLE " + table + "(";
  text.remove_prefix(text.find(head) + head.size());
  std::vector<std::string> columns;
  for (const std::string_view one : split(text.substr(0, text.find(");")), ',')) {
    const std::string_view column = one.substr(one.find_first_not_of(" \n")), name = column.substr(0, column.find(' '));
    // A constraint begins with a capital letter, and its column names have no type.
    if (name.size() < column.size() && name != "id" && name.front() >= 'a') columns.emplace_back(name);
  }
  return columns;
}

std::string column_list(const std::string& table) { return fmt::format("{}", fmt::join(columns_in(table), ", ")); }

std::string column_list(const Fields& fields) {
  std::string columns;
  for (const Field& field : fields) columns += (columns.empty() ? "" : ", ") + field.key;
  return columns;
}

// Inserts rows within the caller's transaction and returns the ids of the new ones. unique: columns that no two rows share; a row that is
// already there is left as it is.
Result<std::vector<std::int64_t>> insert(SqlConnection& database, const std::string& table,
                                         const std::vector<SqlRow>& rows, const std::string& unique = "") {
  constexpr std::size_t at_once = 24;  // the values of one calibration
  const std::string columns = column_list(table);
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
    TRY(database.run(sql, all, [&ids](const SqlRow& row) { ids.push_back(sql_as<std::int64_t>(row.front())); }));
  }
  return ids;
}

struct AddedRow {
  std::int64_t id = 0;
  bool is_new = false;  // false: it was there before
};

// Adds a row of `calibration`.
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
                   [&there](const SqlRow& found) { there.id = sql_as<std::int64_t>(found.front()); }));
  return there;
}

// Returns the condition of a filter, with parameters $1 to $7. verdict: name of the verdict's column.
std::string where(const std::string& verdict) {
  return "($1 = '' OR unit = $1) AND ($2 = '' OR station = $2) AND ($3 = '' OR part = $3) AND ($4 = '' OR " + verdict +
         " = $4) AND time_utc >= $5 AND ($6 = '' OR substr(time_utc, 1, length($6)) <= $6) AND id > $7";
}

SqlRow values_of(RecordFilter filter) {
  SqlRow values = row_of(fields_of(filter));
  values.emplace_back(std::int64_t(filter.after));
  return values;
}

constexpr const char* unique_attempt = "key";  // of attempt_note: equal for equal rows, wherever they come from

// Returns whether a text begins a valid time.
bool begins_a_time(const std::string& text) {
  constexpr std::string_view first = "0001-01-01T00:00:00Z";
  constexpr std::size_t shortest = 4;  // a year
  if (text.empty()) return true;
  if (text.size() < shortest || text.size() > first.size() || text.back() == '-' || text.back() == ':') return false;
  return parse_utc(text + std::string(first.substr(text.size()))).has_value();
}

// Returns a key that is equal for equal rows, wherever they come from; a refusal before a run existed has only its moment.
std::string key_of(const AttemptRecord& a, const SqlRow& row) {
  const std::string whose = a.unit + "|" + a.station + "|";
  if (a.run.empty()) {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return "refused|" + whose + std::to_string(std::chrono::nanoseconds(now).count()) + "|" +
           std::to_string(::getpid());
  }
  std::string all;
  for (std::size_t i = 0; i + 1 < row.size(); ++i) {  // without the calibration's id, which differs between databases
    const std::optional<double> number = as_number(row[i]);
    all += (number ? format_number(*number) : sql_as<std::string>(row[i])) + '\x1f';
  }
  return a.run + "|" + whose + hash_of_text(all);
}

Status expect_one_of(const std::string& option, const std::string& word, const std::vector<std::string>& there) {
  if (word.empty() || std::ranges::find(there, word) != there.end()) return {};
  return input_error("--" + option + " " + turncal::quoted(word) + ": no row has it: expected " +
                     (there.empty() ? "none" : one_of(word, there)));
}

Fields with_id(AttemptRecord& attempt) {
  Fields fields = fields_of(attempt);
  fields.insert(fields.end(), {{"id", &attempt.id}, {"units", &attempt.units}});
  return fields;
}

// Returns the row of a parameter file: columns other than its facts are keys of its verdict or its record.
SqlRow row_of(const ParameterFile& file, const std::string& text, int sessions, const std::string& folder) {
  const std::string* const result = find_further(file, "verdict.result");
  std::map<std::string, SqlValue> facts = {{"unit", file.unit_serial},
                                           {"time_utc", file.time_utc},
                                           {"method", file.method},
                                           {"recording_hash", file.recording_hash},
                                           {"software_version", file.software_version},
                                           {"simulated", std::int64_t{file.simulated}},
                                           {"verdict", result ? *result : "not_judged"},
                                           {"sessions", std::int64_t{sessions}},
                                           {"folder", folder},
                                           {"parameter_file", text},
                                           {"model", file.model},
                                           {"content", hash_of_text(text)}};
  for (const auto& [key, word] : file.further)
    if (key.starts_with("verdict.") || key.starts_with("record.")) facts.emplace(key.substr(key.find('.') + 1), word);
  facts.emplace("diagnosis", "not_made");
  SqlRow row;
  for (const std::string& column : columns_in("calibration")) row.push_back(facts.emplace(column, "").first->second);
  return row;
}

std::vector<StoredValue> values_in(const ParameterFile& file) {
  std::vector<StoredValue> values;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    const std::string key = parameter_key(i);
    const std::optional<JudgedValue> value = recorded_judgement(file, key),
                                     sigma = recorded_judgement(file, "sigma." + key);
    const auto verdict = [](const auto& judged) { return judged ? std::string(to_string(judged->verdict)) : ""; };
    values.push_back({key, file.parameters[Eigen::Index(i)], file.sigma[i], value ? value->limit : Limit{},
                      verdict(value), sigma ? sigma->limit.max : std::nullopt, verdict(sigma)});
  }
  return values;
}

std::string not_of_file(const std::string& where, const std::string& what) {
  return where + ": " + what + " is not that of the parameter file in the row";
}

// Reads the values, and sets as defect the first column that differs from the parameter file, which has a checksum.
void read_file(const SqlRow& row, const std::string& where, StoredCalibration& c) {
  const Result<ParameterFile> file = parse_parameter_file(c.parameter_file, where + ", parameter file");
  if (file) {
    c.values = values_in(*file);
    c.gyro_increment = file->gyro_increment;
    const SqlRow made = row_of(*file, c.parameter_file, c.sessions, c.folder);
    const std::vector<std::string> columns = columns_in("calibration");
    for (std::size_t i = columns.size(); i-- > 0;) {
      // A file holds only values that fit in one line.
      const bool unsaid = made[i] == SqlValue("") && (columns[i] == "reason" || columns[i] == "verification");
      if (row[i] != made[i] && !unsaid) c.defect = not_of_file(where, columns[i]);
    }
  } else {
    c.defect = file.error().message;
  }
  if (!c.defect.empty()) c.verdict = "damaged";
}

using Page = std::vector<std::pair<std::int64_t, SqlRow>>;  // rows with their ids

// Returns the next rows after `last`.
Result<Page> page_of(SqlConnection& database, const std::string& table, std::int64_t last, std::int64_t end) {
  Page page;
  TRY(database.run(
      "SELECT " + column_list(table) + ", id FROM " + table + " WHERE id > $1 AND id <= $2 ORDER BY id LIMIT 100",
      {last, end}, [&](SqlRow row) {
        const std::int64_t id = sql_as<std::int64_t>(row.back());
        row.pop_back();
        page.emplace_back(id, std::move(row));
      }));
  return page;
}

Result<std::int64_t> last_id(SqlConnection& database, const std::string& table) {
  std::int64_t last = 0;
  TRY(database.run("SELECT max(id) FROM " + table, {},
                   [&](const SqlRow& row) { last = sql_as<std::int64_t>(row.front()); }));
  return last;
}

// Refuses an id that no row has had yet: it is of another database, and all new rows would be missed.
Status check_after(SqlConnection& database, const std::string& table, const RecordFilter& filter) {
  const std::int64_t last = filter.after > 0 ? TRY(last_id(database, table)) : 0;
  if (std::int64_t(filter.after) <= last) return {};
  return input_error("--after {}: the newest row of {} has id {}: expected an id of this database", filter.after,
                     database.name(), last);
}

constexpr const char* roles = R"(
DO $$ BEGIN
  IF NOT EXISTS (SELECT 1 FROM pg_roles WHERE rolname = 'turncal_station') THEN CREATE ROLE turncal_station; END IF;
  IF NOT EXISTS (SELECT 1 FROM pg_roles WHERE rolname = 'turncal_reader') THEN CREATE ROLE turncal_reader; END IF;
END $$;
REVOKE ALL ON calibration, value, statistics, attempt_note, schema_version, attempt, newest_calibration FROM PUBLIC;
GRANT SELECT ON calibration, value, statistics, attempt_note, schema_version, attempt, newest_calibration
  TO turncal_station, turncal_reader;
GRANT INSERT ON calibration, value, statistics, attempt_note TO turncal_station;
)";

}  // namespace

Fields fields_of(AttemptRecord& a) {
  return {{"run", &a.run},
          {"unit", &a.unit},
          {"began_utc", &a.began_utc},
          {"time_utc", &a.time_utc},
          {"outcome", &a.outcome},
          {"reason", &a.reason},
          {"simulated", &a.simulated},
          {"station", &a.station},
          {"operator", &a.operator_name},
          {"part", &a.part},
          {"revision", &a.revision},
          {"ambient", &a.ambient},
          {"temperature_min_c", &a.temperature_min_c},
          {"temperature_max_c", &a.temperature_max_c},
          {"residual", &a.residual},
          {"diagnosis", &a.diagnosis},
          {"recorded_s", &a.recorded_s},
          {"sessions", &a.sessions},
          {"repeated_dwells", &a.repeated_dwells},
          {"lost_samples", &a.lost_samples},
          {"folder", &a.folder},
          {"calibration", &a.calibration}};
}

Fields fields_of(RecordFilter& f) {
  return {{"unit", &f.unit},       {"station", &f.station}, {"part", &f.part},
          {"verdict", &f.verdict}, {"from", &f.from},       {"to", &f.to}};
}

Status check(const RecordFilter& filter) {
  for (const auto& [option, text] : {std::pair{"--from", &filter.from}, std::pair{"--to", &filter.to}})
    if (!begins_a_time(*text))
      return input_error(std::string(option) + " " + turncal::quoted(*text) +
                         ": expected a day of the calendar, or a time, as 2026-01-31 or 2026-01-31T12:00:00Z");
  std::vector<std::string> verdicts = {"captured",    "dropped", "refused",      "aborted",
                                       "interrupted", "failed",  outcome_running};
  verdicts.insert(verdicts.end(), enum_words<UnitVerdict>.begin(), enum_words<UnitVerdict>.end());
  TRY(expect_one_of("verdict", filter.verdict, verdicts));
  if (!filter.to.empty() && filter.from.substr(0, filter.to.size()) > filter.to)
    return input_error("--from " + turncal::quoted(filter.from) + ": is after --to " + turncal::quoted(filter.to));
  return {};
}

Status ResultsDatabase::check_known(const RecordFilter& filter) const {
  for (const auto& [column, wanted] : texts_of(filter)) {
    if (column != "unit" && column != "station" && column != "part") continue;
    std::vector<std::string> there;
    TRY(connection_->run("SELECT " + column + " FROM attempt UNION SELECT " + column + " FROM calibration ORDER BY 1",
                         {}, [&](const SqlRow& row) { there.push_back(sql_as<std::string>(row.front())); }));
    std::erase(there, "");
    TRY(expect_one_of(column, wanted, there));
  }
  return {};
}

Status ResultsDatabase::note(AttemptRecord attempt) {
  return in_transaction(*connection_, [&] { return add_attempt(attempt); });
}

Status ResultsDatabase::add_attempt(AttemptRecord& a) {
  SqlRow row = row_of(fields_of(a));
  if (a.run.empty()) row.front() = {};
  row.insert(row.begin(), key_of(a, row));
  static_cast<void>(TRY(insert(*connection_, "attempt_note", {row}, unique_attempt)));
  return {};
}

Result<std::vector<AttemptRecord>> ResultsDatabase::attempts(const RecordFilter& filter) const {
  TRY(check_after(*connection_, "attempt_note", filter));
  std::vector<AttemptRecord> found;
  AttemptRecord named;
  TRY(connection_->run(
      "SELECT " + column_list(with_id(named)) +
          " FROM (SELECT *, (SELECT count(DISTINCT unit) FROM attempt_note AS same WHERE same.run = attempt.run AND "
          "same.station = attempt.station) AS units FROM attempt) AS attempt WHERE " +
          where("outcome") +
          (filter.newest > 0 ? " ORDER BY time_utc DESC, id DESC LIMIT " + std::to_string(filter.newest)
                             : " ORDER BY time_utc, id"),
      values_of(filter), [&](const SqlRow& row) { take_row(row, with_id(found.emplace_back())); }));
  if (filter.newest > 0) std::ranges::reverse(found);
  return found;
}

Fields fields_of(StoredCalibration& c) {
  return {{"id", &c.id},
          {"unit", &c.unit},
          {"time_utc", &c.time_utc},
          {"verdict", &c.verdict},
          {"reason", &c.reason},
          {"station", &c.station},
          {"operator", &c.operator_name},
          {"simulated", &c.simulated},
          {"sessions", &c.sessions},
          {"recording_hash", &c.recording_hash},
          {"folder", &c.folder},
          {"parameter_file", &c.parameter_file}};
}

// Returns whether there are tables of this version.
Result<bool> ResultsDatabase::has_tables() const {
  const int version = TRY(version_of(*connection_));
  if (version == 0 || version == database_version) return version != 0;
  return input_error(connection_->name() + ": results database: its schema has version " + std::to_string(version) +
                     ", expected " + std::to_string(database_version) + ": another turncal made it");
}

// Makes the tables of an empty database, all or none; of stations that do so at once the second finds it done. keep: false only tries.
Status ResultsDatabase::make_tables(bool keep) const {
  if (TRY(has_tables()) && keep) return {};
  TRY(connection_->begin());
  const Status status = make_tables_in(*connection_);
  const Status ended = connection_->run(status && keep ? "COMMIT" : "ROLLBACK");
  return status ? ended : status;
}

Result<ResultsDatabase> ResultsDatabase::open(const std::string& name, const SqlPatience& patience) {
  const bool server = names_a_server(name);
  if (!server) TRY(make_folder(folder_of(name)));
  ResultsDatabase database(TRY(connect_to(name, SqlUse::make, patience)));
  TRY(database.make_tables(true));
  if (!server) TRY(database.connection_->run("PRAGMA synchronous = EXTRA; PRAGMA foreign_keys = ON"));
  return database;
}

Status ResultsDatabase::check_writable(const std::string& path) {
  // The folder is checked even when the file exists, because SQLite makes its journal beside it.
  if (Status status = check_folder_writable(folder_of(path)); !status || !path_exists(path)) return status;
  TRY(check_regular_file(path));
  return ResultsDatabase(TRY(connect_to(path, SqlUse::write, {.wait_s = 2.0}))).make_tables(false);
}

Result<ResultsDatabase> ResultsDatabase::open_to_read(const std::string& name, const SqlPatience& patience) {
  const bool server = names_a_server(name);
  if (!server && !path_exists(name))
    return input_error(name + ": there is no such results database" + file_meant(name));
  if (!server) TRY(expect_file(name, FileKind::database));
  TRY(server ? Status{} : check_regular_file(name));
  ResultsDatabase database(TRY(connect_to(name, SqlUse::read, patience)));
  if (TRY(database.has_tables())) return database;
  return input_error(name +
                     ": results database: holds no tables: expected one that a station or `turncal records roles` has "
                     "written to");
}

Status ResultsDatabase::add(const ParameterFile& file, AttemptRecord attempt, const SqlBytes& statistics) {
  const SqlRow row = row_of(file, TRY(format_parameter_file(file)), attempt.sessions, attempt.folder);
  return in_transaction(*connection_, [&]() -> Status {
    const AddedRow added = TRY(add_calibration(*connection_, row));
    attempt.calibration = added.id;
    std::vector<SqlRow> values;
    for (const StoredValue& v : values_in(file))
      values.push_back(
          {added.id, v.key, v.value, as_value(v.sigma), as_value(v.limit.min), as_value(v.limit.max), v.verdict});
    if (added.is_new) TRY(insert(*connection_, "value", values));
    if (added.is_new && !statistics.empty()) TRY(insert(*connection_, "statistics", {{added.id, statistics}}));
    return add_attempt(attempt);
  });
}

Status ResultsDatabase::each_calibration(bool with_statistics,
                                         const std::function<void(const StoredCalibration&)>& each) const {
  StoredCalibration named;
  const std::string asked = with_statistics ? ", contents" : "";
  const std::string join = with_statistics ? " LEFT JOIN statistics ON statistics.calibration = id" : "";
  return connection_->run(
      "SELECT " + column_list(fields_of(named)) + asked + " FROM newest_calibration" + join + " ORDER BY id", {},
      [&](const SqlRow& row) {
        StoredCalibration one;
        take_row(row, fields_of(one));
        if (with_statistics) one.statistics = sql_as<SqlBytes>(row.back());
        each(one);
      });
}

Result<std::vector<StoredCalibration>> ResultsDatabase::list(const RecordFilter& filter, const std::string& key) const {
  TRY(check_after(*connection_, "calibration", filter));
  std::vector<StoredCalibration> found;
  StoredCalibration named;
  const Fields fields = fields_of(named);
  TRY(connection_->run("SELECT " + column_list(fields) + ", " + column_list("calibration") +
                           " FROM newest_calibration WHERE " + where("verdict") + " ORDER BY time_utc, id",
                       values_of(filter), [&](const SqlRow& row) {
                         StoredCalibration& c = found.emplace_back();
                         take_row(row, fields_of(c));
                         read_file({row.begin() + std::ssize(fields), row.end()},
                                   connection_->name() + ": row " + std::to_string(c.id), c);
                         if (!key.empty()) std::erase_if(c.values, [&](const StoredValue& v) { return v.key != key; });
                       }));
  return found;
}

Status ResultsDatabase::check() const {
  if (connection_->sqlite()) TRY(check_pages());  // a server checks its pages itself
  const std::vector<StoredCalibration> calibrations = TRY(list({}, ""));
  std::map<std::int64_t, const StoredCalibration*> by_id;
  for (const StoredCalibration& c : calibrations) {
    if (!c.defect.empty()) return input_error(c.defect);
    by_id[c.id] = &c;
  }
  std::string defect;
  TRY(connection_->run("SELECT calibration, key, value, sigma FROM value", {}, [&](const SqlRow& row) {
    const auto of = by_id.find(sql_as<std::int64_t>(row[0]));
    const auto same = [&row](const StoredValue& v) {
      return v.key == sql_as<std::string>(row[1]) && v.value == as_number(row[2]) && v.sigma == as_number(row[3]);
    };
    if (defect.empty() && of != by_id.end() && std::ranges::none_of(of->second->values, same))
      defect = not_of_file(connection_->name() + ": row " + std::to_string(of->first), sql_as<std::string>(row[1]));
  }));
  static_cast<void>(TRY(attempts({})));
  return defect.empty() ? Status{} : input_error(defect);
}

DataTable attempts_table(const std::vector<AttemptRecord>& all) {
  const std::vector<std::string_view> words = split_words(
      "id unit began_utc time_utc outcome reason station part revision operator ambient simulated temperature_min_c "
      "temperature_max_c residual diagnosis recorded_s sessions repeated_dwells lost_samples calibration folder run");
  DataTable table({words.begin(), words.end()});
  for (AttemptRecord attempt : all) {
    const Fields fields = with_id(attempt);
    std::vector<DataCell> cells;
    for (const std::string_view word : words) cells.push_back(cell_of(field_named(word, fields)));
    table.row(std::move(cells));
  }
  return table;
}

DataTable calibrations_table(const std::vector<StoredCalibration>& all) {
  const auto exported = [](StoredCalibration& c) {
    Fields fields = fields_of(c);
    fields.pop_back();  // drops the parameter file
    for (StoredValue& v : c.values) fields.insert(fields.end(), {{v.key, &v.value}, {"sigma." + v.key, &v.sigma}});
    for (StoredValue& v : c.values)
      fields.insert(fields.end(), {{"min." + v.key, &v.limit.min},
                                   {"max." + v.key, &v.limit.max},
                                   {"verdict." + v.key, &v.verdict},
                                   {"sigma_max." + v.key, &v.sigma_max},
                                   {"verdict.sigma." + v.key, &v.sigma_verdict}});
    return fields;
  };
  StoredCalibration named;
  for (const std::string_view key : parameter_keys) named.values.emplace_back().key = key;
  std::vector<std::string> columns;
  for (const Field& field : exported(named)) columns.push_back(field.key);
  DataTable table(std::move(columns));
  for (StoredCalibration c : all) add_row(exported(c), table);
  return table;
}

// ---- upkeep: its check, its image for a backup, copies of its rows, and the roles of a server

Status ResultsDatabase::make_roles() {
  return in_transaction(*connection_, [this] { return connection_->run(roles); });
}

// Copies attempts up to the last one that exists now: their calibrations were added before them.
Result<CopiedRows> ResultsDatabase::copy_to(ResultsDatabase& other, bool moves) const {
  SqlConnection& from = *connection_;
  SqlConnection& to = *other.connection_;
  const std::int64_t last_attempt = TRY(last_id(from, "attempt_note"));
  const std::int64_t last_calibration = TRY(last_id(from, "calibration"));
  CopiedRows copied;
  std::map<std::int64_t, std::int64_t> number_there;
  for (std::int64_t last = 0;;) {
    const Page page = TRY(page_of(from, "calibration", last, last_calibration));
    if (page.empty()) break;
    const auto add = [&]() -> Status {
      std::set<std::int64_t> added;
      for (const auto& [id, row] : page) {
        const AddedRow there = TRY(add_calibration(to, row));
        number_there[id] = there.id;
        if (there.is_new) added.insert(id);
      }
      for (const std::string table : {"value", "statistics"}) {
        std::vector<SqlRow> rows;
        TRY(from.run(
            "SELECT " + column_list(table) + " FROM " + table + " WHERE calibration > $1 AND calibration <= $2",
            {last, page.back().first}, [&](SqlRow row) {
              const std::int64_t id = sql_as<std::int64_t>(row.front());
              if (!added.contains(id)) return;
              row.front() = number_there[id];
              rows.push_back(std::move(row));
            }));
        TRY(insert(to, table, rows));
      }
      copied.calibrations += std::ssize(added);
      return {};
    };
    TRY(in_transaction(to, add));
    last = page.back().first;
  }
  for (std::int64_t last = 0;;) {
    Page page = TRY(page_of(from, "attempt_note", last, last_attempt));
    if (page.empty()) break;
    last = page.back().first;
    std::vector<SqlRow> rows;
    for (auto& [id, row] : page) {
      SqlValue& calibration = row.back();
      const auto there = number_there.find(sql_as<std::int64_t>(calibration));
      // A row that has reused the number of a deleted one may name a calibration that was not copied: it waits for the next time.
      if (as_number(calibration) && there == number_there.end()) continue;
      if (as_number(calibration)) calibration = there->second;
      rows.push_back(std::move(row));
    }
    const auto add = [&]() -> Status {
      copied.attempts += std::ssize(TRY(insert(to, "attempt_note", rows, unique_attempt)));
      return {};
    };
    const auto take_away = [&]() -> Status {
      for (const SqlRow& row : rows) TRY(from.run("DELETE FROM attempt_note WHERE key = $1", {row.front()}));
      return {};
    };
    TRY(in_transaction(to, add));
    if (moves) TRY(in_transaction(from, take_away));
  }
  if (!moves) return copied;
  // A calibration is added together with a row of its attempt, so a calibration without one has been copied.
  TRY(
      from.run("DELETE FROM calibration WHERE NOT EXISTS (SELECT 1 FROM attempt_note WHERE attempt_note.calibration = "
               "calibration.id)"));
  return copied;
}

Status ResultsDatabase::check_pages() const {
  const auto damaged = [this](const std::string& what) {
    return input_error(connection_->name() + ": results database: damaged: " + what);
  };
  std::string found;
  TRY(connection_->run("PRAGMA integrity_check(1)", {},
                       [&](const SqlRow& row) { found = sql_as<std::string>(row[0]); }));
  if (found != "ok") return damaged(found);
  found.clear();
  const auto say = [&](const SqlRow& row) {
    if (found.empty())
      found = "row " + std::to_string(sql_as<std::int64_t>(row[1])) + " of " + sql_as<std::string>(row[0]) +
              " names a row of " + sql_as<std::string>(row[2]) + " that is not there";
  };
  TRY(connection_->run("PRAGMA foreign_key_check", {}, say));
  return found.empty() ? Status{} : damaged(found);
}

Status ResultsDatabase::copy_into(const std::string& path) const {
  if (connection_->sqlite()) {
    const Status made = connection_->run("VACUUM INTO $1", {path});
    return made ? made : Error{made.error().kind, path + ": copy of " + made.error().message};
  }
  ResultsDatabase copy = TRY(open(path));
  return in_transaction(*connection_, [&]() -> Status {  // of one moment
    const Result<CopiedRows> rows = copy_to(copy);
    return rows ? Status{} : rows.error();
  });
}

constexpr SqlPatience short_patience{.wait_s = 3.0, .all_s = longest_wait_s};

std::string records_file(const StationConfig& station) {
  return names_a_server(station.database) ? station.outbox : station.database;
}

std::string send_records(const StationConfig& station) {
  if (!names_a_server(station.database) || !path_exists(station.outbox)) return "";
  const Result<ResultsDatabase> kept = ResultsDatabase::open(station.outbox);
  if (!kept) return kept.error().message;
  const auto waiting = kept->attempts({});
  if (!waiting) return waiting.error().message;
  if (waiting->empty()) return "";
  Result<ResultsDatabase> server = ResultsDatabase::open(station.database, short_patience);
  const Result<CopiedRows> sent = server ? kept->copy_to(*server, true) : Result<CopiedRows>(server.error());
  if (sent) return "";
  const auto left = kept->attempts({});
  const std::size_t count = left ? left->size() : waiting->size();
  return sent.error().message + "; " + std::to_string(count) + (count == 1 ? " attempt is" : " attempts are") +
         " kept in " + station.outbox + " and sent later";
}

std::string server_trouble(const StationConfig& station) {
  if (!names_a_server(station.database)) return "";
  const Result<ResultsDatabase> server = ResultsDatabase::open_to_read(station.database, short_patience);
  return server ? "" : server.error().message;
}

Result<std::vector<AttemptRecord>> recorded_attempts(const StationConfig& station, const RecordFilter& filter,
                                                     std::string& trouble) {
  std::vector<AttemptRecord> all;
  const auto take = [&](const std::string& name) -> Status {
    const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(name, short_patience));
    const std::vector<AttemptRecord> some = TRY(database.attempts(filter));
    all.insert(all.end(), some.begin(), some.end());
    return {};
  };
  trouble.clear();
  const std::string file = records_file(station);
  std::error_code missing;
  if (!std::filesystem::is_empty(file, missing) && !missing) TRY(take(file));
  if (!names_a_server(station.database)) return all;
  // Waiting rows are newer than the server's rows of this station, and show that the server was away a moment ago.
  if (!all.empty())
    trouble = station.database + ": results database: not all of it: " + station.outbox + " keeps rows for it";
  else if (Status status = take(station.database); !status)
    trouble = status.error().message;
  return all;
}

}  // namespace turncal
