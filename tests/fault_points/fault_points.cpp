// For tests only, loaded by LD_PRELOAD in front of the C library: counts every write, sync, truncation and rename of files and
// strikes at one of them. The program itself knows nothing of it.
//
//   TURNCAL_FAULT_POINT=n   the n-th call, from 1; 0: only count
//   TURNCAL_FAULT_MODE=kill   a write is done by half, then SIGKILL
//                      power  every file loses what it was not synced for, then SIGKILL (renames stay: not modelled)
//                      full   from here on every write fails with ENOSPC
//   TURNCAL_FAULT_COUNT=FILE  written at the end: the number of calls, and how often something was written to any file, or the
//                             program ended, while a record of a journal was not yet synced
#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
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
      if (fstat(tracked[i].fd, &facts) == 0 && facts.st_size > tracked[i].synced) {
        real<int (*)(int, off_t)>("ftruncate")(tracked[i].fd, tracked[i].synced);
      }
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

extern "C" {

ssize_t write(int fd, const void* data, size_t size) {
  if (is_file(fd)) {
    if (journal_fd >= 0) ++unsynced;
    if (is_journal(fd)) journal_fd = fd;
  }
  if (struck(fd)) return write_struck(fd, data, size);
  return real<ssize_t (*)(int, const void*, size_t)>("write")(fd, data, size);
}
ssize_t pwrite64(int fd, const void* data, size_t size, off64_t offset) {
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
  if (!mode_is("full") && struck(fd)) strike();
  const int result = real<int (*)(int)>("fsync")(fd);
  if (fd == journal_fd) journal_fd = -1;
  synced(fd);
  return result;
}
int fdatasync(int fd) {
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
