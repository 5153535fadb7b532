// A connection to a database, an SQLite file or a PostgreSQL server: one way to say a statement to either.
//
// Statements are SQL that both understand, with parameters $1, $2 ... What SQLite calls an affinity is PostgreSQL's type: BIGINT, DOUBLE PRECISION, TEXT, BYTEA.
// A server is waited for with a deadline, whatever it does or stops doing; after a deadline that has passed the connection says nothing more.
// Not modelled: the time that the system takes to look up a host's name.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/station/fields.h"

struct sqlite3;

namespace turncal {

using SqlBytes = std::vector<std::byte>;
using SqlValue = std::variant<std::monostate, std::int64_t, double, std::string, SqlBytes>;  // monostate: NULL
using SqlRow = std::vector<SqlValue>;

// Of this type; NULL, or of another one: empty, 0.
template <class Type>
Type sql_as(const SqlValue& value) {
  const Type* const held = std::get_if<Type>(&value);
  return held ? *held : Type();
}
std::optional<double> as_number(const SqlValue& value);
SqlValue as_value(const std::optional<double>& value);
SqlRow row_of(const Fields& fields);
void take_row(const SqlRow& row, const Fields& fields);  // the columns of the row are those of the fields

struct SqlPatience {
  double wait_s = 10.0;  // with a lock of an SQLite file; to connect to a server
  double all_s = 1e9;    // everything said to a server, together
};

class SqlConnection {
 public:
  explicit SqlConnection(std::string name) : name_(std::move(name)) {}
  virtual ~SqlConnection() = default;
  SqlConnection(const SqlConnection&) = delete;
  SqlConnection& operator=(const SqlConnection&) = delete;

  // Without values it may be several statements. `each` gets every row.
  virtual Status run(const std::string& sql, const SqlRow& values = {},
                     const std::function<void(SqlRow)>& each = {}) = 0;
  virtual Status begin() = 0;  // until COMMIT or ROLLBACK; of an SQLite file nobody else writes meanwhile
  virtual Status hold_schema() { return {}; }  // nobody else makes tables until the end of the transaction
  virtual Result<bool> has_table(const std::string& table) = 0;
  virtual const char* identity() const = 0;            // a column's type: a number that the database gives
  virtual sqlite3* sqlite() const { return nullptr; }  // of an SQLite file: its handle

  const std::string& name() const { return name_; }

 protected:
  // "NAME: results database: cannot write: WHY".
  Error failure(ErrorKind kind, const std::string& sql, const std::string& why) const;

 private:
  std::string name_;
};

// All that `job` does, or nothing.
Status in_transaction(SqlConnection& connection, const std::function<Status()>& job);

enum class SqlUse { read, write, make };  // make: a file that is not there, too
// name: as orchestrator/station/station_config.h has it.
Result<std::shared_ptr<SqlConnection>> connect_to(const std::string& name, SqlUse use, const SqlPatience& patience);
// An SQLite database of nobody else's; errors call it `name`.
Result<std::shared_ptr<SqlConnection>> connect_to_memory(const std::string& name);

}  // namespace turncal
