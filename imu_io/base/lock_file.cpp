#include "imu_io/base/lock_file.h"

#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <span>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

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
  if (::stat(path.c_str(), &file) != 0) return {};
  const Result<PosixFile> locks = PosixFile::open_to_read("/proc/locks");  // of no size
  if (!locks) return {};
  std::string table(std::size_t{1} << 18, '\0');
  const Result<std::size_t> got = locks->read_at(0, std::as_writable_bytes(std::span(table.data(), table.size())));
  if (!got) return {};
  char place[64];
  std::snprintf(place, sizeof place, " %02x:%02x:%llu ", major(file.st_dev), minor(file.st_dev),
                static_cast<unsigned long long>(file.st_ino));
  std::string_view remaining = std::string_view(table).substr(0, *got);
  while (!remaining.empty()) {
    const std::string_view line = next_line(remaining);  // "1: FLOCK  ADVISORY  WRITE 4711 fe:00:11012251 0 EOF"
    const std::size_t at = line.find(place);
    if (at == std::string_view::npos) continue;
    const std::string_view before = line.substr(0, at);
    const bool holds = before.find("FLOCK") != std::string_view::npos && before.find("->") == std::string_view::npos;
    const std::optional<pid_t> holder = parse_integer<pid_t>(before.substr(before.rfind(' ') + 1));
    if (holds && holder && *holder > 0) return holder;
  }
  return {};
}

LockFile::~LockFile() {
  if (file_.is_open()) ::unlink(file_.path().c_str());  // before it lets go
}

}  // namespace turncal
