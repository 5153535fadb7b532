#include "orchestrator/records/results_database.h"

#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <map>

#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
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

Status check(const RecordFilter& filter) {
  for (const auto& [option, text] : {std::pair{"--from", &filter.from}, std::pair{"--to", &filter.to}})
    if (!begins_a_time(*text))
      return input_error(std::string(option) + " " + turncal::quoted(*text) +
                         ": expected a date or a time as 2026-01-31 or 2026-01-31T12:00:00Z");
  std::vector<std::string> verdicts = {"captured",    "dropped", "refused",      "aborted",
                                       "interrupted", "failed",  outcome_running};
  for (int v = 0; v <= static_cast<int>(UnitVerdict::fail); ++v)
    verdicts.emplace_back(to_string(static_cast<UnitVerdict>(v)));
  TRY(expect_one_of("verdict", filter.verdict, verdicts));
  if (!filter.to.empty() && filter.from.substr(0, filter.to.size()) > filter.to)
    return input_error("--from " + turncal::quoted(filter.from) + ": is after --to " + turncal::quoted(filter.to));
  return {};
}

Status ResultsDatabase::check_known(const RecordFilter& filter) const {
  const std::pair<std::string, const std::string*> words[] = {
      {"unit", &filter.unit}, {"station", &filter.station}, {"part", &filter.part}};
  for (const auto& [column, wanted] : words) {
    if (wanted->empty()) continue;
    std::vector<std::string> there;
    TRY(connection_->run("SELECT " + column + " FROM attempt UNION SELECT " + column + " FROM calibration ORDER BY 1",
                         {}, [&](const SqlRow& row) { there.push_back(as_text(row.front())); }));
    std::erase(there, "");
    TRY(expect_one_of(column, *wanted, there));
  }
  return {};
}

Status ResultsDatabase::note(AttemptRecord a) {
  SqlRow row = row_of(fields_of(a));
  if (a.run.empty()) row.front() = {};
  static_cast<void>(TRY(add_attempt_row(*connection_, key_of(a, row), row)));
  return {};
}

Result<std::vector<AttemptRecord>> ResultsDatabase::attempts(const RecordFilter& filter) const {
  std::vector<AttemptRecord> found;
  const auto take = [&](const SqlRow& row) {
    AttemptRecord& attempt = found.emplace_back();
    Fields fields = fields_of(attempt);
    fields.push_back({"id", &attempt.id});
    take_row(row, fields);
  };
  TRY(connection_->run(
      "SELECT " + attempt_columns() + ", id FROM attempt WHERE " + where("outcome") +
          (filter.newest > 0 ? " ORDER BY time_utc DESC, id DESC LIMIT " + std::to_string(filter.newest)
                             : " ORDER BY time_utc, id"),
      values_of(filter), take));
  if (filter.newest > 0) std::ranges::reverse(found);
  return found;
}

namespace {

std::string record_value(const ParameterFile& file, std::string_view column) {
  const std::string* const value = find_further(file, "record." + std::string(column));
  return value ? *value : "";
}

// Which of a row's entries its parameter file, which has a checksum, does not have like that. Empty: none.
std::string defect_of(const StoredCalibration& row, const std::string& text, const std::string& where) {
  const Result<ParameterFile> file = parse_parameter_file(text, where + ", parameter file");
  if (!file) return file.error().message;
  const auto differs = [&where](std::string_view what) {
    return where + ": " + std::string(what) + " is not that of the parameter file in the row";
  };
  const std::pair<const char*, bool> entries[] = {{"unit", row.unit == file->unit_serial},
                                                  {"time_utc", row.time_utc == file->time_utc},
                                                  {"recording_hash", row.recording_hash == file->recording_hash},
                                                  {"simulated", row.simulated == file->simulated},
                                                  {"station", row.station == record_value(*file, "station")},
                                                  {"operator", row.operator_name == record_value(*file, "operator")}};
  for (const auto& [name, same] : entries) {
    if (!same) return differs(name);
  }
  const std::string* const judged = find_further(*file, "verdict.result");
  const std::string said = judged ? *judged : "not_judged";
  if (said != row.verdict) return differs("verdict");
  for (const StoredValue& value : row.values) {
    const auto key = std::ranges::find(parameter_keys, value.key);
    if (key == parameter_keys.end()) return differs(value.key);
    const auto i = static_cast<std::size_t>(key - parameter_keys.begin());
    if (value.value != file->parameters[static_cast<Eigen::Index>(i)] || value.sigma != file->sigma[i])
      return differs(value.key);
  }
  return "";
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
          {"folder", &c.folder}};
}

Status ResultsDatabase::check_version() const {
  const int version = TRY(version_of(*connection_));
  if (version == 0 || version == database_version) return {};
  return input_error(connection_->name() + ": results database: its schema has version " + std::to_string(version) +
                     ", expected " + std::to_string(database_version) + ": another turncal made it");
}

// An empty one gets its tables, whole or not at all; of stations that do so at once the second finds it done.
Status ResultsDatabase::make_tables(bool keep) const {
  TRY(check_version());
  const int version = TRY(version_of(*connection_));
  if (keep && version == database_version) return {};
  if (keep) return in_transaction(*connection_, [this] { return turncal::make_tables(*connection_); });
  TRY(connection_->begin());
  const Status status = turncal::make_tables(*connection_);
  const Status undone = connection_->run("ROLLBACK");
  return status ? undone : status;
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
  TRY(database.check_version());
  const int version = TRY(version_of(*database.connection_));
  database.stored_version_ = version;
  if (version == database_version) return database;
  if (server)
    return input_error(name +
                       ": results database: holds no tables: expected one that a station or `turncal records "
                       "roles` has written to");
  // Reading changes nothing: an empty one gets its tables in memory.
  const std::string image = TRY(database.image());
  ResultsDatabase copy = TRY(of_image(image, name));
  copy.stored_version_ = database.stored_version_;
  TRY(copy.make_tables(true));
  return copy;
}

Status ResultsDatabase::add(const ParameterFile& file, const VerdictReport& verdict, AttemptRecord attempt,
                            const SqlBytes& statistics) {
  const std::string text = TRY(format_parameter_file(file));
  SqlRow row = {file.unit_serial,
                file.time_utc,
                file.method,
                file.recording_hash,
                file.software_version,
                std::int64_t{file.simulated},
                std::string(to_string(verdict.verdict)),
                verdict.rule,
                std::int64_t{attempt.sessions},
                attempt.folder,
                text,
                file.model,
                verdict.diagnosis,
                verdict.reason,
                verdict.verification,
                hash_of_text(text)};
  const std::vector<std::string_view> columns = split(calibration_columns, ',');
  for (std::size_t i = row.size(); i < columns.size(); ++i) row.emplace_back(record_value(file, columns[i]));
  std::vector<SqlRow> values;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    const std::string key(parameter_keys[i]);
    const auto judged =
        std::ranges::find_if(verdict.values, [&key](const JudgedValue& value) { return value.key == key; });
    const bool is_judged = judged != verdict.values.end();
    values.push_back({key, file.parameters[static_cast<Eigen::Index>(i)], as_value(file.sigma[i]),
                      as_value(is_judged ? judged->limit.min : std::nullopt),
                      as_value(is_judged ? judged->limit.max : std::nullopt),
                      is_judged ? std::string(to_string(judged->verdict)) : ""});
  }
  return in_transaction(*connection_, [&]() -> Status {
    const AddedRow added = TRY(add_calibration_row(*connection_, row, values, statistics));
    attempt.calibration = added.id;
    return note(attempt);
  });
}

Status ResultsDatabase::each_calibration(bool with_statistics, const std::function<void(KeptCalibration)>& each) const {
  const std::string asked = with_statistics ? ", contents" : "";
  const std::string join = with_statistics ? " LEFT JOIN statistics ON statistics.calibration = id" : "";
  return connection_->run(
      "SELECT id, folder, parameter_file" + asked + " FROM newest_calibration" + join + " ORDER BY id", {},
      [&](const SqlRow& row) {
        each({as_integer(row[0]), as_text(row[1]), as_text(row[2]), with_statistics ? as_bytes(row[3]) : SqlBytes()});
      });
}

Result<std::vector<StoredCalibration>> ResultsDatabase::list(const RecordFilter& filter, const std::string& key) const {
  std::vector<StoredCalibration> found;
  std::vector<std::string> files;
  std::map<std::int64_t, std::size_t> place;
  StoredCalibration named;
  TRY(connection_->run("SELECT " + columns_of(fields_of(named)) + ", parameter_file FROM newest_calibration WHERE " +
                           where("verdict") + " ORDER BY time_utc, id",
                       values_of(filter), [&](const SqlRow& row) {
                         StoredCalibration& calibration = found.emplace_back();
                         take_row(row, fields_of(calibration));
                         files.push_back(as_text(row.back()));
                         place[calibration.id] = found.size() - 1;
                       }));
  SqlRow wanted = values_of(filter);
  wanted.emplace_back(key);
  TRY(connection_->run(
      "SELECT calibration, key, value, sigma, limit_min, limit_max, verdict FROM value WHERE calibration IN (SELECT id "
      "FROM newest_calibration WHERE " +
          where("verdict") + ") AND ($7 = '' OR key = $7)",
      wanted, [&](const SqlRow& row) {
        const auto of = place.find(as_integer(row[0]));
        if (of == place.end()) return;  // added after the first question
        found[of->second].values.push_back({as_text(row[1]),
                                            as_number(row[2]).value_or(0.0),
                                            as_number(row[3]),
                                            {as_number(row[4]), as_number(row[5])},
                                            as_text(row[6])});
      }));
  const auto rank = [](const StoredValue& value) { return std::ranges::find(parameter_keys, value.key); };
  for (std::size_t i = 0; i < found.size(); ++i) {
    StoredCalibration& c = found[i];
    std::ranges::sort(c.values, [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
    c.defect = defect_of(c, files[i], connection_->name() + ": row " + std::to_string(c.id));
    if (!c.defect.empty()) c.verdict = "damaged";
  }
  return found;
}

}  // namespace turncal
