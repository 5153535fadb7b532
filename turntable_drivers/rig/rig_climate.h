// The air of a chamber about the unit, and what it does to the unit. Nothing acts before the first command.
//
//   r    where the controller wants the air: goes to the set point at the ramp; the chamber off: to the room (T_start) with tau_off
//   air  a'' + 2 z w a' + w^2 (a - r) = 0, w = 1/40 s, z = 0.6: overshoots a step by a tenth of it, a ramp's end by less
//   unit u' = (air - u) / tau_unit
//
// The unit's temperature is that of rig_config.h and what u differs from the room. One step a sample, semi-implicit Euler.
// Not modelled: the unit's heat in the air, a chamber that cannot keep up, dew.
#pragma once

#include <algorithm>

namespace turncal::rig_model {

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
  // more_c: by how much hotter the air is driven than its controller wants.
  void step(double dt_s, double more_c) {
    if (on)
      wanted_c += std::clamp(set_point_c - wanted_c, -ramp_c_per_min / 60.0 * dt_s, ramp_c_per_min / 60.0 * dt_s);
    else
      wanted_c += (room_c - wanted_c) * dt_s / tau_off_s;
    air_rate += dt_s * (w * w * (wanted_c + (on ? more_c : 0.0) - air_c) - 2.0 * z * w * air_rate);
    air_c += dt_s * air_rate;
    unit_c += dt_s * (air_c - unit_c) / tau_unit_s;
  }
  double of_unit_c() const { return active ? unit_c - room_c : 0.0; }  // beyond what it is without a chamber
};

}  // namespace turncal::rig_model
