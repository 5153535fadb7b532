#include "imu_io/base/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <fstream>
#include <utility>

namespace turncal {
namespace {
constexpr std::size_t buffer_bytes = std::size_t{1} << 20;
}

std::string temporary_name(const std::string& path) {
  static std::atomic<unsigned> counter{0};
  const std::size_t name = path.find_last_of('/') + 1;  // 0 without one
  std::string candidate;
  // A process with our number may have died and left its temporary: take the next name.
  do {
    candidate = fmt::format("{}.{}.{}.{}.tmp", path.substr(0, name), path.substr(name), ::getpid(), counter++);
  } while (::access(candidate.c_str(), F_OK) == 0);
  return candidate;
}

Error named(Error error, const std::string& temporary, const std::string& path) {
  const std::size_t place = error.message.find(temporary);
  if (place != std::string::npos) error.message.replace(place, temporary.size(), path);
  return error;
}

Status rename_durably(const std::string& from, const std::string& to) {
  if (std::rename(from.c_str(), to.c_str()) != 0) return storage_error(to, "cannot rename " + from + " to it", errno);
  return sync_folder(folder_of(to));
}

Status append_durably(const std::string& path, std::string_view text) {
  const Descriptor fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  struct stat before {};
  if (fd < 0 || ::fstat(fd, &before) != 0) return storage_error(path, "cannot write", errno);
  errno = ENOSPC;  // of a write that is short
  if (::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && ::fsync(fd) == 0) return {};
  const int why = errno;
  return storage_error(path, ::ftruncate(fd, before.st_size) == 0 ? "cannot write" : "written in part", why);
}

Status check_replaceable(const std::string& path, std::string_view beginning) {
  std::ifstream file(path, std::ios::binary);
  std::string found(beginning.size(), '\0');
  file.read(found.data(), static_cast<std::streamsize>(found.size()));
  found.resize(static_cast<std::size_t>(file.gcount()));
  if (found.empty() || found == beginning) return {};
  return input_error(path +
                     ": holds something else than would be written: expected another name, or a file of the same kind");
}

Result<AtomicFile> AtomicFile::create(const std::string& path) {
  // A device or a pipe would be replaced by a file of its name.
  TRY(check_regular_file(path));
  const std::string temporary = temporary_name(path);
  auto file = PosixFile::create_new(temporary);
  if (!file) return named(file.error(), temporary, path);
  return AtomicFile(std::move(*file), path);
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : file_(std::move(other.file_)),
      path_(std::exchange(other.path_, {})),
      buffer_(std::move(other.buffer_)),
      failed_(other.failed_) {}

AtomicFile::~AtomicFile() {
  if (!path_.empty()) ::unlink(file_.path().c_str());
}

Status AtomicFile::flush() {
  Status status = file_.write_all(buffer_);
  buffer_.clear();
  if (!status) failed_ = true;
  return status;
}

Status AtomicFile::write(std::string_view text) {
  buffer_.append(text);
  if (buffer_.size() >= buffer_bytes) return flush();
  return {};
}

Status AtomicFile::settle() {
  if (failed_) return Error{ErrorKind::device, path_ + ": not written, an earlier write failed"};
  TRY(flush());
  return file_.sync();
}

Status AtomicFile::commit() {
  TRY(settle());
  const std::string temporary = file_.path();
  TRY(file_.close());
  if (std::rename(temporary.c_str(), path_.c_str()) != 0)
    return storage_error(path_, "cannot rename the temporary file to it", errno);
  // From here on the new file is visible: nothing is left to remove.
  const std::string folder = folder_of(std::exchange(path_, {}));
  return sync_folder(folder);
}

Status write_file_atomically(const std::string& path, std::string_view content) {
  AtomicFile file = TRY(AtomicFile::create(path));
  TRY(file.write(content));
  return file.commit();
}

Status write_files_atomically(const std::vector<NamedText>& files) {
  std::vector<AtomicFile> written;
  for (const NamedText& named : files) {
    AtomicFile file = TRY(AtomicFile::create(named.path));
    TRY(file.write(named.content));
    TRY(file.settle());
    written.push_back(std::move(file));
  }
  for (AtomicFile& file : written) TRY(file.commit());
  return {};
}

}  // namespace turncal
