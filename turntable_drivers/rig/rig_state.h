// What a rig is at a moment, and how it gets to the next sample. rig.h is its face.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "calib/types/recording_types.h"
#include "turntable_drivers/rig/rig_axes.h"
#include "turntable_drivers/rig/rig_config.h"
#include "turntable_drivers/rig/rig_geometry.h"
#include "turntable_drivers/rig/rig_math.h"
#include "turntable_drivers/rig/rig_noise.h"
#include "turntable_drivers/rig/rig_sensors.h"
#include "turntable_drivers/rig/rig_truth.h"

namespace turncal::rig_model {

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

  std::int64_t k = 0;  // samples passed: the next one is sample k
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
  std::vector<Event> events;  // of the table, by sample
  std::size_t next_event = 0;
  std::vector<RigFault> unit_faults;
  std::int64_t counter_shift = 0;      // hidden losses and duplicates
  std::optional<ImuSample> duplicate;  // to be delivered next

  // At rest nothing but noise and the running effects changes from sample to sample.
  bool standing_is_known = false;
  BodyMotion standing_motion;
  Reading standing_reading;
  double hysteresis_state = 0.0;

  std::array<TrueAxis, 3> true_axes(double offset_s) const {
    return {axes[0].truth(k, offset_s), axes[1].truth(k, offset_s), axes[2].truth(k, offset_s)};
  }
  double time_s() const { return static_cast<double>(k) * period_s; }
  double temperature_at(double time_s) const {
    if (config.temperature.rise_c == 0.0) return config.temperature.start_c;
    return config.temperature.start_c + config.temperature.rise_c * (1.0 - exp_of(-time_s / config.temperature.tau_s));
  }
  double since_motion_s(double time_s) const {
    double end_s = axes[0].motion_end_s();
    for (const RigAxis& axis : axes) end_s = std::max(end_s, axis.motion_end_s());
    return std::isfinite(end_s) ? time_s - end_s : -1.0;  // negative while a motion lasts
  }
  RigMoment moment_at(double offset_s) const {
    const double t = time_s() + offset_s;
    return {t, temperature_at(t), since_motion_s(t)};
  }

  void apply_events();
  void apply_event(const RigFault& fault);
  bool all_standing() const { return axes[0].standing(k) && axes[1].standing(k) && axes[2].standing(k); }
  void integrate_standing(std::array<double, 3>& gyro, std::array<double, 3>& accel);
  void integrate_motion(std::array<double, 3>& gyro, std::array<double, 3>& accel);
  bool step(ImuSample& sample);  // false: the sample was lost
};

}  // namespace turncal::rig_model
