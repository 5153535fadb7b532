// The folder that a command writes to. It is made when it is missing (with its parents), and refused when it holds one of the files that the
// command would write, or when another process writes to it. When the command fails, everything it made is removed.
//
// The lock on `.lock` in the folder is held from before that check until the end, so that later the files of these names are
// this command's.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/files.h"

namespace turncal {

inline constexpr const char* parameters_name = "parameters.conf";  // for runs, calibrations and diagnoses

// Locks a folder of results, before a writer looks at its contents.
Result<LockFile> hold_folder(const std::string& folder);

class OutputFolder {
 public:
  // `names`: files that must not exist, and that are removed on failure.
  static Result<OutputFolder> prepare(const std::string& path, std::vector<std::string> names);
  // Prepares a folder for estimates from a recording of `unit`: an earlier result of the unit is replaced; an error when the folder holds a run, or
  // parameters of another unit.
  static Result<OutputFolder> prepare_results(const std::string& path, const std::string& unit);
  OutputFolder(OutputFolder&& other) noexcept = default;
  OutputFolder& operator=(OutputFolder&&) = delete;
  ~OutputFolder();  // removes what was made, unless keep() was called

  const std::string& path() const { return path_; }
  std::string file(const std::string& name) const { return path_ + "/" + name; }
  void keep() {
    names_.clear();
    created_.clear();
  }

 private:
  OutputFolder(std::string path, std::vector<std::string> names) : path_(std::move(path)), names_(std::move(names)) {}
  Status make_missing();
  std::string path_;
  std::vector<std::string> names_;    // files to remove
  std::vector<std::string> created_;  // folders to remove, outermost first, unless others put something in
  std::optional<LockFile> lock_;
};

// Returns an error when `out` is the folder of `source` (a folder, or a file in it): results would stand beside their source, and
// readers of the folder could not tell them apart.
Status check_not_source(const std::string& out, const std::string& source);

// Checks the files that one command reads and writes, as (name of the option, path; empty: not given): an input error when two are the same.
Status check_apart(const std::vector<std::pair<std::string, std::string>>& files);

}  // namespace turncal
