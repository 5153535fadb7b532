#include "turntable_drivers/rig/rig_devices.h"

#include <algorithm>
#include <cmath>

#include "imu_io/base/text.h"

namespace turncal {

namespace {

Error table_error(const std::string& what) { return device_error("simulated table: " + what); }

Error axis_error(Axis axis, const std::string& what) { return table_error(std::string(to_string(axis)) + ": " + what); }

}  // namespace

Status RigTable::reachable() {
  before_();
  if (rig_.link_lost()) {
    connected_ = false;
    return table_error("link lost");
  }
  if (!connected_) return table_error("not connected");
  update();
  return {};
}

void RigTable::update() {
  const bool emergency_stop = rig_.emergency_stop();
  for (Axis axis : all_axes) {
    const std::size_t i = index(axis);
    const Rig::AxisState state = rig_.axis(axis);
    if (emergency_stop || state.fault) {
      enabled_[i] = false;
      homing_[i] = false;
    }
    const bool at_zero = std::abs(state.position_deg) <= rig_.config().table.in_position_tolerance_deg;
    if (homing_[i] && !state.moving && at_zero && rig_.time_s() >= homing_ends_s_) {
      homing_[i] = false;
      homed_[i] = true;
    }
    homed_[i] = homed_[i] || rig_.config().table.absolute_encoder;
  }
}

Status RigTable::ready(Axis axis) {
  TRY(reachable());
  if (rig_.emergency_stop()) return table_error("emergency stop is latched: expected it released and cleared");
  if (rig_.axis(axis).fault) return axis_error(axis, "drive fault is latched: expected it cleared");
  if (!enabled_[index(axis)]) return axis_error(axis, "not enabled");
  return {};
}

Status RigTable::connect() {
  before_();
  if (rig_.link_lost()) return table_error("link lost");
  connected_ = true;
  enabled_ = {};  // after a new connection the table is not enabled; a motion in progress continues
  homing_ = {};
  update();
  return {};
}

Result<TableIdentity> RigTable::identify() {
  TRY(reachable());
  return TableIdentity{"simulated three-axis table, seed " + std::to_string(rig_.config().seed), true};
}

Status RigTable::enable() {
  TRY(reachable());
  if (rig_.emergency_stop()) return table_error("enable: emergency stop is latched: expected it released and cleared");
  for (Axis axis : all_axes)
    if (rig_.axis(axis).fault) return axis_error(axis, "enable: drive fault is latched: expected it cleared");
  enabled_ = {true, true, true};
  return {};
}

Status RigTable::home() {
  for (Axis axis : all_axes) {
    TRY(ready(axis));
    if (rig_.axis(axis).moving) return axis_error(axis, "home: a motion is under way");
  }
  const RigTableBehaviour& table = rig_.config().table;
  if (table.absolute_encoder) return {};
  for (Axis axis : all_axes) {
    for (Rig* rig : rigs_) rig->command_move(axis, 0.0, table.home_rate_degps, table.home_acceleration_degps2);
    homed_[index(axis)] = false;
    homing_[index(axis)] = true;
  }
  homing_ends_s_ = rig_.time_s() + table.home_time_s;
  return {};
}

Status RigTable::move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) {
  TRY(ready(axis));
  const std::size_t i = index(axis);
  const RigTableBehaviour& table = rig_.config().table;
  if (homing_[i]) return axis_error(axis, "homing is under way");
  if (!homed_[i]) return axis_error(axis, "not homed");
  if (rig_.axis(axis).moving) return axis_error(axis, "a motion is under way: expected it finished or stopped");
  if (!(position_deg >= table.limit_min_deg[i] && position_deg <= table.limit_max_deg[i]))
    return axis_error(axis, "move to " + format_number(position_deg) + " deg: expected " +
                                format_number(table.limit_min_deg[i]) + " to " + format_number(table.limit_max_deg[i]) +
                                " deg");
  if (!(rate_degps > 0.0 && rate_degps <= table.max_rate_degps[i]))
    return axis_error(axis, "rate " + format_number(rate_degps) + " deg/s: expected above 0 and at most " +
                                format_number(table.max_rate_degps[i]) + " deg/s");
  if (!(acceleration_degps2 > 0.0 && acceleration_degps2 <= table.max_acceleration_degps2[i]))
    return axis_error(axis, "acceleration " + format_number(acceleration_degps2) +
                                " deg/s^2: expected above 0 and at most " +
                                format_number(table.max_acceleration_degps2[i]) + " deg/s^2");
  for (Rig* rig : rigs_) rig->command_move(axis, position_deg, rate_degps, acceleration_degps2);
  return {};
}

Status RigTable::stop_all() {
  TRY(reachable());
  for (Rig* rig : rigs_) rig->stop();
  homing_ = {};
  return {};
}

Status RigTable::abort_all() {
  TRY(reachable());
  for (Rig* rig : rigs_) rig->abort();
  homing_ = {};
  enabled_ = {};
  return {};
}

Status RigTable::clear_fault() {
  TRY(reachable());
  for (Rig* rig : rigs_)
    if (!rig->clear_faults()) return table_error("clear fault: the emergency stop button has not been released");
  return {};
}

bool RigTable::in_position(Axis axis, const Rig::AxisState& state) const {
  const RigTableBehaviour& table = rig_.config().table;
  if (!enabled_[index(axis)] || state.never_in_position) return false;
  const double now_s = rig_.time_s();
  const bool arrived =
      !state.moving && std::abs(state.position_deg - state.target_deg) <= table.in_position_tolerance_deg;
  switch (table.in_position) {
    case InPositionFlag::honest: return arrived;
    case InPositionFlag::servo_on: return true;
    case InPositionFlag::after_stop: return !state.moving;
    case InPositionFlag::stale: return arrived || now_s - state.started_s < table.in_position_time_s;
    case InPositionFlag::late: return arrived && now_s - state.stopped_s >= table.in_position_time_s;
    case InPositionFlag::flicker:
      if (std::abs(now_s - state.stopped_s) < table.in_position_time_s)
        return std::int64_t(std::floor(now_s / 0.05 + 1e-6)) % 2 != 0;
      return arrived;
  }
  return false;
}

Result<AxisStatus> RigTable::status(Axis axis) {
  TRY(reachable());
  const std::size_t i = index(axis);
  const RigTableBehaviour& table = rig_.config().table;
  const Rig::AxisState state = rig_.axis(axis);
  AxisStatus report;
  report.position_deg = state.position_deg;
  if (table.encoder_resolution_deg > 0.0)
    report.position_deg = std::round(state.position_deg / table.encoder_resolution_deg) * table.encoder_resolution_deg;
  report.rate_degps = state.rate_degps;
  report.rate_told = true;
  report.enabled = report.drive_on = enabled_[i];
  report.homed = homed_[i];
  report.moving = state.moving || homing_[i];
  report.in_position = !homing_[i] && in_position(axis, state);
  report.limit = state.position_deg < table.limit_min_deg[i] || state.position_deg > table.limit_max_deg[i];
  report.fault = state.fault;
  report.emergency_stop = rig_.emergency_stop();
  report.remote = true;
  report.time_s = rig_.time_s();
  if (state.fault) report.text = "drive fault";
  const std::array<bool, 8> bits = {report.enabled, report.homed, report.moving,         report.in_position,
                                    report.limit,   report.fault, report.emergency_stop, homing_[i]};
  for (std::size_t bit = 0; bit < bits.size(); ++bit) report.raw |= bits[bit] ? 1u << bit : 0u;
  return report;
}

Status RigImu::open() {
  rig_.plug_imu();
  open_ = true;
  return {};
}

Result<ImuIdentity> RigImu::identify() {
  if (!open_) return device_error("simulated unit: identify before open");
  return ImuIdentity{rig_.config().unit_serial,
                     "simulated unit, seed " + std::to_string(rig_.config().unit_seed.value_or(rig_.config().seed))};
}

void RigImu::describe(RecordingInfo& info) const {
  info.sample_period_s = rig_.config().sample_period_s;
  info.gyro_increment = IncrementKind::pulses;
  info.accel_increment = IncrementKind::pulses;
  info.accel_pulse_mps = rig_.config().accel_pulse_mps;
  info.has_temperature = true;
  info.simulated = true;
}

Result<std::size_t> RigImu::read(std::span<ImuSample> out, double timeout_s) {
  if (!open_) return device_error("simulated unit: read before open");
  if (rig_.imu_unplugged()) {
    open_ = false;
    return device_error("simulated unit: the link was lost at " + std::to_string(rig_.time_s()) + " s of rig time");
  }
  // The small term makes 0.1 s of 5 ms samples 20, whatever the rounding of the division.
  const double wanted = std::floor(timeout_s / rig_.config().sample_period_s + 1e-6);
  const double room = double(out.size());
  const std::int64_t samples = wanted > 0.0 ? std::int64_t(std::min(wanted, room)) : 0;
  const std::size_t delivered = rig_.advance_time(samples, out);
  counters_.samples += delivered;
  for (const ImuSample& sample : out.first(delivered)) {
    if (have_counter_) {
      const std::int64_t ahead = sample.counter - last_counter_;
      if (ahead <= 0)
        ++counters_.duplicates;
      else
        counters_.lost_samples += std::uint64_t(ahead - 1);
    }
    have_counter_ = true;
    last_counter_ = sample.counter;
  }
  return delivered;
}

}  // namespace turncal
