// A connection to a database, an SQLite file or a PostgreSQL server, with one interface for both.
//
// Statements are SQL that both understand, with parameters $1, $2 ... Column types are PostgreSQL's, which SQLite takes as affinities: BIGINT,
// DOUBLE PRECISION, TEXT, BYTEA. Every wait for a server has a deadline; once one has passed the connection is not used any more.
// Not modelled: the time for resolving a host's name.
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

// Returns the value if it has this type; NULL, or another type: empty, 0.
template <class Type>
Type sql_as(const SqlValue& value) {
  const Type* const held = std::get_if<Type>(&value);
  return held ? *held : Type();
}
std::optional<double> as_number(const SqlValue& value);
SqlValue as_value(const std::optional<double>& value);
SqlRow row_of(const Fields& fields);
void take_row(const SqlRow& row, const Fields& fields);  // the row's columns are the fields, in order

struct SqlPatience {
  double wait_s = 10.0;  // for the lock of an SQLite file, or to connect to a server
  double all_s = 1e9;    // for all statements to a server together
};

class SqlConnection {
 public:
  explicit SqlConnection(std::string name) : name_(std::move(name)) {}
  virtual ~SqlConnection() = default;
  SqlConnection(const SqlConnection&) = delete;
  SqlConnection& operator=(const SqlConnection&) = delete;

  // Runs a statement; without values it may be several. `each` gets every row.
  virtual Status run(const std::string& sql, const SqlRow& values = {},
                     const std::function<void(SqlRow)>& each = {}) = 0;
  virtual Status begin() = 0;  // until COMMIT or ROLLBACK; nobody else writes during it
  virtual Result<bool> has_table(const std::string& table) = 0;
  virtual const char* identity() const = 0;            // type of a column whose numbers the database assigns
  virtual sqlite3* sqlite() const { return nullptr; }  // handle of an SQLite file

  const std::string& name() const { return name_; }

 protected:
  // "NAME: results database: cannot write: WHY".
  Error failure(ErrorKind kind, const std::string& sql, const std::string& why) const;

 private:
  std::string name_;
};

// Runs `job` in a transaction: all of it takes effect, or nothing.
Status in_transaction(SqlConnection& connection, const std::function<Status()>& job);

enum class SqlUse { read, write, make };  // make: creates a missing file
// name: as in orchestrator/station/station_config.h.
Result<std::shared_ptr<SqlConnection>> connect_to(const std::string& name, SqlUse use, const SqlPatience& patience);

}  // namespace turncal
