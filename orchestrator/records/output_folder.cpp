#include "orchestrator/records/output_folder.h"

#include <filesystem>
#include <system_error>

#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/records/journal.h"

namespace turncal {

namespace fs = std::filesystem;

Result<LockFile> hold_folder(const std::string& folder) { return LockFile::acquire(folder + "/.lock"); }

Result<OutputFolder> OutputFolder::prepare(const std::string& path, std::vector<std::string> names) {
  std::error_code error;
  if (path.empty()) return input_error("--out: expected a folder, got an empty name");
  if (fs::exists(path, error) && !fs::is_directory(path, error))
    return input_error(path + ": expected a folder, found a file");
  OutputFolder folder(path, std::move(names));
  // Another command that fails meanwhile removes the folder that we found, so it is made again.
  constexpr int most_races = 100;
  for (int race = 0;; ++race) {
    TRY(folder.make_missing());
    Result<LockFile> lock = hold_folder(path);
    if (!lock && race < most_races && !path_exists(path)) continue;
    if (!lock) {
      folder.names_.clear();  // they belong to another command
      return lock.error();
    }
    folder.lock_.emplace(std::move(*lock));
    break;
  }
  for (const std::string& name : folder.names_) {
    if (!fs::exists(fs::path(path) / name, error)) continue;
    const Error held = input_error(path + " already contains " + name + "; choose another folder");
    folder.names_.clear();  // they are another's
    return held;
  }
  return folder;
}

Result<OutputFolder> OutputFolder::prepare_results(const std::string& path, const std::string& unit) {
  Result<OutputFolder> folder = prepare(path, {});
  if (!folder) return folder;
  // The folder of one of several units holds no journal.
  for (const char* name : {journal_name, binary_recording_name, partial_recording_name})
    if (path_exists(folder->file(name)))
      return input_error("--out " + path + ": holds a run (" + name + "): expected another folder");
  const std::string file = folder->file(parameters_name);
  if (!path_exists(file)) return folder;
  const std::string text = TRY(read_whole_file(file));
  const ParameterFile earlier = TRY(parse_parameter_file(text, file));
  if (earlier.unit_serial == unit) return folder;
  return input_error(file + ": is of unit '" + earlier.unit_serial + "', not of '" + unit +
                     "': expected another folder");
}

Status OutputFolder::make_missing() {
  std::error_code error;
  std::vector<fs::path> missing;
  for (fs::path p = fs::absolute(path_, error).lexically_normal(); !p.empty() && !fs::exists(p, error);
       p = p.parent_path())
    if (p.has_filename()) missing.insert(missing.begin(), p);
  for (const fs::path& p : missing) {
    const bool created = fs::create_directory(p, error);
    if (error) return storage_error(p.string(), "cannot make this folder", error.value());
    if (created) created_.push_back(p.string());
    // A power loss that removes a folder would remove all its contents.
    TRY(sync_folder(folder_of(p.string())));
  }
  return {};
}

OutputFolder::~OutputFolder() {
  std::error_code ignored;
  for (const std::string& name : names_) fs::remove(fs::path(path_) / name, ignored);
  lock_.reset();
  for (auto it = created_.rbegin(); it != created_.rend(); ++it) fs::remove(*it, ignored);
}

Status check_not_source(const std::string& out, const std::string& source) {
  std::error_code error;
  const std::string folder = fs::is_directory(source, error) ? source : folder_of(source);
  if (!fs::equivalent(out, folder, error)) return {};
  return input_error("--out " + out + ": expected another folder than that of the source, " + source);
}

Status check_apart(const std::vector<std::pair<std::string, std::string>>& files) {
  const auto same = [](const std::string& a, const std::string& b) {
    std::error_code error;
    const auto place = [&](const std::string& name) { return fs::weakly_canonical(fs::absolute(name, error), error); };
    return fs::equivalent(a, b, error) || place(a) == place(b);
  };
  for (std::size_t i = 0; i < files.size(); ++i)
    for (std::size_t k = i + 1; k < files.size(); ++k) {
      const auto& [one, first] = files[i];
      const auto& [other, second] = files[k];
      if (!first.empty() && !second.empty() && same(first, second))
        return input_error(other + " " + second + ": expected another file than " + one + ", " + first);
    }
  return {};
}

}  // namespace turncal
