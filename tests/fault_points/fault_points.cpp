// For tests only, loaded by LD_PRELOAD in front of the C library: counts every write, sync, truncation and rename of files and
// strikes at one of them. The program itself knows nothing of it.
//
//   TURNCAL_FAULT_POINT=n   the n-th call, from 1; 0: only count
//   TURNCAL_FAULT_MODE=kill   a write is done by half, then SIGKILL
//                      power  every file loses what it was not synced for, then SIGKILL (renames stay: not modelled)
//                      full   from here on every write fails with ENOSPC
//   TURNCAL_FAULT_FOLDER=FOLDER TURNCAL_FAULT_COPIES=" 12k 24p"   in place of a point: at the 12th call FOLDER is copied to FOLDER.12 as a
//                      kill leaves it, and what was printed until then to FOLDER.12/said; at the 24th as a power cut does; the program goes on
//   TURNCAL_FAULT_RENAMED=NAME   SIGKILL when a file has got this name
//   or, with TURNCAL_FAULT_AFTER_S seconds after the start for TURNCAL_FAULT_FOR_S seconds (0: for good) in place of a point,
//                      hang_sync, hang_write   a sync, or a write, does not return
//                      fail, full_for          syncs and writes fail with EIO; writes with ENOSPC
//                      clock                   civil time is off by TURNCAL_FAULT_STEP_S
//   TURNCAL_FAULT_NOW_S=t     civil time stands still at t, with any mode or none
//   TURNCAL_FAULT_COUNT=FILE  written at the end: the number of calls, and how often something was written to any file, or the
//                             program ended, while a record of a journal was not yet synced
#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

struct Tracked {
  ino_t inode;
  off_t synced;
  int fd;  // of its own, so that locks and closes of the program do not matter
};
Tracked tracked[256];
int tracked_count = 0;
long calls = 0;
long unsynced = 0;    // see TURNCAL_FAULT_COUNT
int journal_fd = -1;  // with a record that is not synced

template <class Function>
Function real(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
long point() {
  static const char* text = getenv("TURNCAL_FAULT_POINT");
  return text ? atol(text) : 0;
}
bool mode_is(const char* wanted) {
  static const char* text = getenv("TURNCAL_FAULT_MODE");
  return text && strcmp(text, wanted) == 0;
}
double number(const char* name) {
  const char* text = getenv(name);
  return text ? atof(text) : 0.0;
}
double clock_s(clockid_t clock) {
  timespec now{};
  syscall(SYS_clock_gettime, clock, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}
const double started_s = clock_s(CLOCK_MONOTONIC);
// Seconds until what lasts for a time is over; 0: it does not hold now.
double holds_s() {
  static const bool timed = getenv("TURNCAL_FAULT_AFTER_S") != nullptr;
  static const double after_s = number("TURNCAL_FAULT_AFTER_S"), for_s = number("TURNCAL_FAULT_FOR_S");
  const double passed_s = clock_s(CLOCK_MONOTONIC) - started_s - after_s;
  if (!timed || started_s == 0.0 || passed_s < 0.0) return 0.0;
  return for_s == 0.0 ? 1e9 : for_s > passed_s ? for_s - passed_s : 0.0;
}
void hang() {
  for (double left_s = holds_s(); left_s > 0.0; left_s = holds_s()) {
    const timespec pause{left_s > 1e6 ? 1000000 : static_cast<time_t>(left_s),
                         long(1e9 * (left_s > 1e6 ? 0.0 : left_s - double(static_cast<time_t>(left_s))))};
    nanosleep(&pause, nullptr);
  }
}
bool is_file(int fd) {
  struct stat facts;
  return fd > 2 && fstat(fd, &facts) == 0 && S_ISREG(facts.st_mode);
}

std::string path_of(int fd) {
  char path[512] = {};
  const ssize_t size = readlink(("/proc/self/fd/" + std::to_string(fd)).c_str(), path, sizeof path);
  return {path, static_cast<size_t>(size > 0 ? size : 0)};
}
bool is_journal(int fd) { return path_of(fd).find("journal.tcj") != std::string::npos; }

Tracked* track(int fd) {
  struct stat facts;
  if (fstat(fd, &facts) != 0) return nullptr;
  for (int i = 0; i < tracked_count; ++i)
    if (tracked[i].inode == facts.st_ino) return &tracked[i];
  if (tracked_count == 256) return nullptr;
  const int own = open(("/proc/self/fd/" + std::to_string(fd)).c_str(), O_WRONLY | O_CLOEXEC);
  tracked[tracked_count] = {facts.st_ino, facts.st_size, own};
  return &tracked[tracked_count++];
}

// 'k' or 'p' where the folder is copied at this call, else 0.
char copied_as() {
  static const char* text = getenv("TURNCAL_FAULT_COPIES");
  const std::string call = " " + std::to_string(calls);
  for (const char* at = text ? strstr(text, call.c_str()) : nullptr; at; at = strstr(at + 1, call.c_str()))
    if (at[call.size()] == 'k' || at[call.size()] == 'p') return at[call.size()];
  return 0;
}

void copy(bool power) {
  const std::string folder = getenv("TURNCAL_FAULT_FOLDER"), to = folder + "." + std::to_string(calls);
  const char* const words[] = {
      "sh",           "-c",       "[ ! -e \"$0\" ] || { cp -a \"$0\" \"$1\" && cp /proc/self/fd/1 \"$1/said\"; }",
      folder.c_str(), to.c_str(), nullptr};
  char* const none[] = {nullptr};
  pid_t child = 0;
  int status = 0;
  if (posix_spawn(&child, "/bin/sh", nullptr, nullptr, const_cast<char* const*>(words), none) != 0 ||
      waitpid(child, &status, 0) != child || status != 0)
    abort();
  for (int i = 0; power && i < tracked_count; ++i) {
    const std::string path = path_of(tracked[i].fd);
    struct stat facts;
    if (fstat(tracked[i].fd, &facts) != 0 || facts.st_size <= tracked[i].synced || path.rfind(folder + "/", 0) != 0)
      continue;
    const std::string copied = to + path.substr(folder.size());
    if (truncate(copied.c_str(), tracked[i].synced) != 0 && errno != ENOENT) abort();  // deleted: in no copy
  }
}

// Where the folder is copied the program goes on.
void strike() {
  if (const char how = copied_as()) return copy(how == 'p');
  for (int i = 0; mode_is("power") && i < tracked_count; ++i) {
    struct stat facts;
    if (fstat(tracked[i].fd, &facts) == 0 && facts.st_size > tracked[i].synced)
      real<int (*)(int, off_t)>("ftruncate")(tracked[i].fd, tracked[i].synced);
  }
  kill(getpid(), SIGKILL);
}

// Returns whether this call is struck. A disk that is full stays full.
bool struck(int fd) {
  if (!is_file(fd)) return false;
  track(fd);
  ++calls;
  if (mode_is("full")) return point() > 0 && calls >= point();
  return calls == point() || copied_as();
}

ssize_t write_struck(int fd, const void* data, size_t size) {
  if (mode_is("full")) {
    errno = ENOSPC;
    return -1;
  }
  const auto write_it = real<ssize_t (*)(int, const void*, size_t)>("write");
  const size_t half = copied_as() == 'k' || mode_is("kill") ? size / 2 : 0;
  if (write_it(fd, data, half) != static_cast<ssize_t>(half)) abort();
  strike();
  return static_cast<ssize_t>(half) + write_it(fd, static_cast<const char*>(data) + half, size - half);
}

void synced(int fd) {
  struct stat facts;
  Tracked* file = is_file(fd) ? track(fd) : nullptr;
  if (file && fstat(fd, &facts) == 0) file->synced = facts.st_size;
}

__attribute__((destructor)) void report() {
  const char* path = getenv("TURNCAL_FAULT_COUNT");
  if (!path) return;
  FILE* file = fopen(path, "w");
  if (!file) return;
  fprintf(file, "%ld %ld\n", calls, unsynced + (journal_fd >= 0 ? 1 : 0));
  fclose(file);
}

}  // namespace

// Whether a write, or a sync, fails meanwhile, with errno; one that hangs does not return before.
bool withheld(int fd, bool is_sync) {
  if (holds_s() == 0.0 || !is_file(fd)) return false;
  if (mode_is(is_sync ? "hang_sync" : "hang_write")) hang();
  errno = mode_is("fail") ? EIO : ENOSPC;
  return mode_is("fail") || (mode_is("full_for") && !is_sync);
}

extern "C" {

int clock_gettime(clockid_t clock, timespec* now) {
  const int result = int(syscall(SYS_clock_gettime, clock, now));
  static const bool steps = mode_is("clock");
  if (result == 0 && clock == CLOCK_REALTIME && steps && holds_s() > 0.0)
    now->tv_sec += static_cast<time_t>(number("TURNCAL_FAULT_STEP_S"));
  static const auto stands_s = static_cast<time_t>(number("TURNCAL_FAULT_NOW_S"));
  if (result == 0 && clock == CLOCK_REALTIME && stands_s > 0) *now = {stands_s, 0};
  return result;
}
int gettimeofday(timeval* now, void*) {
  timespec fine{};
  const int result = clock_gettime(CLOCK_REALTIME, &fine);
  *now = {fine.tv_sec, fine.tv_nsec / 1000};
  return result;
}
time_t time(time_t* now) {
  timespec fine{};
  clock_gettime(CLOCK_REALTIME, &fine);
  if (now) *now = fine.tv_sec;
  return fine.tv_sec;
}
ssize_t write(int fd, const void* data, size_t size) {
  if (withheld(fd, false)) return -1;
  if (is_file(fd)) {
    if (journal_fd >= 0) ++unsynced;
    if (is_journal(fd)) journal_fd = fd;
  }
  if (struck(fd)) return write_struck(fd, data, size);
  return real<ssize_t (*)(int, const void*, size_t)>("write")(fd, data, size);
}
ssize_t pwrite64(int fd, const void* data, size_t size, off64_t offset) {
  if (withheld(fd, false)) return -1;
  if (struck(fd)) {
    if (mode_is("full")) {
      errno = ENOSPC;
      return -1;
    }
    strike();
  }
  return real<ssize_t (*)(int, const void*, size_t, off64_t)>("pwrite64")(fd, data, size, offset);
}
int fsync(int fd) {
  if (withheld(fd, true)) return -1;
  if (!mode_is("full") && struck(fd)) strike();
  const int result = real<int (*)(int)>("fsync")(fd);
  if (fd == journal_fd) journal_fd = -1;
  synced(fd);
  return result;
}
int fdatasync(int fd) {
  if (withheld(fd, true)) return -1;
  if (!mode_is("full") && struck(fd)) strike();
  const int result = real<int (*)(int)>("fdatasync")(fd);
  synced(fd);
  return result;
}
int ftruncate(int fd, off_t size) {
  if (!mode_is("full") && struck(fd)) strike();
  return real<int (*)(int, off_t)>("ftruncate")(fd, size);
}
int rename(const char* from, const char* to) {
  ++calls;
  if (!mode_is("full") && (calls == point() || copied_as())) strike();
  const int result = real<int (*)(const char*, const char*)>("rename")(from, to);
  const char* last = getenv("TURNCAL_FAULT_RENAMED");
  if (last && strstr(to, last)) kill(getpid(), SIGKILL);
  return result;
}

}  // extern "C"
