// Lets the thread that holds a table go before all others, where the system allows it: a busy PC must not hold up a stop.
//
// SCHED_FIFO at its lowest priority, for the calling thread alone (threads that it starts are ordinary ones), and the memory of the process
// kept from being swapped out (mlockall). What is not allowed is left out: a run is safe by its deadlines without it, and `turncal check`
// says what there is. Whoever is no root gets both by limits.conf (docs/safety.md).
#pragma once

#include <string>

namespace turncal {

class RealTime {
 public:
  RealTime();
  ~RealTime();  // as it was, in the same thread
  RealTime(const RealTime&) = delete;
  RealTime& operator=(const RealTime&) = delete;
  // "goes before other programs (SCHED_FIFO), memory locked": in one line what there is, and what to do for what there is not.
  std::string text() const;

 private:
  bool first() const { return scheduled_ == 0; }
  bool locked() const { return locked_ == 0; }
  int scheduled_, locked_;  // 0, or errno
};

}  // namespace turncal
