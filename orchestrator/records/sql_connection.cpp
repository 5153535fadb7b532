#include "orchestrator/records/sql_connection.h"

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
  if (const std::int64_t* const whole = std::get_if<std::int64_t>(&value)) return static_cast<double>(*whole);
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

}  // namespace turncal
