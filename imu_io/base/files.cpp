#include "imu_io/base/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

Error error_of(ErrorKind kind, const std::string& path, std::string_view what, int number) {
  return {kind, path + ": " + std::string(what) + ": " + std::strerror(number)};
}

// A file named by the user that is missing or unreadable is an input error. A failing disk, or a system that has run out of a resource,
// is a device error.
Error system_error(const std::string& path, std::string_view what, int number) {
  constexpr int failed[] = {ENOSPC, EDQUOT, EIO, EMFILE, ENFILE, ENOMEM, EFBIG};
  const bool device = std::ranges::count(failed, number) > 0;
  Error error = error_of(device ? ErrorKind::device : ErrorKind::input, path, what, number);
  if (number == ENOENT) error.message += file_meant(path);
  return error;
}

Error not_regular(const std::string& path) { return input_error(path + ": not a regular file"); }

template <class Call>
auto repeat_interrupted(Call call) {
  decltype(call()) result;
  do {
    result = call();
  } while (result < 0 && errno == EINTR);
  return result;
}

constexpr auto between_tries = std::chrono::milliseconds(20);
constexpr int most_races = 100;  // races with processes that create and remove the same file

// Another user's file: read access is enough for a lock.
Result<PosixFile> open_or_make(const std::string& path) {
  if (!path_exists(path)) return PosixFile::create_new(path);
  Result<PosixFile> file = PosixFile::open_to_change(path);
  if (!file && path_exists(path)) return PosixFile::open_to_read(path);
  return file;
}

// Returns the process that holds a flock() on a file, from /proc/locks. Empty when nobody holds it or the table does not show the holder
// (on another machine, in another container). `any_device` compares inode numbers only, for file systems whose table names another device
// (btrfs); two files with the same inode number are then confused.
std::optional<pid_t> flock_holder(const struct stat& file, bool any_device) {
  const std::string inode = fmt::format(":{}", file.st_ino);
  const std::string place = fmt::format("{:02x}:{:02x}{}", major(file.st_dev), minor(file.st_dev), inode);
  std::ifstream locks("/proc/locks");
  for (std::string line; std::getline(locks, line);) {  // "1: FLOCK  ADVISORY  WRITE 4711 fe:00:11012251 0 EOF"
    const std::vector<std::string_view> words = split_words(line);
    if (words.size() < 6 || words[1] != "FLOCK" || !(any_device ? words[5].ends_with(inode) : words[5] == place))
      continue;
    if (const auto holder = parse_integer<pid_t>(words[4]); holder && *holder > 0) return holder;
  }
  return {};
}

}  // namespace

// A failure to create or change a file is the storage's, unless the error number says that the name is wrong.
Error storage_error(const std::string& path, std::string_view what, int number) {
  constexpr int wrong_name[] = {ENOENT, ENOTDIR, EISDIR, EEXIST, EINVAL, ENAMETOOLONG};
  const bool input = std::ranges::count(wrong_name, number) > 0;
  return error_of(input ? ErrorKind::input : ErrorKind::device, path, what, number);
}

PosixFile::PosixFile(PosixFile&&) noexcept = default;
PosixFile& PosixFile::operator=(PosixFile&&) noexcept = default;

Error PosixFile::failure(std::string_view what) const { return system_error(path_, what, errno); }

Result<PosixFile> PosixFile::open_to_read(const std::string& path) {
  // Non-blocking, so that a pipe given by mistake cannot block the program.
  const int fd = repeat_interrupted([&] { return ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); });
  if (fd < 0) return system_error(path, "cannot open", errno);
  PosixFile file(fd, path);
  struct stat facts {};
  if (::fstat(fd, &facts) != 0) return file.failure("cannot look at");
  if (!S_ISREG(facts.st_mode)) return not_regular(path);
  return file;
}

Result<PosixFile> PosixFile::create_new(const std::string& path) {
  const int fd = repeat_interrupted([&] { return ::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0644); });
  if (fd < 0) return storage_error(path, "cannot create", errno);
  return PosixFile(fd, path);
}

Result<PosixFile> PosixFile::open_to_change(const std::string& path) {
  const int fd = repeat_interrupted([&] { return ::open(path.c_str(), O_RDWR | O_CLOEXEC); });
  if (fd < 0) return storage_error(path, "cannot open for writing", errno);
  return PosixFile(fd, path);
}

Result<std::uint64_t> PosixFile::size() const {
  struct stat facts {};
  if (::fstat(fd_, &facts) != 0) return failure("cannot look at");
  return std::uint64_t(facts.st_size);
}

Result<std::size_t> PosixFile::read_at(std::uint64_t offset, std::span<std::byte> out) const {
  std::size_t done = 0;
  while (done < out.size()) {
    const ssize_t n = repeat_interrupted(
        [&] { return ::pread(fd_, out.data() + done, out.size() - done, static_cast<off_t>(offset + done)); });
    if (n < 0) return failure("cannot read");
    if (n == 0) break;
    done += std::size_t(n);
  }
  return done;
}

Status PosixFile::write_all(std::span<const std::byte> data) {
  TRY(check_kept());
  while (!data.empty()) {
    const ssize_t n = repeat_interrupted([&] { return ::write(fd_, data.data(), data.size()); });
    if (n < 0) return failure("cannot write");
    data = data.subspan(std::size_t(n));
    end_ += std::uint64_t(n);
  }
  return {};
}

Status PosixFile::write_all(std::string_view text) {
  return write_all(std::as_bytes(std::span(text.data(), text.size())));
}

Status PosixFile::seek(std::uint64_t offset) {
  if (::lseek(fd_, static_cast<off_t>(offset), SEEK_SET) < 0) return failure("cannot seek");
  end_ = offset;
  return {};
}

Status PosixFile::truncate(std::uint64_t size) {
  if (repeat_interrupted([&] { return ::ftruncate(fd_, static_cast<off_t>(size)); }) != 0)
    return failure("cannot truncate");
  return {};
}

Status PosixFile::sync() {
  TRY(check_kept());
  if (repeat_interrupted([&] { return ::fsync(fd_); }) != 0) return failure("cannot sync to disk");
  return {};
}

Status PosixFile::lock_exclusive() {
  if (repeat_interrupted([&] { return ::flock(fd_, LOCK_EX | LOCK_NB); }) == 0) return {};
  if (errno == EWOULDBLOCK) {
    struct stat facts {};
    const auto holder = ::fstat(fd_, &facts) == 0 ? flock_holder(facts, true) : std::nullopt;
    return device_error(path_ + ": in use by another process" + (holder ? fmt::format(" ({})", *holder) : ""));
  }
  return failure("cannot lock");
}

bool PosixFile::is_at(const std::string& path) const {
  struct stat here {
  }, there{};
  return ::fstat(fd_, &here) == 0 && ::stat(path.c_str(), &there) == 0 && here.st_ino == there.st_ino &&
         here.st_dev == there.st_dev;
}

Status PosixFile::check_kept() const {
  if (!is_at(path_))
    return device_error(path_ +
                        (path_exists(path_) ? ": is another file now, somebody replaced it"
                                            : ": is no longer there, somebody moved or removed it") +
                        ": expected the folder of a run to stay");
  struct stat facts {};
  if (::fstat(fd_, &facts) != 0) return failure("cannot look at");
  if (!S_ISREG(facts.st_mode) || std::uint64_t(facts.st_size) == end_) return {};
  return device_error(fmt::format("{}: somebody else has changed it: it is {} bytes long where {} were written", path_,
                                  facts.st_size, end_));
}

Status PosixFile::close() {
  const int fd = fd_.release();
  if (fd >= 0 && ::close(fd) != 0 && errno != EINTR) return failure("cannot close");
  return {};
}

Result<std::span<const std::byte>> FileWindow::at(std::uint64_t offset, std::uint64_t least) {
  constexpr std::uint64_t block_bytes = std::uint64_t{1} << 20, slack_bytes = 64;
  least = std::min(least, end_ - offset);
  if (offset < from_ || offset + least > from_ + filled_) {
    const std::uint64_t size = std::min(std::max(least, block_bytes), end_ - offset);
    if (buffer_.size() < size + slack_bytes) buffer_.resize(size + slack_bytes);
    from_ = offset;
    filled_ = TRY(file_.read_at(offset, std::span(buffer_).first(size)));
    if (filled_ < size) end_ = offset + filled_;
  }
  return std::span<const std::byte>(buffer_).subspan(offset - from_, from_ + filled_ - offset);
}

Result<std::string> read_whole_file(const std::string& path, std::size_t max_bytes) {
  const PosixFile file = TRY(PosixFile::open_to_read(path));
  const std::uint64_t size = TRY(file.size());
  if (size > max_bytes) return input_error("{}: {} bytes: expected at most {}", path, size, max_bytes);
  std::string text(std::size_t(size), '\0');
  text.resize(TRY(file.read_at(0, std::as_writable_bytes(std::span(text.data(), text.size())))));
  return text;
}

Status check_regular_file(const std::string& path) {
  struct stat facts {};
  if (::stat(path.c_str(), &facts) == 0 && !S_ISREG(facts.st_mode)) return not_regular(path);
  return {};
}

bool path_exists(const std::string& path) { return ::access(path.c_str(), F_OK) == 0; }

std::vector<std::string> names_in(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
    names.push_back(entry->path().filename().string());
  std::ranges::sort(names);
  return names;
}

std::string file_meant(const std::string& path) {
  return did_you_mean(path.substr(path.rfind('/') + 1), names_in(folder_of(path)));
}

Status make_folder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) return storage_error(path, "cannot make folder", error.value());
  return {};
}

std::string existing_folder_of(const std::string& path) {
  std::error_code error;
  std::filesystem::path at = std::filesystem::absolute(path, error).lexically_normal();
  while (!at.empty() && at.has_relative_path() && !std::filesystem::exists(at, error)) at = at.parent_path();
  return at.string();
}

Status check_folder_writable(const std::string& path) {
  const std::string folder = existing_folder_of(path);
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error)) return input_error(folder + ": expected a folder, found a file");
  // Permissions are not enough: root may write in /proc, and yet cannot create a file there.
  std::string probe = folder + "/.turncal.XXXXXX";
  if (!path_exists(path)) {  // the first thing created will be a folder
    if (::mkdtemp(probe.data()) == nullptr) return storage_error(folder, "no folder can be made there", errno);
    ::rmdir(probe.c_str());
    return {};
  }
  const Descriptor fd = ::mkostemp(probe.data(), O_CLOEXEC);
  if (fd < 0) return storage_error(folder, "no file can be made there", errno);
  ::unlink(probe.c_str());
  return {};
}

std::string folder_of(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

Status sync_folder(const std::string& folder) {
  const Descriptor fd = repeat_interrupted([&] { return ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); });
  if (fd < 0) return system_error(folder, "cannot open folder", errno);
  if (repeat_interrupted([&] { return ::fsync(fd); }) != 0) return system_error(folder, "cannot sync folder", errno);
  return {};
}

// ---- a lock between processes ----

Result<LockFile> LockFile::acquire(const std::string& path, double wait_s) {
  const Deadline deadline(wait_s);
  for (int race = 0;; ++race) {
    Result<PosixFile> file = open_or_make(path);
    if (!file) {
      if (race < most_races && path_exists(folder_of(path))) continue;  // created or removed between two checks
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
  if (file_.is_open()) ::unlink(file_.path().c_str());  // before the lock is released
}

// ---- atomic writes ----

namespace {
constexpr std::size_t buffer_bytes = std::size_t{1} << 20;
}

std::string temporary_name(const std::string& path) {
  static std::atomic<unsigned> counter{0};
  const std::size_t name = path.find_last_of('/') + 1;  // 0 without one
  std::string candidate;
  // An earlier process with our id may have died and left its temporary: take the next name.
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
  errno = ENOSPC;  // reported for a short write
  if (::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && ::fsync(fd) == 0) return {};
  const int why = errno;
  return storage_error(path, ::ftruncate(fd, before.st_size) == 0 ? "cannot write" : "written in part", why);
}

Status check_replaceable(const std::string& path, std::string_view beginning) {
  TRY(check_regular_file(path));
  std::ifstream file(path, std::ios::binary);
  std::string found(beginning.size(), '\0');
  file.read(found.data(), static_cast<std::streamsize>(found.size()));
  found.resize(std::size_t(file.gcount()));
  if (found.empty() || found == beginning) return {};
  return input_error(path + ": is a file of another kind, and is not replaced: expected another name");
}

Result<AtomicFile> AtomicFile::create(const std::string& path) {
  // Renaming would replace a device or a pipe by a file.
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
  // The new file is visible from here on, so no temporary is left to remove.
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
