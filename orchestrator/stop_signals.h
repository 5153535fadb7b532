// While this object lives, SIGINT, SIGTERM and SIGHUP ask the run to stop, and a reader of our output that goes away does not
// end the program: whatever happens to the terminal, the table is never left moving.
#pragma once

#include <array>
#include <atomic>
#include <csignal>

namespace turncal {

class StopSignals {
 public:
  StopSignals() {
    requests_ = 0;
    for (std::size_t i = 0; i < signals.size(); ++i) {
      struct sigaction action {};
      action.sa_handler = signals[i] == SIGPIPE ? SIG_IGN : [](int) { requests_.fetch_add(1); };
      sigaction(signals[i], &action, &old_[i]);
    }
  }
  ~StopSignals() {
    for (std::size_t i = 0; i < signals.size(); ++i) sigaction(signals[i], &old_[i], nullptr);
  }
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  static const std::atomic<int>& requests() { return requests_; }

 private:
  static constexpr std::array<int, 4> signals = {SIGINT, SIGTERM, SIGHUP, SIGPIPE};
  static inline std::atomic<int> requests_{0};
  static_assert(std::atomic<int>::is_always_lock_free);
  std::array<struct sigaction, 4> old_{};
};

}  // namespace turncal
