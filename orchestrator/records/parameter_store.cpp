#include "orchestrator/records/parameter_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace fs = std::filesystem;

std::string name_of_unit(const std::string& unit) {
  std::string name;
  for (const char c : unit) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    name += plain ? std::string(1, c) : fmt::format("%{:02x}", static_cast<unsigned char>(c));
  }
  return name;
}

std::string unit_folder(const std::string& store, const std::string& unit, bool simulated) {
  return store + (simulated ? "/simulated/" : "/") + name_of_unit(unit);
}

namespace {

constexpr const char* in_use_name = "parameters.conf";

std::string version_path(const std::string& folder, int number) {
  return fmt::format("{}/versions/{:04}.conf", folder, number);
}

std::vector<int> version_numbers(const std::string& folder) {
  std::vector<int> numbers;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder + "/versions", error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(".") || entry.path().extension() != ".conf") continue;
    if (const auto number = parse_integer<int>(entry.path().stem().string())) numbers.push_back(*number);
  }
  std::ranges::sort(numbers);
  return numbers;
}

// Returns the versions of a unit, one at least.
Result<std::vector<int>> known_versions(const std::string& store, const std::string& unit, bool simulated) {
  std::error_code error;
  if (!fs::is_directory(store, error)) return input_error(store + ": there is no such folder: expected a record.store");
  const std::vector<int> numbers = version_numbers(unit_folder(store, unit, simulated));
  if (!numbers.empty()) return numbers;
  if (!version_numbers(unit_folder(store, unit, !simulated)).empty())
    return input_error(
        "{}: unit {} has {}", store, turncal::quoted(unit),
        simulated ? "real versions only: leave out --simulated" : "simulated versions only: --simulated");
  std::vector<std::string> units;
  for (const auto& entry : fs::directory_iterator(folder_of(unit_folder(store, unit, simulated)), error))
    if (const auto file = read_parameter_file(entry.path().string() + "/" + in_use_name))
      units.push_back(file->unit_serial);
  TRY(check_known(store, simulated ? "simulated unit" : "unit", unit, units));
  return numbers;
}

}  // namespace

Status put_in_use(const std::string& store, const ParameterFile& file) {
  const std::string text = TRY(format_parameter_file(file));
  const std::string folder = unit_folder(store, file.unit_serial, file.simulated);
  TRY(make_folder(folder + "/versions"));
  const LockFile lock = TRY(LockFile::acquire(folder + "/.lock", LockFile::change_s));
  for (const std::string& changed : {folder, folder_of(folder), store}) TRY(sync_folder(changed));
  const std::vector<int> numbers = version_numbers(folder);
  const int newest = numbers.empty() ? 0 : numbers.back();
  const std::string old = TRY(newest > 0 ? read_whole_file(version_path(folder, newest)) : Result<std::string>(""));
  if (old != text) TRY(write_file_atomically(version_path(folder, newest + 1), text));
  return write_file_atomically(folder + "/" + in_use_name, text);
}

Status restore_version(const std::string& store, const std::string& unit, int version, bool simulated) {
  const std::string folder = unit_folder(store, unit, simulated);
  const std::string path = version_path(folder, version);
  const std::vector<int> numbers = TRY(known_versions(store, unit, simulated));
  if (!path_exists(path))
    return input_error("{}: there is no version {}: expected 1 to {}", folder, version, numbers.back());
  const LockFile lock = TRY(LockFile::acquire(folder + "/.lock", LockFile::change_s));
  const ParameterFile file = TRY(read_parameter_file(path));
  if (file.unit_serial != unit || file.simulated != simulated)
    return input_error(path + ": is of unit '" + file.unit_serial + "'" + (file.simulated ? " and simulated" : "") +
                       ": expected unit '" + unit + "'");
  return write_file_atomically(folder + "/" + in_use_name, TRY(read_whole_file(path)));
}

Result<std::vector<StoredVersion>> stored_versions(const std::string& store, const std::string& unit, bool simulated) {
  const std::string folder = unit_folder(store, unit, simulated);
  const std::vector<int> numbers = TRY(known_versions(store, unit, simulated));
  const Result<std::string> in_use = read_whole_file(folder + "/" + in_use_name);
  std::vector<StoredVersion> versions;
  for (const int number : numbers) {
    StoredVersion version{.number = number, .path = version_path(folder, number), .status = {}, .file = {}};
    const Result<std::string> text = read_whole_file(version.path);
    version.in_use = in_use && text && *in_use == *text;
    Result<ParameterFile> file = text ? parse_parameter_file(*text, version.path) : text.error();
    if (file)
      version.file = std::move(*file);
    else
      version.status = file.error();
    versions.push_back(std::move(version));
  }
  return versions;
}

}  // namespace turncal
