#include "orchestrator/service/station_view.h"

#include <crypt.h>
#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <memory>

#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

namespace {

constexpr std::size_t most_bytes = 1 << 16, longest_name = 64;
// Nobody's: a name that is not in the file costs the same time as one that is.
constexpr const char* nobody = "$6$turncalturncal00$";

Result<std::map<std::string, std::string>> read_operators(const std::string& path) {
  struct stat facts {};
  if (::stat(path.c_str(), &facts) == 0 && (facts.st_mode & (S_IROTH | S_IWOTH | S_IWGRP)) != 0)
    return input_error(path + ": others can read or change it: expected mode 0600 or 0640");
  const std::string text = TRY(read_whole_file(path, most_bytes));
  std::map<std::string, std::string> hashes;
  std::string_view remaining = text;
  for (int number = 1; !remaining.empty(); ++number) {
    const std::string_view line = trimmed(next_line(remaining));
    if (line.empty() || line.front() == '#') continue;
    const std::size_t colon = line.find(':');
    const std::string name(line.substr(0, colon));
    if (colon == std::string_view::npos || !is_plain_text(name) || name.size() > longest_name ||
        !line.substr(colon + 1).starts_with("$"))
      return input_error(path + ":" + std::to_string(number) +
                         ": expected NAME:HASH with a hash of crypt(5), as $6$...");
    if (!hashes.emplace(name, line.substr(colon + 1)).second)
      return input_error(path + ":" + std::to_string(number) + ": " + turncal::quoted(name) + " is listed twice");
  }
  if (hashes.empty()) return input_error(path + ": names nobody: expected a line NAME:HASH for each operator");
  return hashes;
}

std::optional<std::string> from_base64(std::string_view text) {
  std::string bytes;
  unsigned bits = 0, held = 0;
  while (!text.empty() && text.back() == '=') text.remove_suffix(1);
  for (const char c : text) {
    const std::string_view alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const std::size_t value = alphabet.find(c);
    if (value == std::string_view::npos) return {};
    bits = (bits << 6U) | unsigned(value);
    held += 6;
    if (held < 8) continue;
    held -= 8;
    bytes += char((bits >> held) & 0xffU);
  }
  return bytes;
}

bool is_password(const std::string& password, const std::string& hash) {
  const auto space = std::make_unique<crypt_data>();
  const char* hashed = ::crypt_r(password.c_str(), hash.c_str(), space.get());
  if (hashed == nullptr || hashed[0] == '*') return false;
  const std::string_view found(hashed);
  unsigned difference = found.size() == hash.size() ? 0U : 1U;
  for (std::size_t i = 0; i < found.size() && i < hash.size(); ++i) difference |= unsigned(found[i] ^ hash[i]);
  return difference == 0;
}

}  // namespace

Status check_operators(const std::string& path) {
  const auto operators = read_operators(path);
  return operators ? Status() : Status(operators.error());
}

Result<std::string> authorised_operator(const std::string& path, std::string_view authorization) {
  const std::map<std::string, std::string> operators = TRY(read_operators(path));
  const std::string_view scheme = "Basic ";
  const std::optional<std::string> given =
      authorization.starts_with(scheme) ? from_base64(authorization.substr(scheme.size())) : std::nullopt;
  const std::size_t colon = given ? given->find(':') : std::string::npos;
  if (colon == std::string::npos || given->find('\0') != std::string::npos)
    return input_error("name and password: expected");
  const std::string name = given->substr(0, colon);
  const auto known = operators.find(name);
  const bool right = is_password(given->substr(colon + 1), known == operators.end() ? nobody : known->second);
  if (!right || known == operators.end()) return input_error("name or password is wrong");
  return name;
}

Result<ServiceConfig> read_service_config(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  const auto beside = [&file](const std::string& name) { return name.empty() ? name : file.beside(name); };
  ServiceConfig config;
  for (int number = 1; number == 1 || file.has("station." + std::to_string(number)); ++number) {
    const std::string key = "station." + std::to_string(number);
    ServedStation station{.name = file.text(key),
                          .queue = beside(file.text(key + ".queue")),
                          .runs = beside(file.text(key + ".runs")),
                          .mounted = beside(file.text_or(key + ".mounted", ""))};
    const auto same = [&station](const ServedStation& other) { return other.name == station.name; };
    if (std::ranges::any_of(config.stations, same)) file.reject(key, "a name of its own");
    config.stations.push_back(std::move(station));
  }
  config.password_file = beside(file.text_or("serve.password_file", ""));
  config.database = file.text_or("serve.database", "");
  if (!names_a_server(config.database)) config.database = beside(config.database);
  config.alert.command = file.text_or("alert.command", "");
  if (!config.alert.command.empty()) {
    config.alert.record = beside(file.text("alert.record"));
    config.alert.time_s = file.number_or("alert.time_s", config.alert.time_s, between(1.0, 3600.0));
    config.alert.least_yield = file.number_if("alert.least_yield", between(0.0, 1.0));
  }
  TRY(file.check_all_used());
  TRY(check_database_name(config.database));
  return config;
}

}  // namespace turncal
