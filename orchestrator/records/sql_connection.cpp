// SQLite, for a results database in a file; PostgreSQL, on a server, through libpq without blocking calls, so that every wait has our deadline.
#include "orchestrator/records/sql_connection.h"

#include <fmt/format.h>
#include <libpq-fe.h>
#include <poll.h>
#include <sqlite3.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

std::optional<double> as_number(const SqlValue& value) {
  if (const double* const number = std::get_if<double>(&value)) return *number;
  if (const std::int64_t* const whole = std::get_if<std::int64_t>(&value)) return double(*whole);
  return std::nullopt;
}

SqlValue as_value(const std::optional<double>& value) { return value ? SqlValue(*value) : SqlValue(); }

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
            static_cast<void>(set_text(fields[i], sql_as<std::string>(from)));
          else if constexpr (std::is_same_v<Place, std::string*>)
            *value = sql_as<std::string>(from);
          else if constexpr (std::is_same_v<Place, double*>)
            *value = number.value_or(0.0);
          else if constexpr (std::is_same_v<Place, std::optional<double>*>)
            *value = number;
          else if constexpr (std::is_integral_v<std::remove_pointer_t<Place>>)
            *value = static_cast<std::remove_pointer_t<Place>>(sql_as<std::int64_t>(from));
          else if (number)
            *value = static_cast<typename std::remove_pointer_t<Place>::value_type>(sql_as<std::int64_t>(from));
        },
        fields[i].value);
  }
}

Error SqlConnection::failure(ErrorKind kind, const std::string& sql, const std::string& why) const {
  const bool reads = sql.starts_with("SELECT") || sql.starts_with("PRAGMA");
  return {kind, name_ + ": results database: cannot " + (sql.empty() ? "open" : reads ? "read" : "write") + ": " + why};
}

Status in_transaction(SqlConnection& connection, const std::function<Status()>& job) {
  TRY(connection.begin());
  Status status = job();
  if (status) status = connection.run("COMMIT");
  if (!status) {
    const Status undone = connection.run("ROLLBACK");  // if this fails, the end of the connection rolls back
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
        code == SQLITE_NOTADB || code == SQLITE_ERROR;  // other codes: locked, full, read-only or broken
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

Result<std::shared_ptr<SqlConnection>> opened(const std::string& name, int flags) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(name.c_str(), &handle, flags, nullptr);
  const auto connection = std::make_shared<SqliteConnection>(handle, name);
  if (code != SQLITE_OK) return connection->failed("");
  return std::shared_ptr<SqlConnection>(connection);
}

constexpr double answer_s = 60.0;  // for one statement, by a server that is there

// Joins the lines of a message from libpq.
std::string one_line(std::string_view said) {
  while (said.ends_with('\n')) said.remove_suffix(1);
  return fmt::format("{}", fmt::join(split(said, '\n'), "; "));
}

// Returns valid UTF-8, because a server accepts nothing else.
std::string as_utf8(std::string_view text) {
  std::string valid;
  while (!text.empty()) {
    const bool plain = static_cast<unsigned char>(text.front()) < 0x80 && text.front() != '\0';
    const std::size_t length = plain ? 1 : printable_character(text);
    valid += length > 0 ? std::string(text.substr(0, length)) : "?";
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return valid;
}

// Returns a value as text that its column's type can read.
std::string as_parameter(const SqlValue& value) {
  if (const double* const number = std::get_if<double>(&value)) return format_number(*number);
  if (const std::int64_t* const whole = std::get_if<std::int64_t>(&value)) return format_number(*whole);
  if (const SqlBytes* const bytes = std::get_if<SqlBytes>(&value)) {
    std::string text = "\\x";
    for (const std::byte one : *bytes) text += fmt::format("{:02x}", std::to_integer<unsigned>(one));
    return text;
  }
  return as_utf8(sql_as<std::string>(value));
}

// Returns kind device for errors that time or the server's administrator may remove (resources, shutdown, conflict of two writers).
ErrorKind kind_of(const char* state) {
  const std::string_view which = std::string_view(state ? state : "08").substr(0, 2);
  return which == "42" || which == "22" || which == "23" || which == "25" ? ErrorKind::input : ErrorKind::device;
}

SqlValue cell_of(const PGresult* rows, int row, int column) {
  if (PQgetisnull(rows, row, column)) return {};
  const char* const text = PQgetvalue(rows, row, column);
  constexpr Oid int8 = 20, int2 = 21, int4 = 23, bytea = 17, float4 = 700, float8 = 701;  // from the catalogue pg_type
  switch (PQftype(rows, column)) {
    case int8:
    case int4:
    case int2: return parse_integer(text).value_or(0);
    case float4:
    case float8: {
      const std::optional<double> number = parse_number(text);
      return number ? SqlValue(*number) : SqlValue();
    }
    case bytea: {
      std::size_t size = 0;
      const std::unique_ptr<unsigned char, void (*)(void*)> bytes(
          PQunescapeBytea(reinterpret_cast<const unsigned char*>(text), &size), PQfreemem);
      const auto* const first = reinterpret_cast<const std::byte*>(bytes.get());
      return bytes ? SqlBytes(first, first + size) : SqlBytes();
    }
    default: return std::string(text);
  }
}

class PostgresConnection : public SqlConnection {
 public:
  PostgresConnection(const std::string& name, const SqlPatience& patience)
      : SqlConnection(name), until_s_(monotonic_s() + patience.all_s), connect_s_(patience.wait_s) {}
  ~PostgresConnection() override { PQfinish(handle_); }

  Status open() {
    const char* const words[] = {"dbname", "application_name", "client_encoding", "connect_timeout", nullptr};
    const char* const values[] = {name().c_str(), "turncal", "UTF8", "0", nullptr};  // we keep the deadline
    const double until_s = std::min(until_s_, monotonic_s() + connect_s_);
    handle_ = PQconnectStartParams(words, values, 1);
    if (!handle_) return device_error(name() + ": results database: cannot open: not enough memory");
    PQsetNoticeProcessor(
        handle_, [](void*, const char*) {}, nullptr);
    PostgresPollingStatusType next = PGRES_POLLING_WRITING;
    while (PQstatus(handle_) != CONNECTION_BAD && next != PGRES_POLLING_OK && next != PGRES_POLLING_FAILED) {
      if (!ready(next == PGRES_POLLING_READING ? POLLIN : POLLOUT, until_s))
        return gave_up("", connect_s_, "there is no connection");
      next = PQconnectPoll(handle_);
    }
    if (PQstatus(handle_) != CONNECTION_OK) return failure(ErrorKind::device, "", one_line(PQerrorMessage(handle_)));
    PQsetnonblocking(handle_, 1);
    return {};
  }

  Status run(const std::string& sql, const SqlRow& values, const std::function<void(SqlRow)>& each) override {
    if (!given_up_.empty()) return device_error(given_up_);
    std::vector<std::string> texts;
    for (const SqlValue& value : values) texts.push_back(as_parameter(value));
    std::vector<const char*> given;
    for (std::size_t i = 0; i < values.size(); ++i)
      given.push_back(std::holds_alternative<std::monostate>(values[i]) ? nullptr : texts[i].c_str());
    const int sent = values.empty() ? PQsendQuery(handle_, sql.c_str())
                                    : PQsendQueryParams(handle_, sql.c_str(), int(values.size()), nullptr, given.data(),
                                                        nullptr, nullptr, 0);
    if (!sent) return failure(ErrorKind::device, sql, one_line(PQerrorMessage(handle_)));
    PQsetSingleRowMode(handle_);  // takes the memory of one row
    Status status;
    while (true) {
      TRY(answer(sql));
      const std::unique_ptr<PGresult, void (*)(PGresult*)> result(PQgetResult(handle_), PQclear);
      if (!result) return status;
      const ExecStatusType code = PQresultStatus(result.get());
      if (code == PGRES_FATAL_ERROR && status) {
        const char* const why = PQresultErrorField(result.get(), PG_DIAG_MESSAGE_PRIMARY);
        status = failure(kind_of(PQresultErrorField(result.get(), PG_DIAG_SQLSTATE)), sql,
                         one_line(why ? why : PQresultErrorMessage(result.get())));
      }
      for (int row = 0; each && code == PGRES_SINGLE_TUPLE && row < PQntuples(result.get()); ++row) {
        SqlRow values_of_row;
        for (int i = 0; i < PQnfields(result.get()); ++i) values_of_row.push_back(cell_of(result.get(), row, i));
        each(std::move(values_of_row));
      }
    }
  }
  Status begin() override {
    // A writer that died must not hold up the others.
    return run(
        "BEGIN; SELECT set_config('idle_in_transaction_session_timeout', '60s', true), "
        "pg_advisory_xact_lock(7467) WHERE current_setting('transaction_read_only') = 'off'",
        {}, {});
  }
  Result<bool> has_table(const std::string& table) override {
    bool there = false;
    TRY(run("SELECT to_regclass($1) IS NOT NULL", {table},
            [&](const SqlRow& row) { there = sql_as<std::string>(row.front()) == "t"; }));
    return there;
  }
  const char* identity() const override { return "BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY"; }

 private:
  bool ready(short events, double until_s) const {
    while (true) {
      const double left_s = std::max(0.0, until_s - monotonic_s());
      pollfd one{PQsocket(handle_), events, 0};
      const int count = ::poll(&one, 1, int(std::ceil(1000.0 * std::min(left_s, 1e6))));
      if (count > 0) return true;
      if (count == 0 || errno != EINTR) return false;
    }
  }
  Error gave_up(const std::string& sql, double limit_s, const std::string& what) {
    const double waited_s = std::min(limit_s, std::max(0.0, until_s_ - began_s_));
    const Error error = failure(ErrorKind::device, sql, what + " within " + format_number(std::round(waited_s)) + " s");
    given_up_ = error.message;
    return error;
  }
  // Waits until the next result can be taken without blocking.
  Status answer(const std::string& sql) {
    const double until_s = std::min(until_s_, monotonic_s() + answer_s);
    while (true) {
      const int unsent = PQflush(handle_);
      if (unsent <= 0 && !PQisBusy(handle_)) return {};
      if (!ready(static_cast<short>(unsent > 0 ? POLLIN | POLLOUT : POLLIN), until_s))
        return gave_up(sql, answer_s, "there is no answer");
      if (!PQconsumeInput(handle_)) {
        given_up_ = failure(ErrorKind::device, sql, one_line(PQerrorMessage(handle_))).message;
        return device_error(given_up_);
      }
    }
  }

  PGconn* handle_ = nullptr;
  double began_s_ = monotonic_s();
  double until_s_, connect_s_;
  std::string given_up_;  // why the connection is not used any more
};

Result<std::shared_ptr<SqlConnection>> connect_to_server(const std::string& name, bool writes,
                                                         const SqlPatience& patience) {
  TRY(check_database_name(name));
  const auto connection = std::make_shared<PostgresConnection>(name, patience);
  TRY(connection->open());
  if (!writes)
    TRY(connection->run("SET SESSION CHARACTERISTICS AS TRANSACTION READ ONLY, ISOLATION LEVEL REPEATABLE READ", {},
                        {}));
  return std::shared_ptr<SqlConnection>(connection);
}

}  // namespace

Result<std::shared_ptr<SqlConnection>> connect_to(const std::string& name, SqlUse use, const SqlPatience& patience) {
  if (names_a_server(name)) return connect_to_server(name, use != SqlUse::read, patience);
  const int flags = use == SqlUse::read    ? SQLITE_OPEN_READONLY
                    : use == SqlUse::write ? SQLITE_OPEN_READWRITE
                                           : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
  Result<std::shared_ptr<SqlConnection>> file = opened(name, flags);
  // Another station may write.
  if (file) sqlite3_busy_timeout((*file)->sqlite(), int(1000.0 * patience.wait_s));
  return file;
}

}  // namespace turncal
