#include "imu_io/base/lock_file.h"

#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "imu_io/base/clock.h"

namespace turncal {

namespace {

constexpr auto between_tries = std::chrono::milliseconds(20);
constexpr int most_races = 100;  // with others that make and remove the same file

// Of another user: to be read is enough for a lock.
Result<PosixFile> open_or_make(const std::string& path) {
  if (!path_exists(path)) return PosixFile::create_new(path);
  Result<PosixFile> file = PosixFile::open_to_change(path);
  if (!file && path_exists(path)) return PosixFile::open_to_read(path);
  return file;
}

}  // namespace

Result<LockFile> LockFile::acquire(const std::string& path, double wait_s) {
  const Deadline deadline(wait_s);
  for (int race = 0;; ++race) {
    Result<PosixFile> file = open_or_make(path);
    if (!file) {
      if (race < most_races && path_exists(folder_of(path))) continue;  // made or removed between two looks
      return file.error();
    }
    Status locked = file->lock_exclusive();
    while (!locked && !deadline.passed()) {
      std::this_thread::sleep_for(between_tries);
      locked = file->lock_exclusive();
    }
    if (!locked) return locked.error();
    if (file->is_at(path)) return LockFile(std::move(*file));
  }
}

std::optional<pid_t> lock_holder(const std::string& path) {
  struct stat file {};
  return ::stat(path.c_str(), &file) == 0 ? flock_holder(file, false) : std::nullopt;
}

LockFile::~LockFile() {
  if (file_.is_open()) ::unlink(file_.path().c_str());  // before it lets go
}

}  // namespace turncal
