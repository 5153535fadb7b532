// A file in memory that is written anew for every input.
#pragma once

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "input.h"

namespace turncal::fuzz {

class ScratchFolder {
 public:
  ScratchFolder() {
    std::string pattern = (::access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp") + std::string("/turncal_fuzz_XXXXXX");
    require(::mkdtemp(pattern.data()) != nullptr);
    path_ = pattern;
  }
  ~ScratchFolder() { ::rmdir(path_.c_str()); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

class ScratchFile {
 public:
  ScratchFile(const ScratchFolder& folder, const std::string& name) : path_(folder.path() + "/" + name) {
    fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    require(fd_ >= 0);
  }
  ~ScratchFile() {
    ::close(fd_);
    ::unlink(path_.c_str());
  }
  ScratchFile(const ScratchFile&) = delete;
  const std::string& path() const { return path_; }
  void write(std::span<const std::byte> content) const {
    require(::ftruncate(fd_, 0) == 0);
    require(::pwrite(fd_, content.data(), content.size(), 0) == static_cast<ssize_t>(content.size()));
  }

 private:
  std::string path_;
  int fd_ = -1;
};

}  // namespace turncal::fuzz
