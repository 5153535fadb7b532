// Notices that the civil clock was set while a run goes on: it should advance with the monotonic one, which all deadlines are measured on.
//
// A slow correction (NTP slews by 0.05 % at most) is no step. A machine that was suspended is one: its monotonic clock stood still.
#pragma once

#include <cmath>
#include <functional>
#include <optional>

#include "orchestrator/run/run_observer.h"

namespace turncal {

class ClockWatch : public RunObserver {
 public:
  static constexpr double step_s = 1.0;

  // speed_up: station seconds a second of the civil clock. `on_step`: by how much it was set, + forward, and the snapshot after that.
  ClockWatch(double speed_up, std::function<void(double by_s, const RunSnapshot& at)> on_step)
      : speed_up_(speed_up), on_step_(std::move(on_step)) {}
  void on_transition(const TransitionRecord&) override {}
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
