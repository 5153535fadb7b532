// How a request to stop cuts a wait for a device short: the station counts requests (from a signal handler), a driver looks at the
// count while it waits, gives the wait up, and is back in the station's loop within milliseconds. Sending the stop handles it.
// The same waits let the station look at what else goes on meanwhile (Turntable::set_meanwhile).
#pragma once

#include <poll.h>

#include <algorithm>
#include <atomic>
#include <functional>

#include "imu_io/base/clock.h"

namespace turncal {

class StopSignal {
 public:
  StopSignal() = default;  // never asked
  explicit StopSignal(const std::atomic<int>* requests)
      : requests_(requests), handled_(requests ? requests->load() : 0) {}
  bool pending() const { return requests_ != nullptr && requests_->load() != handled_; }
  void handled() {
    if (requests_ != nullptr) handled_ = requests_->load();
  }
  void set_meanwhile(std::function<void()> meanwhile) { meanwhile_ = std::move(meanwhile); }
  // Once in every turn of a wait.
  void look_away() const {
    if (meanwhile_) meanwhile_();
  }
  // For waits elsewhere: to be asked in every turn of one.
  std::function<bool()> giving_up() const {
    return [this] {
      look_away();
      return pending();
    };
  }
  // Waits so long, rounded up to milliseconds. False: given up for a stop.
  bool pause(double seconds) const {
    for (const Deadline deadline(seconds); !deadline.passed();) {
      if (pending()) return false;
      look_away();
      ::poll(nullptr, 0, std::min(deadline.left_ms(), longest_look_away_ms));
    }
    return !pending();
  }

  static constexpr int longest_look_away_ms = 10;

 private:
  const std::atomic<int>* requests_ = nullptr;
  int handled_ = 0;
  std::function<void()> meanwhile_;
};

}  // namespace turncal
