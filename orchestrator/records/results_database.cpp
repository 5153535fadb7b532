#include "orchestrator/records/results_database.h"

#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <map>

#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/records/database_rows.h"

namespace turncal {

namespace {

// Of a day that there is.
bool begins_a_time(const std::string& text) {
  constexpr std::string_view first = "0001-01-01T00:00:00Z";
  constexpr std::size_t shortest = 4;  // a year
  if (text.empty()) return true;
  if (text.size() < shortest || text.size() > first.size() || text.back() == '-' || text.back() == ':') return false;
  return parse_utc(text + std::string(first.substr(text.size()))).has_value();
}

// What is the same for the same row, wherever it comes from; a refusal before there was a run has nothing but its moment.
std::string key_of(const AttemptRecord& a, const SqlRow& row) {
  const std::string whose = a.unit + "|" + a.station + "|";
  if (a.run.empty()) {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return "refused|" + whose + std::to_string(std::chrono::nanoseconds(now).count()) + "|" +
           std::to_string(::getpid());
  }
  std::string all;
  for (std::size_t i = 0; i + 1 < row.size(); ++i) {  // without its calibration, which has another number elsewhere
    const std::optional<double> number = as_number(row[i]);
    all += (number ? format_number(*number) : as_text(row[i])) + '\x1f';
  }
  return a.run + "|" + whose + hash_of_text(all);
}

Status expect_one_of(const std::string& option, const std::string& word, const std::vector<std::string>& there) {
  if (word.empty() || std::ranges::find(there, word) != there.end()) return {};
  constexpr std::size_t shown = 14;
  std::string some;
  for (std::size_t i = 0; i < std::min(shown, there.size()); ++i) some += (i > 0 ? ", " : "") + there[i];
  return input_error("--" + option + " " + turncal::quoted(word) + ": no row has it: expected " +
                     (there.empty() ? "none" : "one of " + some) + (there.size() > shown ? ", ..." : ""));
}

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

namespace {

Fields with_id(AttemptRecord& attempt) {
  Fields fields = fields_of(attempt);
  fields.push_back({"id", &attempt.id});
  return fields;
}

}  // namespace

Fields fields_of(RecordFilter& f) {
  return {{"unit", &f.unit},       {"station", &f.station}, {"part", &f.part},
          {"verdict", &f.verdict}, {"from", &f.from},       {"to", &f.to}};
}

Status check(const RecordFilter& filter) {
  for (const auto& [option, text] : {std::pair{"--from", &filter.from}, std::pair{"--to", &filter.to}})
    if (!begins_a_time(*text))
      return input_error(std::string(option) + " " + turncal::quoted(*text) +
                         ": expected a date or a time as 2026-01-31 or 2026-01-31T12:00:00Z");
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
                         {}, [&](const SqlRow& row) { there.push_back(as_text(row.front())); }));
    std::erase(there, "");
    TRY(expect_one_of(column, wanted, there));
  }
  return {};
}

Status ResultsDatabase::note(AttemptRecord a) {
  SqlRow row = row_of(fields_of(a));
  if (a.run.empty()) row.front() = {};
  row.insert(row.begin(), key_of(a, row));
  static_cast<void>(TRY(insert(*connection_, "attempt_note", {row}, unique_attempt)));
  return {};
}

Result<std::vector<AttemptRecord>> ResultsDatabase::attempts(const RecordFilter& filter) const {
  std::vector<AttemptRecord> found;
  AttemptRecord named;
  TRY(connection_->run(
      "SELECT " + columns_of(with_id(named)) + " FROM attempt WHERE " + where("outcome") +
          (filter.newest > 0 ? " ORDER BY time_utc DESC, id DESC LIMIT " + std::to_string(filter.newest)
                             : " ORDER BY time_utc, id"),
      values_of(filter), [&](const SqlRow& row) { take_row(row, with_id(found.emplace_back())); }));
  if (filter.newest > 0) std::ranges::reverse(found);
  return found;
}

namespace {

// The row of a parameter file: a column that is none of its facts is a key of its verdict or its record.
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
    const std::optional<JudgedValue> judged = recorded_judgement(file, key);
    values.push_back({key, file.parameters[Eigen::Index(i)], file.sigma[i], judged ? judged->limit : Limit{},
                      judged ? std::string(to_string(judged->verdict)) : ""});
  }
  return values;
}

std::string not_of_file(const std::string& where, const std::string& what) {
  return where + ": " + what + " is not that of the parameter file in the row";
}

// Values and defect: the first of the columns that its parameter file, which has a checksum, does not have like that.
void read_file(const SqlRow& row, const std::string& where, StoredCalibration& c) {
  const Result<ParameterFile> file = parse_parameter_file(c.parameter_file, where + ", parameter file");
  if (file) {
    c.values = values_in(*file);
    c.gyro_increment = file->gyro_increment;
    const SqlRow made = row_of(*file, c.parameter_file, c.sessions, c.folder);
    const std::vector<std::string> columns = columns_in("calibration");
    for (std::size_t i = columns.size(); i-- > 0;) {
      // A file has only what can stand in one of its lines.
      const bool unsaid = made[i] == SqlValue("") && (columns[i] == "reason" || columns[i] == "verification");
      if (row[i] != made[i] && !unsaid) c.defect = not_of_file(where, columns[i]);
    }
  } else {
    c.defect = file.error().message;
  }
  if (!c.defect.empty()) c.verdict = "damaged";
}

}  // namespace

Fields fields_of(StoredCalibration& c) {
  return {{"id", &c.id},
          {"unit", &c.unit},
          {"time_utc", &c.time_utc},
          {"verdict", &c.verdict},
          {"station", &c.station},
          {"operator", &c.operator_name},
          {"simulated", &c.simulated},
          {"sessions", &c.sessions},
          {"recording_hash", &c.recording_hash},
          {"folder", &c.folder},
          {"parameter_file", &c.parameter_file}};
}

// Whether there are tables, of this version.
Result<bool> ResultsDatabase::has_tables() const {
  const int version = TRY(version_of(*connection_));
  if (version == 0 || version == database_version) return version != 0;
  return input_error(connection_->name() + ": results database: its schema has version " + std::to_string(version) +
                     ", expected " + std::to_string(database_version) + ": another turncal made it");
}

// An empty one gets its tables, whole or not at all; of stations that do so at once the second finds it done. keep: false only tries.
Status ResultsDatabase::make_tables(bool keep) const {
  if (TRY(has_tables()) && keep) return {};
  TRY(connection_->begin());
  const Status status = turncal::make_tables(*connection_);
  const Status ended = connection_->run(status && keep ? "COMMIT" : "ROLLBACK");
  return status ? ended : status;
}

Result<ResultsDatabase> ResultsDatabase::open(const std::string& name, const SqlPatience& patience) {
  const bool server = names_a_server(name);
  if (!server) TRY(make_folder(folder_of(name)));
  std::shared_ptr<SqlConnection> connection =
      TRY(server ? connect_to_server(name, true, patience)
                 : connect_to_file(name, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, patience));
  ResultsDatabase database(std::move(connection));
  TRY(database.make_tables(true));
  if (!server) TRY(database.connection_->run("PRAGMA synchronous = EXTRA; PRAGMA foreign_keys = ON"));
  return database;
}

Status ResultsDatabase::check_writable(const std::string& path) {
  // The folder too when the file is there: its journal is made beside it.
  if (Status status = check_folder_writable(folder_of(path)); !status || !path_exists(path)) return status;
  TRY(check_regular_file(path));
  return ResultsDatabase(TRY(connect_to_file(path, SQLITE_OPEN_READWRITE, {.wait_s = 2.0}))).make_tables(false);
}

Result<ResultsDatabase> ResultsDatabase::open_to_read(const std::string& name, const SqlPatience& patience) {
  const bool server = names_a_server(name);
  if (!server && !path_exists(name)) return input_error(name + ": there is no such results database");
  if (!server) TRY(expect_file(name, FileKind::database));
  TRY(server ? Status{} : check_regular_file(name));
  std::shared_ptr<SqlConnection> connection =
      TRY(server ? connect_to_server(name, false, patience) : connect_to_file(name, SQLITE_OPEN_READONLY, patience));
  ResultsDatabase database(std::move(connection));
  if (TRY(database.has_tables())) return database;
  if (server)
    return input_error(name +
                       ": results database: holds no tables: expected one that a station or `turncal records "
                       "roles` has written to");
  ResultsDatabase empty = TRY(in_memory(name));  // reading changes nothing
  TRY(empty.make_tables(true));
  return empty;
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
    return note(attempt);
  });
}

Status ResultsDatabase::each_calibration(bool with_statistics,
                                         const std::function<void(const StoredCalibration&)>& each) const {
  StoredCalibration named;
  const std::string asked = with_statistics ? ", contents" : "";
  const std::string join = with_statistics ? " LEFT JOIN statistics ON statistics.calibration = id" : "";
  return connection_->run(
      "SELECT " + columns_of(fields_of(named)) + asked + " FROM newest_calibration" + join + " ORDER BY id", {},
      [&](const SqlRow& row) {
        StoredCalibration one;
        take_row(row, fields_of(one));
        if (with_statistics) one.statistics = as_bytes(row.back());
        each(one);
      });
}

Result<std::vector<StoredCalibration>> ResultsDatabase::list(const RecordFilter& filter, const std::string& key) const {
  std::vector<StoredCalibration> found;
  StoredCalibration named;
  const Fields fields = fields_of(named);
  TRY(connection_->run("SELECT " + columns_of(fields) + ", " + columns_of("calibration") +
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
  if (connection_->sqlite()) TRY(check_pages());  // a server sees to that itself
  const std::vector<StoredCalibration> calibrations = TRY(list({}, ""));
  std::map<std::int64_t, const StoredCalibration*> by_id;
  for (const StoredCalibration& c : calibrations) {
    if (!c.defect.empty()) return input_error(c.defect);
    by_id[c.id] = &c;
  }
  std::string defect;
  TRY(connection_->run("SELECT calibration, key, value, sigma FROM value", {}, [&](const SqlRow& row) {
    const auto of = by_id.find(as_integer(row[0]));
    const auto same = [&row](const StoredValue& v) {
      return v.key == as_text(row[1]) && v.value == as_number(row[2]) && v.sigma == as_number(row[3]);
    };
    if (defect.empty() && of != by_id.end() && std::ranges::none_of(of->second->values, same))
      defect = not_of_file(connection_->name() + ": row " + std::to_string(of->first), as_text(row[1]));
  }));
  static_cast<void>(TRY(attempts({})));
  return defect.empty() ? Status{} : input_error(defect);
}

DataTable attempts_table(const std::vector<AttemptRecord>& all) {
  const std::vector<std::string_view> words = split_words(
      "id unit began_utc time_utc outcome reason station part revision operator ambient simulated temperature_min_c "
      "temperature_max_c residual diagnosis recorded_s sessions repeated_dwells lost_samples calibration folder");
  DataTable table({words.begin(), words.end()});
  for (AttemptRecord attempt : all) {
    const Fields fields = with_id(attempt);
    table.begin_row();
    for (const std::string_view word : words) add_cell(field_named(word, fields), table);
  }
  return table;
}

DataTable calibrations_table(const std::vector<StoredCalibration>& all) {
  const auto exported = [](StoredCalibration& c) {
    Fields fields = fields_of(c);
    fields.pop_back();  // the parameter file
    return fields;
  };
  std::vector<std::string> columns;
  StoredCalibration named;
  for (const Field& field : exported(named)) columns.push_back(field.key);
  for (const std::string_view key : parameter_keys)
    for (const char* what : {"", "sigma."}) columns.push_back(what + std::string(key));
  for (const std::string_view key : parameter_keys)
    for (const char* what : {"min.", "max.", "verdict."}) columns.push_back(what + std::string(key));
  DataTable table(std::move(columns));
  for (StoredCalibration c : all) {
    add_row(exported(c), table);
    for (StoredValue& v : c.values)
      for (const Field& field : Fields{{"", &v.value}, {"", &v.sigma}}) add_cell(field, table);
    for (StoredValue& v : c.values)
      for (const Field& field : Fields{{"", &v.limit.min}, {"", &v.limit.max}, {"", &v.verdict}})
        add_cell(field, table);
  }
  return table;
}

}  // namespace turncal
