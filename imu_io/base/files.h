// A file descriptor that closes itself, with errors that name path and reason. All reading, writing, syncing and
// renaming of this folder's formats goes through here.
//
// Interrupted calls are repeated; a short write is completed or reported. Movable, not copyable; not for concurrent
// use.
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

class Descriptor {  // closes itself; -1: none
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
  PosixFile(PosixFile&&) noexcept;  // not inline: GCC 12 then warns of what is not so
  PosixFile& operator=(PosixFile&&) noexcept;

  static Result<PosixFile> open_to_read(const std::string& path);    // a regular file
  static Result<PosixFile> create_new(const std::string& path);      // fails when it exists; mode 0644 at most
  static Result<PosixFile> open_to_change(const std::string& path);  // read and write, must exist

  const std::string& path() const { return path_; }
  bool is_open() const { return fd_ >= 0; }
  Result<std::uint64_t> size() const;
  // Fills the front of `out` from `offset`; fewer bytes only at the end of the file.
  Result<std::size_t> read_at(std::uint64_t offset, std::span<std::byte> out) const;
  Status write_all(std::span<const std::byte> data);  // at the end; an error, as of sync(), where it is not kept
  Status write_all(std::string_view text);
  Status seek(std::uint64_t offset);
  Status truncate(std::uint64_t size);
  Status sync();
  Status lock_exclusive();  // fails at once when another process holds it, and says which; released by close
  bool is_at(const std::string& path) const;  // false: the name stands for another file now, or for none
  void renamed(std::string path) { path_ = std::move(path); }  // by whoever calls
  // An error where it is no longer at its name, or not as long as what was written: somebody moved, replaced, cut or lengthened it.
  Status check_kept() const;
  Status close();  // reports what a destructor must swallow

 private:
  PosixFile(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  Error failure(std::string_view what) const;

  Descriptor fd_;
  std::string path_;
  std::uint64_t end_ = 0;  // of what was written, or where seek() went
};

// A file up to `end`, in a buffer of 1 MiB or as large as the largest piece asked for. The file must outlive it.
class FileWindow {
 public:
  FileWindow(const PosixFile& file, std::uint64_t end) : file_(file), end_(end) {}
  // What is buffered from `offset` (at most end()) on: `least` bytes, or all that there are. Until the next call; 64 bytes more can be looked at.
  Result<std::span<const std::byte>> at(std::uint64_t offset, std::uint64_t least);
  std::uint64_t end() const { return end_; }  // comes nearer where the file was cut while it was read

 private:
  const PosixFile& file_;
  std::uint64_t end_, from_ = 0;
  std::size_t filled_ = 0;
  std::vector<std::byte> buffer_;
};

// The whole file; an error above max_bytes.
Result<std::string> read_whole_file(const std::string& path, std::size_t max_bytes = std::size_t{64} << 20);
bool path_exists(const std::string& path);
Status make_folder(const std::string& path);  // with its parents; fine when it exists
// An error when a folder, a device or a pipe stands at this name; none when nothing does.
Status check_regular_file(const std::string& path);
// The next folder above `path` that is there, or itself.
std::string existing_folder_of(const std::string& path);
// Makes something there for a try, and removes it.
Status check_folder_writable(const std::string& path);
// "path: what: reason" of a failure to make or change something: the storage failed (kind device), or the name was wrong (input).
Error storage_error(const std::string& path, std::string_view what, int number);
Status sync_folder(const std::string& folder);
std::string folder_of(const std::string& path);  // "." when path names none

// A lock between processes: flock on a file that is there for that alone. The system lets go of it when its holder ends, however that
// was, so a file that is left over holds nobody up. Of two threads or objects of one process the second is refused, too.
//
//   Result<LockFile> lock = LockFile::acquire(folder + "/.lock");   // "...: in use by another process (4711)"
//
// The file is taken away with the lock. Whoever opened it before that finds that the name stands for another file, and begins anew.
// Not for a folder of another machine whose file system has no flock; the error says so.
class LockFile {
 public:
  static constexpr double change_s =
      5.0;  // wait_s for a lock that is held while a file is changed, which takes milliseconds
  // Made when it is missing (its folder must be there). Waits for wait_s at most while another holds it.
  static Result<LockFile> acquire(const std::string& path, double wait_s = 0.0);
  LockFile(LockFile&& other) noexcept = default;
  LockFile& operator=(LockFile&&) = delete;
  ~LockFile();

 private:
  explicit LockFile(PosixFile file) : file_(std::move(file)) {}
  PosixFile file_;
};

// The process that holds it now, from the system's table of locks: who looks on does not lock, so that nobody is refused on its
// account. Nothing: nobody holds it, or the table cannot be read. Not for file systems whose table names another device (btrfs).
std::optional<pid_t> lock_holder(const std::string& path);

// ---- whole or not there ----

// Writes a file so that nobody ever sees half of it: to a temporary name in the same folder, synced, renamed, folder
// synced. Until commit() the old file, if any, stays as it was; without commit() the temporary is removed.
//
// A process that is killed can leave `.<name>.<pid>.<n>.tmp` behind; nothing reads those names.
class AtomicFile {
 public:
  static Result<AtomicFile> create(const std::string& path);
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  // Buffered. The first failure is returned and makes commit() fail.
  Status write(std::string_view text);
  // All that was written is on disk, under the temporary name; what commit() then does needs no room.
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

// On disk when it returns, at the end of a file that is made where there is none; of a text that does not fit nothing stays.
Status append_durably(const std::string& path, std::string_view text);

Status write_file_atomically(const std::string& path, std::string_view content);
// All of them or, where one cannot be written (a full disk), none.
struct NamedText {
  std::string path;
  std::string content;
};
Status write_files_atomically(const std::vector<NamedText>& files);

// A file named by a user is replaced by one of its own kind only: an input error unless nothing is there, it is empty, or it begins
// with `beginning` as the new one does. A results database given for its own table would be gone otherwise.
Status check_replaceable(const std::string& path, std::string_view beginning);

// A free temporary name for `path` in the same folder.
std::string temporary_name(const std::string& path);
// An error that names the file as its user does, and not by its temporary name.
Error named(Error error, const std::string& temporary, const std::string& path);
// Renames and syncs the folder.
Status rename_durably(const std::string& from, const std::string& to);

}  // namespace turncal
