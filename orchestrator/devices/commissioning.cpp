#include "orchestrator/devices/commissioning.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <vector>

#include "turntable_drivers/table/table_stop.h"

namespace turncal {

namespace {

constexpr double homing_deadline_s = 300.0;
constexpr double arcsec_rad = std::numbers::pi / 648000.0;
constexpr const char* body_axis[3] = {"x", "y", "z"};

struct Felt {
  int axis;
  int sign;
};
Felt felt(Axis axis) {
  switch (axis) {
    case Axis::heading: return {1, -1};
    case Axis::pitch: return {2, 1};
    case Axis::roll: return {0, 1};
  }
  return {0, 1};
}

class Trial {
 public:
  Trial(const StationDevices& devices, const StationConfig& station, const CommissioningSettings& settings,
        const std::atomic<int>& stop_requests)
      : devices_(devices), station_(station), settings_(settings), stop_requests_(stop_requests), buffer_(256) {}

  Status home() {
    if (Status status = devices_.table.enable(); !status) return status;
    if (Status status = devices_.table.home(); !status) return status;
    return wait_until(homing_deadline_s, "the axes did not find their zero", [](const TableStatus& axes) {
      return all_of(axes, [](const AxisStatus& a) { return a.homed && !a.moving; });
    });
  }
  // The gyros' sum over the move, less the mean before it.
  Result<std::array<double, 3>> turn(Axis axis) {
    if (Status status = read_for(settings_.rest_s); !status) return status.error();
    restart();
    if (Status status = read_for(settings_.rest_s); !status) return status.error();
    const std::array<double, 3> rest = sum_;
    const auto rest_samples = static_cast<double>(samples_);
    if (samples_ == 0) return device_error("no samples from the unit");
    restart();
    if (Status status = move(axis, settings_.move_deg); !status) return status.error();
    if (Status status = read_for(settings_.rest_s); !status) return status.error();
    if (lost_) return device_error(std::string("samples of the unit were lost while ") + to_string(axis) + " turned");
    std::array<double, 3> turned = sum_;
    for (std::size_t i = 0; i < 3; ++i) turned[i] -= rest[i] / rest_samples * static_cast<double>(samples_);
    if (Status status = move(axis, 0.0); !status) return status.error();
    return turned;
  }
  // Stops every axis, drives off, and sees that it is so.
  Status stop() {
    return leave_off(devices_.table, {.now_s = [this] { return devices_.clock.now_s(); },
                                      .wait = devices_.wait,
                                      .brake_s = station_.motion.deadline_margin_s,
                                      .deadline_s = 2.0 * station_.motion.deadline_margin_s,
                                      .poll_s = station_.motion.poll_moving_s,
                                      .rest_rate_degps = station_.motion.settle_rate_degps});
  }

 private:
  template <class Condition>
  static bool all_of(const TableStatus& axes, Condition condition) {
    return std::all_of(axes.begin(), axes.end(), condition);
  }
  void restart() {
    sum_ = {};
    samples_ = 0;
    lost_ = false;
  }
  Result<TableStatus> read_table() {
    TableStatus axes;
    for (const Axis axis : all_axes) {
      Result<AxisStatus> status = devices_.table.status(axis);
      if (!status) return status.error();
      axes[static_cast<std::size_t>(axis)] = std::move(*status);
    }
    return axes;
  }
  Status read_for(double seconds) {
    const double end_s = devices_.clock.now_s() + seconds;
    while (devices_.clock.now_s() < end_s) {
      if (stop_requests_.load() > 0) return Error{ErrorKind::aborted, "stopped by the operator"};
      const Result<std::size_t> got = devices_.imu.read(buffer_, std::min(seconds, station_.motion.poll_moving_s));
      if (!got) return got.error();
      for (const ImuSample& sample : std::span(buffer_).first(*got)) {
        lost_ = lost_ || (last_counter_ && sample.counter != *last_counter_ + 1);
        last_counter_ = sample.counter;
        ++samples_;
        for (std::size_t i = 0; i < 3; ++i) sum_[i] += sample.gyro[i];
      }
    }
    return {};
  }
  Status wait_until(double seconds, const std::string& late, const std::function<bool(const TableStatus&)>& over) {
    const double deadline_s = devices_.clock.now_s() + seconds;
    for (;;) {
      const Result<TableStatus> axes = read_table();
      if (!axes) return axes.error();
      for (const Axis axis : all_axes) {
        const AxisStatus& a = (*axes)[static_cast<std::size_t>(axis)];
        if (!a.fault && !a.limit && !a.emergency_stop && a.remote) continue;
        return device_error(std::string(to_string(axis)) + ": " +
                            (a.emergency_stop ? "emergency stop"
                             : a.fault        ? "fault"
                             : a.limit        ? "limit switch"
                                              : "not in remote mode") +
                            (a.text.empty() ? "" : ": " + a.text));
      }
      if (over(*axes)) return {};
      if (devices_.clock.now_s() > deadline_s) return device_error(late);
      if (Status status = read_for(station_.motion.poll_moving_s); !status) return status;
    }
  }
  Status move(Axis axis, double to_deg) {
    if (Status status = devices_.table.move_absolute(axis, to_deg, settings_.rate_degps, settings_.acceleration_degps2);
        !status) {
      return status;
    }
    const double seconds = settings_.move_deg / settings_.rate_degps +
                           2.0 * settings_.rate_degps / settings_.acceleration_degps2 +
                           station_.motion.deadline_margin_s;
    return wait_until(seconds, std::string(to_string(axis)) + " did not arrive in time", [&](const TableStatus& axes) {
      const AxisStatus& a = axes[static_cast<std::size_t>(axis)];
      return !a.moving && a.in_position && std::abs(a.position_deg - to_deg) <= station_.motion.position_tolerance_deg;
    });
  }

  const StationDevices& devices_;
  const StationConfig& station_;
  const CommissioningSettings& settings_;
  const std::atomic<int>& stop_requests_;
  std::vector<ImuSample> buffer_;
  std::array<double, 3> sum_{};
  std::int64_t samples_ = 0;
  bool lost_ = false;
  std::optional<std::int64_t> last_counter_;
};

double to_rad(IncrementKind kind, const CommissioningSettings& settings) {
  if (kind != IncrementKind::pulses) return 1.0;
  return settings.gyro_pulse_arcsec * arcsec_rad;  // 0: not known
}

}  // namespace

Status judge_turn(Axis axis, const std::array<double, 3>& sum, IncrementKind kind,
                  const CommissioningSettings& settings) {
  const Felt expected = felt(axis);
  const double size = std::hypot(sum[0], sum[1], sum[2]);
  const double weight = to_rad(kind, settings);
  const double along = expected.sign * sum[static_cast<std::size_t>(expected.axis)];
  const bool points_there = size > 0.0 && along >= size * std::cos(settings.direction_deg * std::numbers::pi / 180.0);
  const double turned_deg = size * weight * 180.0 / std::numbers::pi;
  const bool size_known = weight > 0.0;
  const bool size_fits =
      !size_known || std::abs(turned_deg - settings.move_deg) <= settings.size_tolerance * settings.move_deg;
  if (points_there && size_fits) return {};
  char text[320];
  const double shown = size_known ? weight * 180.0 / std::numbers::pi : 1.0;
  std::snprintf(text, sizeof text,
                "%s turned by %+g deg was felt as %+.3f, %+.3f, %+.3f %s about x, y, z: expected %s about %s alone "
                "(sign of the table's axis, "
                "or axes and signs of the unit's frame)",
                to_string(axis), settings.move_deg, sum[0] * shown, sum[1] * shown, sum[2] * shown,
                size_known ? "deg" : "pulses",
                size_known ? (std::to_string(expected.sign * settings.move_deg) + " deg").c_str()
                           : (expected.sign > 0 ? "plus" : "minus"),
                body_axis[expected.axis]);
  return input_error(text);
}

Status try_axes(const StationDevices& devices, const StationConfig& station, const CommissioningSettings& settings,
                const std::atomic<int>& stop_requests, const std::string& tag, std::ostream& out) {
  RecordingInfo info;
  devices.imu.describe(info);
  Trial trial(devices, station, settings, stop_requests);
  Status tried = trial.home();
  for (const Axis axis : all_axes) {
    if (!tried) break;
    const Result<std::array<double, 3>> turned = trial.turn(axis);
    tried = turned ? judge_turn(axis, *turned, info.gyro_increment, settings) : Status(turned.error());
    if (!tried) break;
    const double size = std::hypot((*turned)[0], (*turned)[1], (*turned)[2]);
    char text[160];
    std::snprintf(text, sizeof text, "%-7s %+g deg: felt about %s%s, %.6g %s", to_string(axis), settings.move_deg,
                  felt(axis).sign > 0 ? "+" : "-", body_axis[felt(axis).axis],
                  info.gyro_increment == IncrementKind::pulses ? settings.move_deg * 3600.0 / size
                                                               : size * 180.0 / std::numbers::pi,
                  info.gyro_increment == IncrementKind::pulses ? "arcsec a pulse" : "deg");
    out << tag << text << std::endl;
  }
  const Status stopped = trial.stop();
  if (!stopped) return tried ? stopped : Status(device_error(tried.error().message + "; " + stopped.error().message));
  return tried;
}

}  // namespace turncal
