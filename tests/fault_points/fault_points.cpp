// For tests only, loaded by LD_PRELOAD in front of the C library: counts every write, sync, truncation and rename of files and
// strikes at one of them. The program itself knows nothing of it.
//
//   TURNCAL_FAULT_POINT=n   the n-th call, from 1; 0: only count
//   TURNCAL_FAULT_MODE=kill   a write is done by half, then SIGKILL
//                      power  every file loses what it was not synced for, then SIGKILL (renames stay: not modelled)
//                      full   from here on every write fails with ENOSPC
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
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>

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
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
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
    const timespec pause{
        left_s > 1e6 ? 1000000 : static_cast<time_t>(left_s),
        static_cast<long>(1e9 * (left_s > 1e6 ? 0.0 : left_s - static_cast<double>(static_cast<time_t>(left_s))))};
    nanosleep(&pause, nullptr);
  }
}
bool is_file(int fd) {
  struct stat facts;
  return fd > 2 && fstat(fd, &facts) == 0 && S_ISREG(facts.st_mode);
}

bool is_journal(int fd) {
  char name[64], path[512] = {};
  snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
  return readlink(name, path, sizeof path - 1) > 0 && strstr(path, "journal.tcj") != nullptr;
}

Tracked* track(int fd) {
  struct stat facts;
  if (fstat(fd, &facts) != 0) return nullptr;
  for (int i = 0; i < tracked_count; ++i) {
    if (tracked[i].inode == facts.st_ino) return &tracked[i];
  }
  if (tracked_count == 256) return nullptr;
  char name[64];
  snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
  const int own = open(name, O_WRONLY | O_CLOEXEC);
  tracked[tracked_count] = {facts.st_ino, facts.st_size, own};
  return &tracked[tracked_count++];
}

void strike() {
  if (mode_is("power")) {
    for (int i = 0; i < tracked_count; ++i) {
      struct stat facts;
      if (fstat(tracked[i].fd, &facts) == 0 && facts.st_size > tracked[i].synced)
        real<int (*)(int, off_t)>("ftruncate")(tracked[i].fd, tracked[i].synced);
    }
  }
  kill(getpid(), SIGKILL);
}

// Returns whether this call is struck. A disk that is full stays full.
bool struck(int fd) {
  if (!is_file(fd)) return false;
  track(fd);
  ++calls;
  if (mode_is("full")) return point() > 0 && calls >= point();
  return calls == point();
}

ssize_t write_struck(int fd, const void* data, size_t size) {
  if (mode_is("full")) {
    errno = ENOSPC;
    return -1;
  }
  if (mode_is("kill")) real<ssize_t (*)(int, const void*, size_t)>("write")(fd, data, size / 2);
  strike();
  return -1;
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
  const int result = static_cast<int>(syscall(SYS_clock_gettime, clock, now));
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
  if (!mode_is("full") && calls == point()) strike();
  return real<int (*)(const char*, const char*)>("rename")(from, to);
}

}  // extern "C"
