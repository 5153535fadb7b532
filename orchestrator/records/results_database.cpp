#include "orchestrator/records/results_database.h"

#include <sqlite3.h>

#include <algorithm>
#include <filesystem>

#include "imu_io/base/posix_file.h"

namespace turncal {

namespace {

// The columns after folder come from the parameter file's record.* keys of the same name.
constexpr const char* schema = R"(
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
constexpr const char* record_columns[] = {"station",        "operator",
                                          "part",           "revision",
                                          "ambient",        "configuration_hash",
                                          "sequence",       "sequence_hash",
                                          "table_id",       "table_calibration_due",
                                          "overdue_reason", "repeated_dwells",
                                          "lost_samples"};

class Statement {
 public:
  Statement(sqlite3* database, const std::string& sql) {
    sqlite3_prepare_v2(database, sql.c_str(), -1, &statement_, nullptr);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;
  explicit operator bool() const { return statement_ != nullptr; }

  Statement& bind(const std::string& text) {
    sqlite3_bind_text(statement_, ++bound_, text.c_str(), -1, SQLITE_TRANSIENT);
    return *this;
  }
  Statement& bind(double value) {
    sqlite3_bind_double(statement_, ++bound_, value);
    return *this;
  }
  Statement& bind(std::int64_t value) {
    sqlite3_bind_int64(statement_, ++bound_, value);
    return *this;
  }
  Statement& bind(const std::optional<double>& value) {
    if (value) return bind(*value);
    sqlite3_bind_null(statement_, ++bound_);
    return *this;
  }
  bool row() { return (last_ = sqlite3_step(statement_)) == SQLITE_ROW; }
  bool done() { return (last_ = sqlite3_step(statement_)) == SQLITE_DONE; }
  bool ended_well() const { return last_ == SQLITE_DONE; }
  std::string text(int column) const {
    const unsigned char* value = sqlite3_column_text(statement_, column);
    return value ? reinterpret_cast<const char*>(value) : "";
  }
  std::int64_t integer(int column) const { return sqlite3_column_int64(statement_, column); }
  std::optional<double> number(int column) const {
    if (sqlite3_column_type(statement_, column) == SQLITE_NULL) return std::nullopt;
    return sqlite3_column_double(statement_, column);
  }

 private:
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
  int last_ = SQLITE_ERROR;
};

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

Result<ResultsDatabase> ResultsDatabase::open(const std::string& path) {
  if (Status status = make_folder(folder_of(path)); !status) return status.error();
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &handle, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  ResultsDatabase database(handle, path);
  if (code != SQLITE_OK) return database.failure("cannot open");
  sqlite3_busy_timeout(handle, 10'000);  // another station may write
  for (const char* sql : {"PRAGMA synchronous = EXTRA", "PRAGMA foreign_keys = ON", schema}) {
    if (Status status = database.execute(sql); !status) return status.error();
  }
  for (const std::string column : {"model", "diagnosis", "reason", "verification"}) {
    if (Statement(handle, "SELECT " + column + " FROM calibration")) continue;  // made before this column was
    const std::string sql = "ALTER TABLE calibration ADD COLUMN " + column + " TEXT";
    if (Status status = database.execute(sql.c_str()); !status) return status.error();
  }
  return database;
}

Status ResultsDatabase::check_writable(const std::string& path) {
  // The folder too when the file is there: its journal is made beside it.
  if (Status status = check_folder_writable(folder_of(path)); !status || !path_exists(path)) return status;
  if (Status status = check_regular_file(path); !status) return status;
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &handle, SQLITE_OPEN_READWRITE, nullptr);
  const ResultsDatabase database(handle, path);
  if (code != SQLITE_OK) return database.failure("cannot open");
  sqlite3_busy_timeout(handle, 2'000);
  for (const char* sql : {"BEGIN IMMEDIATE", schema, "ROLLBACK"}) {
    if (Status status = database.execute(sql); !status) return status;
  }
  return {};
}

Result<ResultsDatabase> ResultsDatabase::open_to_read(const std::string& path) {
  if (!path_exists(path)) return input_error(path + ": there is no such results database");
  if (Status status = check_regular_file(path); !status) return status.error();
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &handle, SQLITE_OPEN_READONLY, nullptr);
  ResultsDatabase database(handle, path);
  if (code != SQLITE_OK) return database.failure("cannot open");
  sqlite3_busy_timeout(handle, 10'000);
  return database;
}

Status ResultsDatabase::add(const ParameterFile& file, const VerdictReport& verdict, const std::string& folder,
                            int sessions) {
  const Result<std::string> text = format_parameter_file(file);
  if (!text) return text.error();
  if (Status status = execute("BEGIN IMMEDIATE"); !status) return status;
  const auto undo = [this](Status status) {
    sqlite3_exec(handle_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    return status;
  };
  std::string sql =
      "INSERT OR REPLACE INTO calibration(unit, time_utc, method, recording_hash, software_version, simulated, "
      "verdict, rule, sessions, folder, parameter_file, model, diagnosis, reason, verification";
  std::string places = "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?";
  for (const char* column : record_columns) {
    sql += std::string(", ") + column;
    places += ", ?";
  }
  Statement insert(handle_.get(), sql + ") VALUES(" + places + ")");
  if (!insert) return undo(failure("cannot write"));
  insert.bind(file.unit_serial)
      .bind(file.time_utc)
      .bind(file.method)
      .bind(file.recording_hash)
      .bind(file.software_version);
  insert.bind(std::int64_t{file.simulated}).bind(std::string(to_string(verdict.verdict))).bind(verdict.rule);
  insert.bind(std::int64_t{sessions}).bind(std::filesystem::absolute(folder).lexically_normal().string()).bind(*text);
  insert.bind(file.model).bind(verdict.diagnosis).bind(verdict.reason).bind(verdict.verification);
  for (const char* column : record_columns) insert.bind(record_value(file, column));
  if (!insert.done()) return undo(failure("cannot write"));
  const std::int64_t id = sqlite3_last_insert_rowid(handle_.get());
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
  if (Status status = execute("COMMIT"); !status) return undo(status);
  return {};
}

Result<std::vector<StoredCalibration>> ResultsDatabase::list(const std::string& unit, const std::string& key) const {
  Statement rows(handle_.get(),
                 "SELECT id, unit, time_utc, station, operator, verdict, folder, recording_hash, simulated, sessions, "
                 "parameter_file FROM calibration WHERE ?1 = '' OR unit = ?1 ORDER BY time_utc, id");
  if (!rows) return failure("cannot read");
  rows.bind(unit);
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
