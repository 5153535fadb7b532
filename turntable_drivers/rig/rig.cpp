#include "turntable_drivers/rig/rig.h"

#include <algorithm>
#include <cassert>
#include <limits>

#include "turntable_drivers/rig/rig_state.h"

namespace turncal {

using namespace rig_model;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

bool in_force(const RigFault& fault, Axis axis, double now_s) {
  const bool over = fault.duration_s > 0.0 && now_s >= fault.time_s + fault.duration_s;
  return fault.axis == static_cast<int>(axis) && now_s >= fault.time_s && !over;
}

}  // namespace

Rig::Rig(const RigConfig& config) : state_(std::make_unique<RigState>(config)) { assert(check(config).ok()); }
Rig::~Rig() = default;

const RigConfig& Rig::config() const { return state_->config; }

void Rig::command_move(Axis axis, double target_deg, double rate_degps, double acceleration_degps2) {
  RigState& s = *state_;
  s.apply_events();
  const std::size_t i = index(axis);
  RigState::Command& command = s.commands[i];
  command.target_deg = target_deg;
  command.started_s = s.time_s();
  if (command.stuck || command.fault || s.emergency_stop) return;
  for (const RigFault& fault : s.config.faults) {
    if (fault.kind != RigFaultKind::too_fast || !in_force(fault, axis, s.time_s())) continue;
    rate_degps *= fault.rate_factor;
    acceleration_degps2 *= fault.acceleration_factor;
  }
  command.acceleration_degps2 = acceleration_degps2;
  s.axes[i].move(s.k, target_deg, rate_degps, acceleration_degps2);
  s.standing_is_known = false;
}

void Rig::stop() {
  RigState& s = *state_;
  s.apply_events();
  for (std::size_t i = 0; i < 3; ++i) s.axes[i].brake(s.k, s.commands[i].acceleration_degps2);
  s.standing_is_known = false;
}

void Rig::abort() {
  RigState& s = *state_;
  s.apply_events();
  for (RigAxis& axis : s.axes) axis.halt(s.k);
  s.standing_is_known = false;
}

Rig::AxisState Rig::axis(Axis axis) const {
  RigState& s = *state_;
  s.apply_events();
  const std::size_t i = index(axis);
  const AxisPoint point = s.axes[i].reading(s.k, 0.0);
  const RigState::Command& command = s.commands[i];
  AxisState state;
  state.position_deg = point.position_deg;
  state.rate_degps = point.rate_degps;
  state.target_deg = command.target_deg;
  state.moving = s.axes[i].turning(s.k);
  state.fault = command.fault;
  state.stuck = command.stuck;
  for (const RigFault& fault : s.config.faults) {
    if (fault.kind == RigFaultKind::never_in_position && in_force(fault, axis, s.time_s()))
      state.never_in_position = true;
  }
  state.started_s = command.started_s;
  state.stopped_s = s.axes[i].command_end_s();
  return state;
}

bool Rig::emergency_stop() const {
  state_->apply_events();
  return state_->emergency_stop;
}

void Rig::release_emergency_stop() { state_->released = true; }

bool Rig::clear_faults() {
  RigState& s = *state_;
  s.apply_events();
  if (s.emergency_stop && !s.released && s.time_s() < s.release_by_itself_s) return false;
  s.emergency_stop = false;
  s.released = true;
  for (RigState::Command& command : s.commands) command.fault = command.stuck = false;
  return true;
}

bool Rig::link_lost() const {
  const double now_s = state_->time_s();
  return std::any_of(state_->config.faults.begin(), state_->config.faults.end(), [now_s](const RigFault& fault) {
    return fault.kind == RigFaultKind::link_lost && now_s >= fault.time_s &&
           (fault.duration_s == 0.0 || now_s < fault.time_s + fault.duration_s);
  });
}

bool Rig::imu_unplugged() const {
  state_->apply_events();
  return state_->unplugged;
}

void Rig::plug_imu() { state_->unplugged = false; }

void Rig::advance(std::span<ImuSample> out) {
  std::size_t delivered = 0;
  while (delivered < out.size()) {
    delivered += advance_time(std::numeric_limits<std::int64_t>::max(), out.subspan(delivered));
    if (state_->unplugged) plug_imu();
  }
}

std::size_t Rig::advance_time(std::int64_t samples, std::span<ImuSample> out) {
  RigState& s = *state_;
  std::size_t delivered = 0;
  for (std::int64_t passed = 0; delivered < out.size();) {
    if (s.duplicate) {
      out[delivered++] = *s.duplicate;
      s.duplicate.reset();
      continue;
    }
    s.apply_events();
    if (passed == samples || s.unplugged) break;
    ++passed;
    if (s.step(out[delivered])) ++delivered;
  }
  return delivered;
}

std::int64_t Rig::samples_passed() const { return state_->k; }
double Rig::time_s() const { return state_->time_s(); }
const std::array<double, 24>& Rig::truth() const { return state_->truth; }

std::array<double, 24> Rig::truth_at_reference(double reference_c) const {
  // reading_i = true_i (1 + s (T - T_old)) + c (T - T_old): divide row i by its factor at the new reference.
  const RigConfig& config = state_->config;
  const double change_c = reference_c - config.temperature.reference_c.value_or(config.temperature.start_c);
  std::array<double, 24> moved = state_->truth;
  for (std::size_t i = 0; i < 3; ++i) {
    const double gyro_factor = 1.0 + 1e-6 * config.effects.gyro_scale_temperature[i] * change_c;
    const double accel_factor = 1.0 + 1e-6 * config.effects.accel_scale_temperature[i] * change_c;
    moved[i] = (moved[i] + config.effects.gyro_bias_temperature[i] * change_c) / gyro_factor;
    moved[3 + i] = (moved[3 + i] + 1e-6 * config.effects.accel_bias_temperature[i] * change_c) / accel_factor;
    for (std::size_t j = 0; j < 3; ++j) {
      moved[6 + 3 * i + j] /= gyro_factor;
      moved[15 + 3 * i + j] /= accel_factor;
    }
  }
  return moved;
}

std::vector<std::pair<std::string, double>> Rig::truth_effects() const {
  return nonzero_effects(state_->config.effects);
}

std::array<double, 9> Rig::attitude_nb() const {
  state_->apply_events();
  const Matrix3d c_nb = state_->geometry.attitude_nb(state_->true_axes(0.0));
  std::array<double, 9> rows;
  for (std::size_t i = 0; i < 9; ++i) rows[i] = c_nb(static_cast<int>(i / 3), static_cast<int>(i % 3));
  return rows;
}

double Rig::temperature_c() const { return state_->temperature_at(state_->time_s()); }

std::vector<std::pair<std::string, double>> Rig::table_errors() const { return state_->errors.named(); }

}  // namespace turncal
