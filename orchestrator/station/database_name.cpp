#include "orchestrator/station/database_name.h"

#include <filesystem>
#include <fstream>
#include <string_view>

namespace turncal {

bool names_a_server(const std::string& database) {
  return database.starts_with("postgresql://") || database.starts_with("postgres://");
}

bool names_a_database(const std::string& path) {
  if (names_a_server(path)) return true;
  constexpr std::string_view magic = "SQLite format 3";
  std::string begin(magic.size(), ' ');
  std::error_code error;
  return std::filesystem::is_regular_file(path, error) &&
         std::ifstream(path, std::ios::binary).read(begin.data(), static_cast<std::streamsize>(begin.size())) &&
         begin == magic;
}

Status check_database_name(const std::string& database) {
  if (!names_a_server(database)) return {};
  const std::string address = database.substr(database.find("//") + 2);
  // Whatever stands before the last @ is user and password, even where a slash in it was not written as %2F.
  const std::string user = address.substr(0, address.rfind('@') == std::string::npos ? 0 : address.rfind('@'));
  if (user.find(':') == std::string::npos && address.find("password=") == std::string::npos) return {};
  return input_error(
      "postgresql://...: a password in the name of a results database: expected postgresql://USER@HOST/NAME, and the "
      "password in ~/.pgpass, in the file that PGPASSFILE names, or in PGPASSWORD");
}

}  // namespace turncal
