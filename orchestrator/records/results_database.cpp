#include "orchestrator/records/results_database.h"

#include <sqlite3.h>

#include <algorithm>
#include <map>

#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/records/database_rows.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

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
    const auto key = std::find(parameter_keys.begin(), parameter_keys.end(), value.key);
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
  if (!server) {
    TRY(make_folder(folder_of(name)));
  }
  std::shared_ptr<SqlConnection> connection =
      TRY(server ? connect_to_server(name, true, patience)
                 : connect_to_file(name, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, patience));
  ResultsDatabase database(std::move(connection));
  TRY(database.make_tables(true));
  if (!server) {
    if (Status s = database.connection_->run("PRAGMA synchronous = EXTRA; PRAGMA foreign_keys = ON"); !s)
      return s.error();
  }
  return database;
}

Status ResultsDatabase::check_writable(const std::string& path) {
  // The folder too when the file is there: its journal is made beside it.
  if (Status status = check_folder_writable(folder_of(path)); !status || !path_exists(path)) return status;
  TRY(check_regular_file(path));
  Result<std::shared_ptr<SqlConnection>> connection = connect_to_file(path, SQLITE_OPEN_READWRITE, {.wait_s = 2.0});
  if (!connection) return connection.error();
  return ResultsDatabase(std::move(*connection)).make_tables(false);
}

Result<ResultsDatabase> ResultsDatabase::open_to_read(const std::string& name, const SqlPatience& patience) {
  const bool server = names_a_server(name);
  if (!server && !path_exists(name)) return input_error(name + ": there is no such results database");
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
                       ": results database: holds no tables: expected one that a station or `turncal database "
                       "roles` has written to");
  // Reading changes nothing: an empty one gets its tables in memory.
  const std::string image = TRY(database.image());
  Result<ResultsDatabase> copy = of_image(image, name);
  if (!copy) return copy;
  copy->stored_version_ = database.stored_version_;
  TRY(copy->make_tables(true));
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
    const auto judged = std::find_if(verdict.values.begin(), verdict.values.end(),
                                     [&key](const JudgedValue& value) { return value.key == key; });
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
  Status status =
      connection_->run("SELECT " + columns_of(fields_of(named)) + ", parameter_file FROM newest_calibration WHERE " +
                           where("verdict") + " ORDER BY time_utc, id",
                       values_of(filter), [&](const SqlRow& row) {
                         StoredCalibration& calibration = found.emplace_back();
                         take_row(row, fields_of(calibration));
                         files.push_back(as_text(row.back()));
                         place[calibration.id] = found.size() - 1;
                       });
  if (!status) return status.error();
  SqlRow wanted = values_of(filter);
  wanted.emplace_back(key);
  status = connection_->run(
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
      });
  if (!status) return status.error();
  const auto rank = [](const StoredValue& value) {
    return std::find(parameter_keys.begin(), parameter_keys.end(), value.key);
  };
  for (std::size_t i = 0; i < found.size(); ++i) {
    StoredCalibration& c = found[i];
    std::sort(c.values.begin(), c.values.end(), [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
    c.defect = defect_of(c, files[i], connection_->name() + ": row " + std::to_string(c.id));
    if (!c.defect.empty()) c.verdict = "damaged";
  }
  return found;
}

}  // namespace turncal
