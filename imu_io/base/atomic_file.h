// Writes a file so that nobody ever sees half of it: to a temporary name in the same folder, synced, renamed, folder
// synced. Until commit() the old file, if any, stays as it was; without commit() the temporary is removed.
//
// A process that is killed can leave `.<name>.<pid>.<n>.tmp` behind; nothing reads those names.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/posix_file.h"

namespace turncal {

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
