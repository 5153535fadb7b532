#include "orchestrator/records/output_folder.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "imu_io/base/posix_file.h"

namespace turncal {

namespace fs = std::filesystem;

Result<OutputFolder> OutputFolder::prepare(const std::string& path, std::vector<std::string> names) {
  std::error_code error;
  if (path.empty()) return input_error("--out: expected a folder, got an empty name");
  if (fs::exists(path, error) && !fs::is_directory(path, error)) {
    return input_error(path + ": expected a folder, found a file");
  }
  for (const std::string& name : names) {
    if (fs::exists(fs::path(path) / name, error)) {
      return input_error(path + ": already holds " + name + "; give another folder, nothing is overwritten");
    }
  }
  OutputFolder folder(path, std::move(names));
  std::vector<fs::path> missing;
  for (fs::path p = fs::absolute(path, error).lexically_normal(); !p.empty() && !fs::exists(p, error);
       p = p.parent_path()) {
    if (p.has_filename()) missing.insert(missing.begin(), p);
  }
  for (const fs::path& p : missing) {
    fs::create_directory(p, error);
    if (error) return input_error(p.string() + ": cannot make this folder: " + error.message());
    folder.made_.push_back(p.string());
    // A folder that a power loss takes away would take all that is in it.
    if (Status status = sync_folder(folder_of(p.string())); !status) return status.error();
  }
  return folder;
}

OutputFolder::OutputFolder(OutputFolder&& other) noexcept
    : path_(std::move(other.path_)),
      names_(std::move(other.names_)),
      made_(std::move(other.made_)),
      active_(std::exchange(other.active_, false)) {}

OutputFolder::~OutputFolder() {
  if (!active_) return;
  std::error_code ignored;
  for (const std::string& name : names_) fs::remove(fs::path(path_) / name, ignored);
  // Only folders made here, and only when nobody else put something in.
  for (auto it = made_.rbegin(); it != made_.rend(); ++it) fs::remove(*it, ignored);
}

}  // namespace turncal
