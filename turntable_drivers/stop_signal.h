// How a request to stop cuts a wait for a device short: the station counts requests (from a signal handler), a driver looks at the
// count while it waits, gives the wait up, and is back in the station's loop within milliseconds. Sending the stop handles it.
#pragma once

#include <atomic>

namespace turncal {

class StopSignal {
 public:
  StopSignal() = default;  // never asked
  explicit StopSignal(const std::atomic<int>* requests) : requests_(requests), handled_(requests ? requests->load() : 0) {}
  bool pending() const { return requests_ != nullptr && requests_->load() != handled_; }
  void handled() {
    if (requests_ != nullptr) handled_ = requests_->load();
  }

 private:
  const std::atomic<int>* requests_ = nullptr;
  int handled_ = 0;
};

}  // namespace turncal
