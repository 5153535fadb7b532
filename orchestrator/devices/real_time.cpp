#include "orchestrator/devices/real_time.h"

#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace turncal {
namespace {

int go_first() {
  sched_param lowest{};
  lowest.sched_priority = ::sched_get_priority_min(SCHED_FIFO);
  return ::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &lowest) == 0 ? 0 : errno;
}

// With a limit, what is allocated later could fail: then nothing is locked.
int lock_memory() {
  rlimit limit{};
  ::getrlimit(RLIMIT_MEMLOCK, &limit);
  if (limit.rlim_cur != RLIM_INFINITY && ::geteuid() != 0) return EPERM;
  return ::mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0 ? 0 : errno;
}

}  // namespace

RealTime::RealTime() : scheduled_(go_first()), locked_(lock_memory()) {}

RealTime::~RealTime() {
  const sched_param none{};
  if (first()) ::sched_setscheduler(0, SCHED_OTHER, &none);
  if (locked()) ::munlockall();
}

std::string RealTime::text() const {
  std::string text =
      first() ? "a run goes before other programs (SCHED_FIFO)"
              : "a run does not go before other programs (SCHED_FIFO: " + std::string(std::strerror(scheduled_)) +
                    "; limits.conf: rtprio 1)";
  text += locked() ? ", its memory is locked"
                   : ", its memory is not locked (mlockall: " + std::string(std::strerror(locked_)) +
                         "; limits.conf: memlock unlimited)";
  return text;
}

}  // namespace turncal
