#include "turntable_drivers/rig/rig.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <optional>

#include "turntable_drivers/rig/rig_axes.h"
#include "turntable_drivers/rig/rig_geometry.h"
#include "turntable_drivers/rig/rig_math.h"
#include "turntable_drivers/rig/rig_sensors.h"
#include "turntable_drivers/rig/rig_truth.h"

namespace turncal::rig_model {

// The air of a chamber around the unit and its effect on the unit. It is inactive before the first command.
//
//   r    reference of the controller: follows the set point at the ramp rate; chamber off: decays to the room (T_start) with tau_off
//   air  a'' + 2 z w a' + w^2 (a - r) = 0, w = 1/40 s, z = 0.6: overshoots a step by a tenth of it, the end of a ramp by less
//   unit u' = (air - u) / tau_unit
//
// The unit has the temperature of rig_config.h plus (u - room). One step per sample, semi-implicit Euler.
// Not modelled: the heat of the unit in the air, the limits of a chamber's power, dew.
struct RigClimate {
  bool active = false, on = false;
  double room_c = 24.0;
  double set_point_c = 24.0, ramp_c_per_min = 1.0;
  double wanted_c = 24.0, air_c = 24.0, air_rate = 0.0, unit_c = 24.0;
  static constexpr double w = 1.0 / 40.0, z = 0.6, tau_off_s = 1200.0, tau_unit_s = 300.0;

  void command(double room, double set_point, double ramp, bool switched_on) {
    if (!active) set_point_c = wanted_c = air_c = unit_c = room_c = room;
    if (switched_on && !on) wanted_c = air_c;
    active = true;
    set_point_c = set_point;
    ramp_c_per_min = ramp;
    on = switched_on;
  }
  // more_c: excess of the air temperature over the controller's reference.
  void step(double dt_s, double more_c) {
    if (on)
      wanted_c += std::clamp(set_point_c - wanted_c, -ramp_c_per_min / 60.0 * dt_s, ramp_c_per_min / 60.0 * dt_s);
    else
      wanted_c += (room_c - wanted_c) * dt_s / tau_off_s;
    air_rate += dt_s * (w * w * (wanted_c + (on ? more_c : 0.0) - air_c) - 2.0 * z * w * air_rate);
    air_c += dt_s * air_rate;
    unit_c += dt_s * unit_rate();
  }
  double unit_rate() const { return (air_c - unit_c) / tau_unit_s; }   // C/s
  double of_unit_c() const { return active ? unit_c - room_c : 0.0; }  // relative to a unit without a chamber
};

// The state of a rig, and the step to the next sample.
struct RigState {
  explicit RigState(const RigConfig& given);

  RigConfig config;
  double period_s;
  std::array<double, 24> truth;
  TableErrorsInForce errors;
  TableGeometry geometry;
  SensorEffects sensor_effects;
  PulseCounter gyro_counter, accel_counter;
  TriadNoise gyro_noise_source, accel_noise_source;

  RigClimate climate;
  std::optional<double> dead_sensor_c;  // the last reading

  std::int64_t k = 0;  // samples passed; the next one is sample k
  std::array<RigAxis, 3> axes;
  struct Command {
    double target_deg = 0.0, acceleration_degps2 = 10.0, started_s = 0.0;
    bool fault = false, stuck = false;
  };
  std::array<Command, 3> commands;
  bool emergency_stop = false, released = true;
  double release_by_itself_s = std::numeric_limits<double>::infinity();
  bool unplugged = false;

  struct Event {
    std::int64_t sample;
    RigFault fault;
  };
  std::vector<Event> events;  // of the table, in the order of samples
  std::size_t next_event = 0;
  std::vector<RigFault> unit_faults;
  std::int64_t counter_shift = 0;      // from hidden losses and duplicates
  std::optional<ImuSample> duplicate;  // to be delivered next

  // At rest only noise and the running effects change from sample to sample.
  bool standing_is_known = false;
  BodyMotion standing_motion;
  Reading standing_reading;
  double hysteresis_state = 0.0;

  std::array<TrueAxis, 3> true_axes(double offset_s) const {
    return {axes[0].truth(k, offset_s), axes[1].truth(k, offset_s), axes[2].truth(k, offset_s)};
  }
  double time_s() const { return double(k) * period_s; }
  double temperature_at(double time_s) const {
    if (config.temperature.rise_c == 0.0) return config.temperature.start_c + climate.of_unit_c();
    return config.temperature.start_c + climate.of_unit_c() +
           config.temperature.rise_c * (1.0 - exp_of(-time_s / config.temperature.tau_s));
  }
  double c_per_h_at(double time_s) const {
    const RigTemperature& own = config.temperature;
    return 3600.0 * (climate.unit_rate() + own.rise_c / own.tau_s * exp_of(-time_s / own.tau_s));
  }
  double since_motion_s(double time_s) const {
    double end_s = axes[0].motion_end_s();
    for (const RigAxis& axis : axes) end_s = std::max(end_s, axis.motion_end_s());
    return std::isfinite(end_s) ? time_s - end_s : -1.0;  // negative while a motion lasts
  }
  RigMoment moment_at(double offset_s) const {
    const double t = time_s() + offset_s;
    return {t, temperature_at(t), c_per_h_at(t), since_motion_s(t)};
  }

  bool in_force(const RigFault& fault, RigFaultKind kind) const {
    return fault.kind == kind && fault.in_force(time_s());
  }
  const RigFault* fault_in_force(RigFaultKind kind) const {
    const auto found = std::ranges::find_if(config.faults, [&](const RigFault& f) { return in_force(f, kind); });
    return found == config.faults.end() ? nullptr : &*found;
  }
  void pass_climate();

  void apply_events();
  void apply_event(const RigFault& fault);
  bool all_standing() const { return axes[0].standing(k) && axes[1].standing(k) && axes[2].standing(k); }
  void integrate_standing(std::array<double, 3>& gyro, std::array<double, 3>& accel);
  void integrate_motion(std::array<double, 3>& gyro, std::array<double, 3>& accel);
  bool step(ImuSample& sample);  // false: the sample was lost
};

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double arcsec = pi / 180.0 / 3600.0;

// Gauss-Legendre nodes on (0, 1), exact for polynomials up to degree 5. At 100 deg/s a sample covers half a degree, and its
// quadrature error is below 1e-19 of the increment.
constexpr std::array<double, 3> node = {0.11270166537925831148, 0.5, 0.88729833462074168852};
constexpr std::array<double, 3> weight = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};

SiteVectors site_vectors(const RigConfig& config) {
  const SinCos latitude = sin_cos_deg(config.site.latitude_deg);
  SiteVectors site;
  site.earth_rate = config.site.earth_rate_radps * Vector3d(latitude.cos, latitude.sin, 0.0);
  site.specific_force = Vector3d(0.0, config.site.gravity_mps2, 0.0);
  const Triple& field = config.site.magnetic_field_gauss;
  const Nine& magnetic = config.effects.gyro_magnetic;
  const bool senses_field = std::ranges::any_of(magnetic, [](double m) { return m != 0.0; });
  site.field = senses_field ? Vector3d(field[0], field[1], field[2]) : Vector3d(0.0, 0.0, 0.0);
  site.earth_error = radps_per_degph * Vector3d(config.effects.earth_rate[0], config.effects.earth_rate[1], 0.0);
  return site;
}

Matrix3d matrix_at(const std::array<double, 24>& truth, std::size_t first) {
  return Eigen::Map<const RowMajor3>(truth.data() + first);
}

bool is_table_event(RigFaultKind kind) {
  return kind == RigFaultKind::table_moved || kind == RigFaultKind::stuck_axis || kind == RigFaultKind::axis_fault ||
         kind == RigFaultKind::emergency_stop || kind == RigFaultKind::imu_unplugged;
}

NoiseSize gyro_noise(const RigNoise& noise) {
  return {noise.gyro_random_walk_deg_per_rt_h * (pi / 180.0) / 60.0,
          noise.gyro_bias_instability_degph * radps_per_degph, noise.flicker_longest_s,
          noise.gyro_rate_random_walk_degph_per_rt_h * radps_per_degph / 60.0};
}

NoiseSize accel_noise(const RigNoise& noise) {
  return {noise.accel_random_walk_ug_per_rt_hz * mps2_per_ug, noise.accel_bias_instability_ug * mps2_per_ug,
          noise.flicker_longest_s, noise.accel_acceleration_random_walk_ug_per_rt_h * mps2_per_ug / 60.0};
}

}  // namespace

RigState::RigState(const RigConfig& given)
    : config(given),
      period_s(given.sample_period_s),
      truth(draw_truth(given)),
      errors(draw_table_errors(given)),
      geometry(errors.geometry_angles(), site_vectors(given)),
      sensor_effects(given),
      gyro_counter(matrix_at(truth, 6) * arcsec, Vector3d(truth[0], truth[1], truth[2]) * radps_per_degph, period_s,
                   given.quantisation),
      accel_counter(matrix_at(truth, 15) * given.accel_pulse_mps,
                    Vector3d(truth[3], truth[4], truth[5]) * standard_gravity_mps2, period_s, given.quantisation),
      gyro_noise_source(gyro_noise(given.noise), period_s, given.noise_seed.value_or(given.seed), 0),
      accel_noise_source(accel_noise(given.noise), period_s, given.noise_seed.value_or(given.seed), 1) {
  for (std::size_t i = 0; i < 3; ++i) {
    const double power_on_deg = config.table.power_on_deg[i];
    axes[i] = RigAxis(power_on_deg, errors.encoder[i], config.table_errors.creep_arcsec[i] / 3600.0,
                      config.table_errors.creep_tau_s, period_s);
    commands[i].target_deg = power_on_deg;
  }
  for (const RigFault& fault : config.faults) {
    if (is_table_event(fault.kind)) {
      events.push_back({std::int64_t(std::ceil(fault.time_s / period_s - 1e-9)), fault});
    } else if (fault.kind == RigFaultKind::imu_silent) {
      RigFault silence = fault;
      silence.kind = RigFaultKind::lost_sample;
      silence.sample = std::int64_t(std::ceil(fault.time_s / period_s - 1e-9));
      silence.count = std::int64_t(std::ceil(fault.duration_s / period_s - 1e-9));
      silence.hidden = false;
      unit_faults.push_back(silence);
    } else if (concerns_unit(fault.kind)) {
      unit_faults.push_back(fault);
    }
  }
  std::ranges::stable_sort(events, [](const Event& a, const Event& b) { return a.sample < b.sample; });
}

void RigState::apply_event(const RigFault& fault) {
  const std::size_t i = std::size_t(fault.axis);
  switch (fault.kind) {
    case RigFaultKind::table_moved: axes[i].slip(k, fault.size, fault.rate_degps, fault.hidden); break;
    case RigFaultKind::stuck_axis:
      commands[i].stuck = true;
      axes[i].halt(k);
      break;
    case RigFaultKind::axis_fault:
      commands[i].fault = true;
      axes[i].brake(k, commands[i].acceleration_degps2);
      break;
    case RigFaultKind::emergency_stop:
      emergency_stop = true;
      released = false;
      release_by_itself_s =
          fault.duration_s > 0.0 ? fault.time_s + fault.duration_s : std::numeric_limits<double>::infinity();
      for (RigAxis& axis : axes) axis.halt(k);
      break;
    case RigFaultKind::imu_unplugged: unplugged = true; break;
    default: break;
  }
  standing_is_known = false;
}

void RigState::apply_events() {
  while (next_event < events.size() && events[next_event].sample <= k) apply_event(events[next_event++].fault);
}

void RigState::integrate_standing(std::array<double, 3>& gyro, std::array<double, 3>& accel) {
  if (!standing_is_known) {
    const std::array<TrueAxis, 3> now = true_axes(0.0);
    standing_motion = geometry.at(now);
    hysteresis_state = sensor_effects.next_hysteresis_state(standing_motion, hysteresis_state);
    standing_reading = sensor_effects.standing(standing_motion, now, hysteresis_state);
    standing_is_known = true;
  }
  Reading reading = standing_reading;
  if (sensor_effects.has_running()) sensor_effects.add_running(standing_motion, moment_at(0.5 * period_s), reading);
  Eigen::Map<Vector3d>(gyro.data()) = reading.gyro * period_s;
  Eigen::Map<Vector3d>(accel.data()) = reading.accel * period_s;
}

void RigState::integrate_motion(std::array<double, 3>& gyro, std::array<double, 3>& accel) {
  standing_is_known = false;
  std::array<double, 3 * RigAxis::max_corners + 2> corners;
  corners[0] = 0.0;
  std::size_t count = 1;
  for (const RigAxis& axis : axes) count += axis.corners(k, std::span(corners).subspan(count, RigAxis::max_corners));
  corners[count++] = period_s;
  if (count > 2) std::sort(corners.begin() + 1, corners.begin() + std::ptrdiff_t(count - 1));

  Vector3d gyro_sum = Vector3d::Zero(), accel_sum = Vector3d::Zero();
  BodyMotion motion;
  const int substeps = config.quadrature_substeps;
  for (std::size_t piece = 0; piece + 1 < count; ++piece) {
    const double length_s = (corners[piece + 1] - corners[piece]) / substeps;
    if (!(length_s > 0.0)) continue;
    for (int sub = 0; sub < substeps; ++sub) {
      const double start_s = corners[piece] + sub * length_s;
      for (std::size_t i = 0; i < node.size(); ++i) {
        const double offset_s = start_s + node[i] * length_s;
        const std::array<TrueAxis, 3> now = true_axes(offset_s);
        motion = geometry.at(now);
        Reading reading = sensor_effects.standing(motion, now, hysteresis_state);
        if (sensor_effects.has_running()) sensor_effects.add_running(motion, moment_at(offset_s), reading);
        gyro_sum += (weight[i] * length_s) * reading.gyro;
        accel_sum += (weight[i] * length_s) * reading.accel;
      }
    }
  }
  if (sensor_effects.has_hysteresis())
    hysteresis_state = sensor_effects.next_hysteresis_state(motion, hysteresis_state);
  Eigen::Map<Vector3d>(gyro.data()) = gyro_sum;
  Eigen::Map<Vector3d>(accel.data()) = accel_sum;
}

void RigState::pass_climate() {
  const RigFault* const hot = fault_in_force(RigFaultKind::chamber_overheats);
  const RigFault* const unsettled = fault_in_force(RigFaultKind::chamber_never_settles);
  constexpr double swing_s = 240.0;
  climate.step(period_s, hot         ? hot->size
                         : unsettled ? unsettled->size * sin_cos_deg(360.0 * time_s() / swing_s).sin
                                     : 0.0);
}

bool RigState::step(ImuSample& sample) {
  apply_events();
  if (climate.active) pass_climate();
  std::array<double, 3> gyro, accel;
  if (standing_is_known || all_standing())
    integrate_standing(gyro, accel);
  else
    integrate_motion(gyro, accel);
  gyro_noise_source.add(gyro);
  accel_noise_source.add(accel);

  bool lost = false, lost_in_hiding = false;
  const RigFault* repeat = nullptr;
  sample.flags = 0;
  for (const RigFault& fault : unit_faults) {
    if (k < fault.sample || k >= fault.sample + fault.count) continue;
    const std::size_t i = std::size_t(fault.axis);
    switch (fault.kind) {
      case RigFaultKind::lost_sample:
        lost = true;
        lost_in_hiding = lost_in_hiding || fault.hidden;
        break;
      case RigFaultKind::duplicated_sample: repeat = &fault; break;
      case RigFaultKind::gyro_glitch: gyro[i] += 1e-3 * fault.size; break;
      case RigFaultKind::velocity_knock: accel[i] += fault.size; break;
      case RigFaultKind::invalid_sample: sample.flags |= sample_flag_invalid; break;
      default: break;
    }
  }
  sample.gyro = gyro_counter.count(gyro);
  sample.accel = accel_counter.count(accel);
  const double temperature_c = temperature_at(time_s() + 0.5 * period_s);
  sample.temperature_c = float(floor_of(temperature_c * 1000.0 + 0.5) / 1000.0);
  sample.counter = config.first_counter + k + counter_shift;
  ++k;
  if (lost) {
    if (lost_in_hiding) --counter_shift;
    return false;
  }
  if (repeat != nullptr) {
    duplicate = sample;
    if (repeat->hidden) {
      ++counter_shift;
      ++duplicate->counter;
    }
  }
  return true;
}

}  // namespace turncal::rig_model

namespace turncal {

using namespace rig_model;

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
    if (fault.axis != int(axis) || !s.in_force(fault, RigFaultKind::too_fast)) continue;
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
  const bool never_in_position = std::ranges::any_of(s.config.faults, [&](const RigFault& fault) {
    return fault.axis == int(axis) && s.in_force(fault, RigFaultKind::never_in_position);
  });
  return {.position_deg = point.position_deg,
          .rate_degps = point.rate_degps,
          .target_deg = command.target_deg,
          .moving = s.axes[i].turning(s.k),
          .fault = command.fault,
          .stuck = command.stuck,
          .never_in_position = never_in_position,
          .started_s = command.started_s,
          .stopped_s = s.axes[i].command_end_s()};
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

bool Rig::link_lost() const { return state_->fault_in_force(RigFaultKind::link_lost) != nullptr; }

bool Rig::imu_unplugged() const {
  state_->apply_events();
  return state_->unplugged;
}

void Rig::plug_imu() { state_->unplugged = false; }

void Rig::command_chamber(double set_point_c, double ramp_c_per_min, bool on) {
  RigState& s = *state_;
  if (s.fault_in_force(RigFaultKind::chamber_stays_on)) on = on || s.climate.on;
  s.climate.command(s.config.temperature.start_c, set_point_c, ramp_c_per_min, on);
}

Rig::ChamberState Rig::chamber() const {
  RigState& s = *state_;
  const auto has = [&](RigFaultKind kind) { return s.fault_in_force(kind) != nullptr; };
  const RigClimate& climate = s.climate;
  const RigFault* const hot = s.fault_in_force(RigFaultKind::chamber_overheats);
  // While the chamber overheats, its sensor is where the air has the wanted temperature.
  const double seen_c = climate.active ? (hot ? climate.wanted_c : climate.air_c) : s.config.temperature.start_c;
  if (!has(RigFaultKind::chamber_sensor_dead))
    s.dead_sensor_c.reset();
  else if (!s.dead_sensor_c)
    s.dead_sensor_c = seen_c;
  return {s.dead_sensor_c.value_or(seen_c),
          climate.active ? climate.set_point_c : s.config.temperature.start_c,
          climate.on,
          has(RigFaultKind::chamber_door_open),
          has(RigFaultKind::chamber_alarm),
          has(RigFaultKind::chamber_link_lost)};
}

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
  // reading_i = true_i (1 + s (T - T_old)) + c (T - T_old): row i is divided by its factor at the new reference.
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
  std::array<double, 9> rows;
  Eigen::Map<RowMajor3>(rows.data()) = state_->geometry.attitude_nb(state_->true_axes(0.0));
  return rows;
}

double Rig::temperature_c() const { return state_->temperature_at(state_->time_s()); }

std::vector<std::pair<std::string, double>> Rig::table_errors() const { return state_->errors.named(); }

}  // namespace turncal
