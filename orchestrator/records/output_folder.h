// The folder a command writes to. Made when it is missing (with its parents); refused when it already holds one of the files the
// command would write, or when another process writes to it; and when the command fails, whatever it made is taken away again.
//
// A lock on `.lock` in the folder is held from before that look until the end, so that what stands under these names afterwards was
// made here.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/files.h"

namespace turncal {

inline constexpr const char* parameters_name = "parameters.conf";  // of a run, a calibration and a diagnosis

// Held by whoever writes to a folder of results, from before it looks at what is there.
Result<LockFile> hold_folder(const std::string& folder);

class OutputFolder {
 public:
  // `names`: files that must not be there, and that are removed again on failure.
  static Result<OutputFolder> prepare(const std::string& path, std::vector<std::string> names);
  // For what is estimated of a recording of `unit`: an earlier result of the unit is replaced; an error when the folder holds a run, or
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
  std::vector<std::string> names_;    // what is removed again
  std::vector<std::string> created_;  // folders, outermost first; the same, where nobody else put something in
  std::optional<LockFile> lock_;
};

// An error when `out` is the folder of `source` (a folder, or a file in it): what is written would stand beside what it is made of, and
// whoever reads the folder could not tell them apart.
Status check_not_source(const std::string& out, const std::string& source);

// Files that one command reads and writes, as (what it is called, path; empty: not given): an input error where two are the same.
Status check_apart(const std::vector<std::pair<std::string, std::string>>& files);

}  // namespace turncal
