// A lock between processes: flock on a file that is there for that alone. The system lets go of it when its holder ends, however that
// was, so a file that is left over holds nobody up. Of two threads or objects of one process the second is refused, too.
//
//   Result<LockFile> lock = LockFile::acquire(folder + "/.lock");   // "...: in use by another process (4711)"
//
// The file is taken away with the lock. Whoever opened it before that finds that the name stands for another file, and begins anew.
// Not for a folder of another machine whose file system has no flock; the error says so.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

#include "calib/types/status.h"
#include "imu_io/base/posix_file.h"

namespace turncal {

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

}  // namespace turncal
