// A results database in a file: SQLite.
#include "orchestrator/records/sql_connection.h"

#include <sqlite3.h>

#include <cstring>

namespace turncal {

std::string as_text(const SqlValue& value) {
  const std::string* const text = std::get_if<std::string>(&value);
  return text ? *text : "";
}

SqlBytes as_bytes(const SqlValue& value) {
  const SqlBytes* const bytes = std::get_if<SqlBytes>(&value);
  return bytes ? *bytes : SqlBytes();
}

std::int64_t as_integer(const SqlValue& value) {
  const std::int64_t* const number = std::get_if<std::int64_t>(&value);
  return number ? *number : 0;
}

std::optional<double> as_number(const SqlValue& value) {
  if (const double* const number = std::get_if<double>(&value)) return *number;
  if (const std::int64_t* const whole = std::get_if<std::int64_t>(&value)) return double(*whole);
  return std::nullopt;
}

SqlValue as_value(const std::optional<double>& value) { return value ? SqlValue(*value) : SqlValue(); }

Error SqlConnection::failure(ErrorKind kind, const std::string& sql, const std::string& why) const {
  const bool reads = sql.starts_with("SELECT") || sql.starts_with("PRAGMA");
  return {kind, name_ + ": results database: cannot " + (sql.empty() ? "open" : reads ? "read" : "write") + ": " + why};
}

Status in_transaction(SqlConnection& connection, const std::function<Status()>& job) {
  TRY(connection.begin());
  Status status = job();
  if (status) status = connection.run("COMMIT");
  if (!status) {
    const Status undone = connection.run("ROLLBACK");  // where it cannot be said, the end of the connection says it
    static_cast<void>(undone);
  }
  return status;
}

namespace {

class SqliteConnection : public SqlConnection {
 public:
  SqliteConnection(sqlite3* handle, const std::string& name) : SqlConnection(name), handle_(handle) {}
  ~SqliteConnection() override { sqlite3_close(handle_); }

  Status run(const std::string& sql, const SqlRow& values, const std::function<void(SqlRow)>& each) override {
    const char* remaining = sql.c_str();
    while (*remaining != '\0') {
      sqlite3_stmt* prepared = nullptr;
      if (sqlite3_prepare_v2(handle_, remaining, -1, &prepared, &remaining) != SQLITE_OK) return failed(sql);
      const std::unique_ptr<sqlite3_stmt, int (*)(sqlite3_stmt*)> statement(prepared, sqlite3_finalize);
      if (!prepared) continue;  // blanks
      bind(prepared, values);
      int code = SQLITE_ROW;
      while ((code = sqlite3_step(prepared)) == SQLITE_ROW)
        if (each) each(row_of(prepared));
      if (code != SQLITE_DONE) return failed(sql);
    }
    return {};
  }
  Status begin() override { return run("BEGIN IMMEDIATE", {}, {}); }
  Result<bool> has_table(const std::string& table) override {
    bool there = false;
    TRY(run("SELECT 1 FROM sqlite_master WHERE name = $1", {table}, [&](const SqlRow&) { there = true; }));
    return there;
  }
  const char* identity() const override { return "INTEGER PRIMARY KEY"; }
  sqlite3* sqlite() const override { return handle_; }

  Error failed(const std::string& sql) const {
    const int code = sqlite3_errcode(handle_);
    const bool not_ours =
        code == SQLITE_NOTADB || code == SQLITE_ERROR;  // the rest is locked, full, read-only or broken
    std::string why = sqlite3_errmsg(handle_);
    if (const int error = sqlite3_system_errno(handle_); code == SQLITE_CANTOPEN && error != 0)
      why += std::string(" (") + std::strerror(error) + ")";
    return failure(not_ours ? ErrorKind::input : ErrorKind::device, sql, why);
  }

 private:
  static void bind(sqlite3_stmt* statement, const SqlRow& values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      const int place = sqlite3_bind_parameter_index(statement, ("$" + std::to_string(i + 1)).c_str());
      if (place == 0) continue;
      if (const std::string* const text = std::get_if<std::string>(&values[i]))
        sqlite3_bind_text(statement, place, text->c_str(), -1, SQLITE_TRANSIENT);
      else if (const double* const number = std::get_if<double>(&values[i]))
        sqlite3_bind_double(statement, place, *number);
      else if (const std::int64_t* const whole = std::get_if<std::int64_t>(&values[i]))
        sqlite3_bind_int64(statement, place, *whole);
      else if (const SqlBytes* const bytes = std::get_if<SqlBytes>(&values[i]))
        sqlite3_bind_blob64(statement, place, bytes->data(), bytes->size(), SQLITE_TRANSIENT);
    }
  }
  static SqlRow row_of(sqlite3_stmt* statement) {
    SqlRow row;
    for (int i = 0; i < sqlite3_column_count(statement); ++i) {
      switch (sqlite3_column_type(statement, i)) {
        case SQLITE_NULL: row.emplace_back(); break;
        case SQLITE_INTEGER: row.emplace_back(std::int64_t{sqlite3_column_int64(statement, i)}); break;
        case SQLITE_FLOAT: row.emplace_back(sqlite3_column_double(statement, i)); break;
        case SQLITE_BLOB: {
          const auto* const bytes = static_cast<const std::byte*>(sqlite3_column_blob(statement, i));
          const int size = sqlite3_column_bytes(statement, i);
          row.emplace_back(size > 0 ? SqlBytes(bytes, bytes + size) : SqlBytes());
          break;
        }
        default: {
          const unsigned char* const text = sqlite3_column_text(statement, i);
          row.emplace_back(std::string(text ? reinterpret_cast<const char*>(text) : ""));
        }
      }
    }
    return row;
  }

  sqlite3* handle_;
};

Result<std::shared_ptr<SqlConnection>> opened(const std::string& path, const std::string& name, int flags) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &handle, flags, nullptr);
  const auto connection = std::make_shared<SqliteConnection>(handle, name);
  if (code != SQLITE_OK) return connection->failed("");
  return std::shared_ptr<SqlConnection>(connection);
}

}  // namespace

Result<std::shared_ptr<SqlConnection>> connect_to_file(const std::string& path, int flags,
                                                       const SqlPatience& patience) {
  Result<std::shared_ptr<SqlConnection>> file = opened(path, path, flags);
  // Another station may write.
  if (file) sqlite3_busy_timeout((*file)->sqlite(), int(1000.0 * patience.wait_s));
  return file;
}

Result<std::shared_ptr<SqlConnection>> connect_to_memory(const std::string& name) {
  return opened(":memory:", name, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
}

}  // namespace turncal
