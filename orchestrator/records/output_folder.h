// The folder a command writes to. Made when it is missing (with its parents); refused when it already holds one of the files the
// command would write; and when the command fails, whatever it made is taken away again.
#pragma once

#include <string>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

class OutputFolder {
 public:
  // `names`: files that must not be there, and that are removed again on failure.
  static Result<OutputFolder> prepare(const std::string& path, std::vector<std::string> names);
  OutputFolder(OutputFolder&& other) noexcept;
  OutputFolder& operator=(OutputFolder&&) = delete;
  ~OutputFolder();  // removes what was made, unless keep() was called

  const std::string& path() const { return path_; }
  std::string file(const std::string& name) const { return path_ + "/" + name; }
  void keep() { active_ = false; }

 private:
  OutputFolder(std::string path, std::vector<std::string> names) : path_(std::move(path)), names_(std::move(names)) {}
  std::string path_;
  std::vector<std::string> names_;
  std::vector<std::string> made_;  // folders, outermost first
  bool active_ = true;
};

}  // namespace turncal
