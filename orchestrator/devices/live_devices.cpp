#include "orchestrator/devices/live_devices.h"

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdio>

#include "imu_io/base/clock.h"
#include "orchestrator/devices/stop_signals.h"

namespace turncal {

namespace {

constexpr double first_turn_s = 60.0;  // until a person has shown how long one takes

}  // namespace

LiveClock::LiveClock(double speed_up) : speed_up_(speed_up), start_s_(monotonic_s()) {}

double LiveClock::now_s() const { return speed_up_ * (monotonic_s() - start_s_); }

double LiveClock::utc_s() const {
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

LiveDevices::LiveDevices(const StationConfig& station, std::size_t units, StationLock lock)
    : lock_(std::move(lock)),
      speed_up_(station.clock_speed_up),
      clock_(speed_up_),
      imu_(station.imu->frame, station.imu->settings),
      watched_(imu_, station.imu->frame.sample_period_s) {
  for (std::size_t place = 1; place < units; ++place) {
    further_.push_back(std::make_unique<SerialImu>(station.imu->frame, station.imu_settings(place)));
  }
}

Result<std::unique_ptr<LiveDevices>> LiveDevices::make(const StationConfig& station,
                                                       const std::atomic<int>& stop_requests, std::ostream& out,
                                                       std::size_t units) {
  assert(station.imu);
  StationLock lock = TRY(StationLock::acquire(station));
  std::unique_ptr<LiveDevices> live(new LiveDevices(station, units, std::move(lock)));
  const GravityWatch& watched = live->watched_;
  Result<std::unique_ptr<TableDevice>> table =
      make_table(station, {live->clock_, &stop_requests, STDIN_FILENO, &out, [&watched] { return watched.mean(); }});
  if (!table) return table.error();
  live->table_ = std::move(*table);
  if (ManualTurntable* manual = live->table_->manual()) manual->feel_turns([&watched] { return watched.turned_deg(); });
  return live;
}

StationDevices LiveDevices::devices() {
  return {table_->table(), watched_, clock_, [this](double seconds) { wait_a_little(seconds / speed_up_); }};
}

void LiveDevices::wait_a_little(double wall_s) {
  constexpr double longest_s = 0.02;
  timespec pause{};
  pause.tv_nsec = static_cast<long>(1e9 * std::clamp(wall_s, 0.0, longest_s));
  ::nanosleep(&pause, nullptr);
}

Status LiveDevices::leave_table(Status done, const std::string& how_left) {
  // A driver that gives a wait up for a stop has words of its own.
  if (!done && (done.error().kind == ErrorKind::aborted || done.error().kind == ErrorKind::interrupted)) {
    done = asked_to_stop(StopSignals::ends() > 0);
  }
  const Status left = table_->leave();
  left_off_ = left.ok();
  if (!left) return device_error(done ? left.error().message : done.error().message + "; " + left.error().message);
  return done ? done : Status(Error{done.error().kind, done.error().message + how_left});
}

std::string LiveDevices::sag_since(const std::optional<TableStatus>& left) {
  constexpr double least_s = 2.5, same_place_deg = 0.01;  // 0.005 deg/s
  constexpr int readings = 5;  // an encoder that flickers reads the same place in one of them
  std::string text;
  if (table_->manual() || !table_->table().can_switch_off()) return text;
  for (const Axis axis : all_axes) {
    const Result<AxisStatus> then = left ? (*left)[index(axis)] : table_->table().status(axis);
    if (!then) return text;
    while (clock_.now_s() - then->time_s < least_s)
      wait_a_little((least_s - (clock_.now_s() - then->time_s)) / speed_up_);
    std::optional<AxisStatus> nearest;
    for (int i = 0; i < readings; ++i) {
      const Result<AxisStatus> now = table_->table().status(axis);
      if (!now) return text;
      const auto off_deg = [&](const AxisStatus& at) { return std::abs(at.position_deg - then->position_deg); };
      if (!nearest || off_deg(*now) < off_deg(*nearest)) nearest = *now;
      if (off_deg(*nearest) <= same_place_deg) break;
    }
    if (!(std::abs(nearest->position_deg - then->position_deg) > same_place_deg)) continue;
    char line[160];
    std::snprintf(line, sizeof line, "%s%s turns with its drive off: from %.4f to %.4f deg in %.1f s",
                  text.empty() ? "" : "; ", to_string(axis), then->position_deg, nearest->position_deg,
                  nearest->time_s - then->time_s);
    text += line;
  }
  return text;
}

OperatorPrompts* LiveDevices::prompts() {
  ManualTurntable* manual = table_->manual();
  if (!manual) return nullptr;
  prompts_ = std::make_unique<OperatorPrompts>(*manual, first_turn_s);
  return prompts_.get();
}

}  // namespace turncal
