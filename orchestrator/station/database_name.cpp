#include "orchestrator/station/database_name.h"

namespace turncal {

bool names_a_server(const std::string& database) {
  return database.starts_with("postgresql://") || database.starts_with("postgres://");
}

Status check_database_name(const std::string& database) {
  if (!names_a_server(database)) return {};
  const std::string rest = database.substr(database.find("//") + 2);
  // Whatever stands before the last @ is user and password, even where a slash in it was not written as %2F.
  const std::string user = rest.substr(0, rest.rfind('@') == std::string::npos ? 0 : rest.rfind('@'));
  if (user.find(':') == std::string::npos && rest.find("password=") == std::string::npos) return {};
  return input_error(
      "postgresql://...: a password in the name of a results database: expected postgresql://USER@HOST/NAME, and the "
      "password in ~/.pgpass, in the file that PGPASSFILE names, or in PGPASSWORD");
}

}  // namespace turncal
