// From the first object to the end of the program no catchable signal ends or stops the program without the table being left properly,
// nor cuts short what is then left to be written and printed:
//
//   SIGINT                                                                 a request
//   SIGTERM, SIGHUP; SIGQUIT, USR1, USR2, ALRM, VTALRM, PROF, PWR, IO, XCPU   a request to end
//   SIGPIPE, SIGXFSZ          ignored: a failing write reports it (a reader that went away, a file size limit)
//   SIGTSTP, SIGTTIN, SIGTTOU  ignored: a stopped process cannot watch a table that turns
//
// There are three counts, because a pause must not cut a driver's waits short, and an operator did not abort a run that the system ended:
//   pauses()    1 once the first request was a SIGINT, for a run that asked for that (FirstInterrupt::pauses)
//   requests()  every other request: stop now, each further one faster
//   ends()      those of requests() from the first on that was not SIGINT
// They outlive the object and hold for the next one: a program that was asked to stop begins nothing more.
// While an object lives, a reader that does not read the output cannot block the program (Unhindered).
#pragma once

#include <array>
#include <atomic>
#include <csignal>
#include <utility>

#include "imu_io/base/console.h"

namespace turncal {

enum class FirstInterrupt { stops, pauses };

class StopSignals {
 public:
  explicit StopSignals(FirstInterrupt first = FirstInterrupt::stops) {
    may_pause_ = first == FirstInterrupt::pauses;
    if (std::exchange(taken_, true)) return;
    for (std::size_t i = 0; i < signals.size(); ++i) {
      struct sigaction action {};
      action.sa_handler = i < request_count ? &StopSignals::on_signal : SIG_IGN;
      // Blocks the others meanwhile, so that the first signal is handled first.
      for (const int other : signals) sigaddset(&action.sa_mask, other);
      sigaction(signals[i], &action, nullptr);
    }
  }
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  static const std::atomic<int>& requests() { return requests_; }
  static const std::atomic<int>& pauses() { return pauses_; }
  static const std::atomic<int>& ends() { return ends_; }
  static bool any() { return requests_ + pauses_ > 0; }
  // For a process that runs several command lines: forgets the requests before the next.
  static void forget() { requests_ = pauses_ = ends_ = 0; }

 private:
  static void on_signal(int signal) {
    if (signal == SIGINT && may_pause_.exchange(0) != 0) {
      ++pauses_;
      return;
    }
    may_pause_ = 0;
    if (signal != SIGINT || ends_ > 0) ++ends_;  // counted before the request that it explains
    ++requests_;
  }

  static constexpr std::size_t request_count = 12;  // the others are ignored
  static constexpr std::array<int, 17> signals = {SIGINT,  SIGTERM,   SIGHUP,  SIGQUIT, SIGUSR1, SIGUSR2,
                                                  SIGALRM, SIGVTALRM, SIGPROF, SIGPWR,  SIGIO,   SIGXCPU,
                                                  SIGPIPE, SIGXFSZ,   SIGTSTP, SIGTTIN, SIGTTOU};
  static inline std::atomic<int> requests_{0}, pauses_{0}, ends_{0}, may_pause_{0};
  static_assert(std::atomic<int>::is_always_lock_free);
  static inline bool taken_ = false;
  Unhindered printing_;
};

}  // namespace turncal
