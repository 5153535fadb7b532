// File access for the formats of this folder: reading, writing, syncing, renaming and locking. Errors name the path and the
// reason.
//
// Interrupted calls are repeated; a short write is completed or reported. Files are movable, not copyable, and not
// thread-safe.
#pragma once

#include <sys/types.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

class Descriptor {  // closes itself; -1: closed
 public:
  Descriptor(int number = -1) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(other.release()) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  operator int() const { return number_; }
  int release() { return std::exchange(number_, -1); }

 private:
  int number_;
};

class PosixFile {
 public:
  PosixFile() = default;
  PosixFile(PosixFile&&) noexcept;  // not inline: GCC 12 would give a false warning
  PosixFile& operator=(PosixFile&&) noexcept;

  static Result<PosixFile> open_to_read(const std::string& path);    // regular files only
  static Result<PosixFile> create_new(const std::string& path);      // fails when it exists; mode 0644 at most
  static Result<PosixFile> open_to_change(const std::string& path);  // to read and write; it must exist

  const std::string& path() const { return path_; }
  bool is_open() const { return fd_ >= 0; }
  Result<std::uint64_t> size() const;
  // Reads into `out` from `offset`; fewer bytes only at the end of the file.
  Result<std::size_t> read_at(std::uint64_t offset, std::span<std::byte> out) const;
  Status write_all(std::span<const std::byte> data);  // appends; fails, like sync(), where check_kept() does
  Status write_all(std::string_view text);
  Status seek(std::uint64_t offset);
  Status truncate(std::uint64_t size);
  Status sync();
  Status lock_exclusive();  // fails at once, naming the holder, when another process has the lock; close() releases it
  bool is_at(const std::string& path) const;                   // false: `path` is now another file, or none
  void renamed(std::string path) { path_ = std::move(path); }  // tells the object of a rename that the caller made
  // Returns an error when the file was moved, replaced, truncated or extended by somebody else.
  Status check_kept() const;
  Status close();  // reports the error that a destructor would swallow

 private:
  PosixFile(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  Error failure(std::string_view what) const;

  Descriptor fd_;
  std::string path_;
  std::uint64_t end_ = 0;  // end of what was written, or the offset of seek()
};

// A read-only view of a file up to `end`, buffered in 1 MiB or in the largest piece requested. The file must outlive it.
class FileWindow {
 public:
  FileWindow(const PosixFile& file, std::uint64_t end) : file_(file), end_(end) {}
  // Returns what is buffered from `offset` (<= end()): at least `least` bytes or all that are left, valid until the next call; 64 more may be read.
  Result<std::span<const std::byte>> at(std::uint64_t offset, std::uint64_t least);
  std::uint64_t end() const { return end_; }  // decreases if the file is truncated while it is read

 private:
  const PosixFile& file_;
  std::uint64_t end_, from_ = 0;
  std::size_t filled_ = 0;
  std::vector<std::byte> buffer_;
};

// Reads the whole file; an error above max_bytes.
Result<std::string> read_whole_file(const std::string& path, std::size_t max_bytes = std::size_t{64} << 20);
bool path_exists(const std::string& path);
std::vector<std::string> names_in(const std::string& folder);  // sorted; empty: none, or no such folder
// Returns did_you_mean() (text.h) of the names beside a file that is not there.
std::string file_meant(const std::string& path);
Status make_folder(const std::string& path);  // with its parents; no error if it exists
// Returns an error when a folder, device or pipe has this name; no error when nothing has.
Status check_regular_file(const std::string& path);
// Returns `path` or its nearest parent that exists.
std::string existing_folder_of(const std::string& path);
// Checks by creating something there and removing it.
Status check_folder_writable(const std::string& path);
// Returns "path: what: reason" for a failure to make or change a file. The kind is device if the storage failed, input if the name is wrong.
Error storage_error(const std::string& path, std::string_view what, int number);
Status sync_folder(const std::string& folder);
std::string folder_of(const std::string& path);  // "." when there is no '/' in path

// A lock between processes: flock() on a file that exists only for it. The kernel releases the lock when the holder ends in any way,
// so a file left behind blocks nobody. A second thread or object of the same process is refused, too.
//
//   Result<LockFile> lock = LockFile::acquire(folder + "/.lock");   // "...: in use by another process (4711)"
//
// The file is removed with the lock. A process that had opened the file before sees that the name is another file now, and tries again.
// Not for network file systems without flock(); the error says so.
class LockFile {
 public:
  static constexpr double change_s =
      5.0;  // wait_s for a lock that is held only while a file is changed, which takes milliseconds
  // Creates the file if it is missing (its folder must exist). Waits at most wait_s while another process holds the lock.
  static Result<LockFile> acquire(const std::string& path, double wait_s = 0.0);
  LockFile(LockFile&& other) noexcept = default;
  LockFile& operator=(LockFile&&) = delete;
  ~LockFile();

 private:
  explicit LockFile(PosixFile file) : file_(std::move(file)) {}
  PosixFile file_;
};

// Returns the process that holds the lock, from /proc/locks. It takes no lock itself, so it never blocks anybody. Empty when nobody
// holds it or the table cannot be read. Not for file systems whose table names another device (btrfs).
std::optional<pid_t> lock_holder(const std::string& path);

// ---- atomic writes ----

// Writes a file so that nobody ever sees half of it: it writes to a temporary name in the same folder, syncs, renames and syncs
// the folder. Until commit() the old file, if any, stays; without commit() the temporary is removed.
//
// A killed process can leave `.<name>.<pid>.<n>.tmp` behind; nothing reads those names.
class AtomicFile {
 public:
  static Result<AtomicFile> create(const std::string& path);
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  // Buffered. The first failure is returned and makes commit() fail.
  Status write(std::string_view text);
  // Syncs everything written to disk under the temporary name. commit() then needs no more room.
  Status settle();
  Status commit();

 private:
  AtomicFile(PosixFile file, std::string path) : file_(std::move(file)), path_(std::move(path)) {}
  Status flush();

  PosixFile file_;    // under the temporary name
  std::string path_;  // the final name; empty once committed or moved from
  std::string buffer_;
  bool failed_ = false;
};

// Appends to a file, which is created if missing, and syncs it. If the text does not fit, the file is cut back to what it was.
Status append_durably(const std::string& path, std::string_view text);

Status write_file_atomically(const std::string& path, std::string_view content);
// Writes and syncs all temporaries before it renames the first, so that a full disk leaves every old file as it was.
struct NamedText {
  std::string path;
  std::string content;
};
Status write_files_atomically(const std::vector<NamedText>& files);

// Returns an input error unless `path` is free, empty, or begins with `beginning` like the new file. A file named by a user is replaced
// only by one of its own kind: a typing error must not destroy a results database.
Status check_replaceable(const std::string& path, std::string_view beginning);

// Returns a free temporary name for `path` in the same folder.
std::string temporary_name(const std::string& path);
// Replaces the temporary name in an error by the one that the user knows.
Error named(Error error, const std::string& temporary, const std::string& path);
// Renames the file and syncs the folder.
Status rename_durably(const std::string& from, const std::string& to);

}  // namespace turncal
