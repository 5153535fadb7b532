#include "orchestrator/records/results_database.h"

#include <sqlite3.h>

#include <algorithm>
#include <filesystem>

#include "imu_io/base/posix_file.h"
#include "orchestrator/records/database_schema.h"
#include "orchestrator/records/sqlite_statement.h"

namespace turncal {

namespace {

// Columns that come from the parameter file's record.* keys of the same name.
constexpr const char* record_columns[] = {"station",        "operator",
                                          "part",           "revision",
                                          "ambient",        "configuration_hash",
                                          "sequence",       "sequence_hash",
                                          "table_id",       "table_calibration_due",
                                          "overdue_reason", "repeated_dwells",
                                          "lost_samples"};

std::string record_value(const ParameterFile& file, const std::string& column) {
  const std::string key = "record." + column;
  const auto found =
      std::find_if(file.further.begin(), file.further.end(), [&](const auto& f) { return f.first == key; });
  return found == file.further.end() ? "" : found->second;
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
  const auto judged = std::find_if(file->further.begin(), file->further.end(),
                                   [](const auto& field) { return field.first == "verdict.result"; });
  // A file without a verdict was not judged.
  const std::string said = judged != file->further.end() ? judged->second : "not_judged";
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

ResultsDatabase::ResultsDatabase(sqlite3* handle, std::string path)
    : handle_(handle, [](sqlite3* h) { sqlite3_close(h); }), path_(std::move(path)) {}

Error ResultsDatabase::failure(const std::string& what) const {
  const int code = sqlite3_errcode(handle_.get());
  const bool not_ours = code == SQLITE_NOTADB || code == SQLITE_ERROR;  // the rest is locked, full, read-only or broken
  return {not_ours ? ErrorKind::input : ErrorKind::device,
          path_ + ": results database: " + what + ": " + sqlite3_errmsg(handle_.get())};
}

Status ResultsDatabase::execute(const char* sql) const {
  if (sqlite3_exec(handle_.get(), sql, nullptr, nullptr, nullptr) == SQLITE_OK) return {};
  return failure("cannot write");
}

Status ResultsDatabase::check_version() const {
  const int version = version_of(handle_.get());
  if (version < 0) return failure("cannot read");
  if (version <= database_version) return {};
  return input_error(path_ + ": results database: its schema has version " + std::to_string(version) +
                     ", expected at most " + std::to_string(database_version) + ": a newer turncal made it");
}

// An older one becomes the newest, whole or not at all; of stations that do so at once the second finds it done.
Status ResultsDatabase::bring_up_to_date(bool keep) const {
  if (Status status = check_version(); !status) return status;
  if (keep && version_of(handle_.get()) == database_version) return {};
  if (Status status = execute("BEGIN IMMEDIATE"); !status) return status;
  Status status = migrate(handle_.get()) ? Status{} : failure("cannot write");
  if (status) status = execute(keep ? "COMMIT" : "ROLLBACK");
  if (!status) sqlite3_exec(handle_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
  return status;
}

Result<ResultsDatabase> ResultsDatabase::connect(const std::string& path, int flags, int patience_ms) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &handle, flags, nullptr);
  ResultsDatabase database(handle, path);
  if (code != SQLITE_OK) return database.failure("cannot open");
  sqlite3_busy_timeout(handle, patience_ms);  // another station may write
  return database;
}

Result<ResultsDatabase> ResultsDatabase::open(const std::string& path) {
  if (Status status = make_folder(folder_of(path)); !status) return status.error();
  Result<ResultsDatabase> database = connect(path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, 10'000);
  if (!database) return database;
  for (const char* sql : {"PRAGMA synchronous = EXTRA", "PRAGMA foreign_keys = ON"}) {
    if (Status status = database->execute(sql); !status) return status.error();
  }
  if (Status status = database->bring_up_to_date(true); !status) return status.error();
  return database;
}

Status ResultsDatabase::check_writable(const std::string& path) {
  // The folder too when the file is there: its journal is made beside it.
  if (Status status = check_folder_writable(folder_of(path)); !status || !path_exists(path)) return status;
  if (Status status = check_regular_file(path); !status) return status;
  const Result<ResultsDatabase> database = connect(path, SQLITE_OPEN_READWRITE, 2'000);
  if (!database) return database.error();
  return database->bring_up_to_date(false);
}

Result<ResultsDatabase> ResultsDatabase::open_to_read(const std::string& path) {
  if (!path_exists(path)) return input_error(path + ": there is no such results database");
  if (Status status = check_regular_file(path); !status) return status.error();
  Result<ResultsDatabase> database = connect(path, SQLITE_OPEN_READONLY, 10'000);
  if (!database) return database;
  if (Status status = database->check_version(); !status) return status.error();
  database->stored_version_ = version_of(database->handle_.get());
  if (database->stored_version_ == database_version) return database;
  // Reading changes nothing: an older one is brought up to date in memory.
  const Result<std::string> image = database->image();
  if (!image) return image.error();
  Result<ResultsDatabase> copy = of_image(*image, path);
  if (!copy) return copy;
  copy->stored_version_ = database->stored_version_;
  if (Status status = copy->bring_up_to_date(true); !status) return status.error();
  return copy;
}

Status ResultsDatabase::add(const ParameterFile& file, const VerdictReport& verdict, AttemptRecord attempt) {
  const Result<std::string> text = format_parameter_file(file);
  if (!text) return text.error();
  if (Status status = execute("BEGIN IMMEDIATE"); !status) return status;
  const auto undo = [this](Status status) {
    sqlite3_exec(handle_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    return status;
  };
  std::vector<std::string> columns = {"unit",           "time_utc", "method",    "recording_hash", "software_version",
                                      "simulated",      "verdict",  "rule",      "sessions",       "folder",
                                      "parameter_file", "model",    "diagnosis", "reason",         "verification"};
  columns.insert(columns.end(), std::begin(record_columns), std::end(record_columns));
  std::string names, places, changes;
  for (const std::string& column : columns) {
    const std::string_view comma = names.empty() ? "" : ", ";
    names.append(comma).append(column);
    places.append(comma).append("?");
    changes.append(comma).append(column + " = excluded." + column);
  }
  Statement insert(handle_.get(), "INSERT INTO calibration(" + names + ") VALUES(" + places +
                                      ") ON CONFLICT(unit, recording_hash, method) DO UPDATE SET " + changes +
                                      " RETURNING id");
  if (!insert) return undo(failure("cannot write"));
  insert.bind(file.unit_serial)
      .bind(file.time_utc)
      .bind(file.method)
      .bind(file.recording_hash)
      .bind(file.software_version);
  insert.bind(std::int64_t{file.simulated}).bind(std::string(to_string(verdict.verdict))).bind(verdict.rule);
  insert.bind(std::int64_t{attempt.sessions}).bind(attempt.folder).bind(*text);
  insert.bind(file.model).bind(verdict.diagnosis).bind(verdict.reason).bind(verdict.verification);
  for (const char* column : record_columns) insert.bind(record_value(file, column));
  if (!insert.row()) return undo(failure("cannot write"));
  const std::int64_t id = insert.integer(0);
  Statement former(handle_.get(), "DELETE FROM value WHERE calibration = ?");
  if (!insert.done() || !former || !former.bind(id).done()) return undo(failure("cannot write"));
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    const std::string key(parameter_keys[i]);
    const auto judged = std::find_if(verdict.values.begin(), verdict.values.end(),
                                     [&key](const JudgedValue& value) { return value.key == key; });
    const bool is_judged = judged != verdict.values.end();
    Statement value(handle_.get(), "INSERT INTO value VALUES(?, ?, ?, ?, ?, ?, ?)");
    if (!value) return undo(failure("cannot write"));
    value.bind(id).bind(key).bind(file.parameters[static_cast<Eigen::Index>(i)]).bind(file.sigma[i]);
    value.bind(is_judged ? judged->limit.min : std::nullopt).bind(is_judged ? judged->limit.max : std::nullopt);
    value.bind(is_judged ? std::string(to_string(judged->verdict)) : "");
    if (!value.done()) return undo(failure("cannot write"));
  }
  attempt.calibration = id;
  if (Status status = note(attempt); !status) return undo(status);
  if (Status status = execute("COMMIT"); !status) return undo(status);
  return {};
}

// The rows that a filter lets through; the column of their verdict is called `verdict`.
std::string ResultsDatabase::where(const std::string& verdict) {
  return "(?1 = '' OR unit = ?1) AND (?2 = '' OR station = ?2) AND (?3 = '' OR part = ?3) AND (?4 = '' OR " + verdict +
         " = ?4) AND time_utc >= ?5 AND (?6 = '' OR substr(time_utc, 1, length(?6)) <= ?6)";
}

void ResultsDatabase::bind_where(const RecordFilter& filter, Statement& statement) {
  for (const std::string* text :
       {&filter.unit, &filter.station, &filter.part, &filter.verdict, &filter.from, &filter.to})
    statement.bind(*text);
}

Result<std::vector<StoredCalibration>> ResultsDatabase::list(const RecordFilter& filter, const std::string& key) const {
  Statement rows(handle_.get(),
                 "SELECT id, unit, time_utc, station, operator, verdict, folder, recording_hash, simulated, sessions, "
                 "parameter_file FROM calibration WHERE " +
                     where("verdict") + " ORDER BY time_utc, id");
  if (!rows) return failure("cannot read");
  bind_where(filter, rows);
  std::vector<StoredCalibration> found;
  while (rows.row()) {
    StoredCalibration c;
    c.id = rows.integer(0);
    c.unit = rows.text(1);
    c.time_utc = rows.text(2);
    c.station = rows.text(3);
    c.operator_name = rows.text(4);
    c.verdict = rows.text(5);
    c.folder = rows.text(6);
    c.recording_hash = rows.text(7);
    c.simulated = rows.integer(8) != 0;
    c.sessions = static_cast<int>(rows.integer(9));
    Statement values(handle_.get(),
                     "SELECT key, value, sigma, limit_min, limit_max, verdict FROM value "
                     "WHERE calibration = ?1 AND (?2 = '' OR key = ?2) ORDER BY rowid");
    if (!values) return failure("cannot read");
    values.bind(c.id).bind(key);
    while (values.row()) {
      c.values.push_back({values.text(0),
                          values.number(1).value_or(0.0),
                          values.number(2),
                          {values.number(3), values.number(4)},
                          values.text(5)});
    }
    if (!values.ended_well()) return failure("cannot read");
    c.defect = defect_of(c, rows.text(10), path_ + ": row " + std::to_string(c.id));
    if (!c.defect.empty()) c.verdict = "damaged";
    found.push_back(std::move(c));
  }
  if (!rows.ended_well()) return failure("cannot read");
  return found;
}

}  // namespace turncal
