// For a run under systemd (or whoever set NOTIFY_SOCKET): says where it is (`systemctl status`), and is watched while the table may move.
//
// The protocol is sd_notify(3): datagrams of `KEY=value` lines to the socket that the variable names. As long as the run's loop goes on it
// says so every second; a loop that is stuck for watch_s is ended by systemd (docs/package.md). Nothing is watched while the table
// rests with its drives off: an estimate may take minutes. Without the variable this does nothing; what cannot be sent is not sent again.
#pragma once

#include <cmath>
#include <functional>
#include <optional>
#include <string>

#include "imu_io/base/posix_file.h"
#include "orchestrator/run/run_observer.h"

namespace turncal {

class ServiceWatch : public RunObserver {
 public:
  static constexpr int watch_s = 30;

  ServiceWatch();
  ~ServiceWatch() override { disarm(); }
  ServiceWatch(const ServiceWatch&) = delete;
  ServiceWatch& operator=(const ServiceWatch&) = delete;
  void on_transition(const TransitionRecord& record) override;
  void on_progress(const RunSnapshot& snapshot) override;

 private:
  void tell(const std::string& what) const;
  void disarm();
  Descriptor socket_;
  bool armed_ = false;
  double last_ping_s_ = -1e9;
};

// Notices that the civil clock was set while a run goes on: it should advance with the monotonic one, which all deadlines are measured on.
//
// A slow correction (NTP slews by 0.05 % at most) is no step. A machine that was suspended is one: its monotonic clock stood still.
class ClockWatch : public RunObserver {
 public:
  static constexpr double step_s = 1.0;

  // speed_up: station seconds a second of the civil clock. `on_step`: by how much it was set, + forward, and the snapshot after that.
  ClockWatch(double speed_up, std::function<void(double by_s, const RunSnapshot& at)> on_step)
      : speed_up_(speed_up), on_step_(std::move(on_step)) {}
  void on_progress(const RunSnapshot& at) override {
    const double offset_s = at.utc_s - at.time_s / speed_up_;
    if (offset_s_ && std::abs(offset_s - *offset_s_) >= step_s) on_step_(offset_s - *offset_s_, at);
    offset_s_ = offset_s;
  }

 private:
  double speed_up_;
  std::function<void(double, const RunSnapshot&)> on_step_;
  std::optional<double> offset_s_;
};

}  // namespace turncal
