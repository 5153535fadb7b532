#include "turntable_drivers/twins/told_table.h"

namespace turncal {

DriveFlags flags_of(const AxisStatus& now) {
  return {now.enabled, now.in_position, now.fault,          now.moving, now.homed,
          now.limit,   now.limit,       now.emergency_stop, now.remote};
}

int likeness(const DriveFlags& flags, const std::function<std::optional<bool>(std::size_t)>& says) {
  int score = 0;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    const std::optional<bool> said = says(i);
    if (!said) continue;
    using enum DriveBit;
    const auto bit = static_cast<DriveBit>(i);
    const int weight = bit == fault || bit == emergency_stop ? 100
                       : bit == moving                       ? 20
                       : bit == enabled                      ? 15
                       : bit == in_position                  ? 10
                                                             : 5;
    score += *said == flags[i] ? weight : -weight;
  }
  return score;
}

void Told::take(MoveQuantity quantity, double units, const AxisScale& scale) {
  switch (quantity) {
    case MoveQuantity::position: position_deg = scale.angle_of(units); break;
    case MoveQuantity::distance: distance_deg = units / scale.signed_units(); break;
    case MoveQuantity::rate: rate_degps = units / scale.rate_scale; break;
    case MoveQuantity::acceleration:
      acceleration_degps2 = scale.ramp_time ? scale.acceleration_scale / units : units / scale.acceleration_scale;
      break;
  }
}

Status ToldTable::power_on(bool enabled) {
  comes_up_enabled_ = enabled;
  TRY(table_.connect());
  return enabled ? table_.enable() : Status();
}

Result<AxisStatus> ToldTable::status(Axis axis) {
  Result<AxisStatus> now = table_.status(axis);
  return now || !power_on(comes_up_enabled_) ? now : table_.status(axis);
}

Status ToldTable::carry_out(TableOperation operation, Axis axis, bool of_table) {
  using enum TableOperation;
  if (operation == enable || operation == home || operation == stop || operation == abort) target_deg_ = {};
  switch (operation) {
    case enable: return table_.enable();
    case stop: return table_.stop_all();
    case abort: return table_.abort_all();
    case clear_fault: return table_.clear_fault();
    case home: {
      if (of_table) return table_.home();
      // The first axis of a round starts homing for all.
      bool& done = homed_round_[index(axis)];
      if (done) homed_round_ = {};
      const bool begins = homed_round_ == std::array<bool, 3>{};
      done = true;
      return begins ? table_.home() : Status();
    }
    default: return {};
  }
}

Status ToldTable::move(Axis axis, const AxisScale& scale, const Told& told, bool of_all, double same_deg) {
  if (!told.position_deg && !told.distance_deg) return {};
  if (of_all && told.distance_deg == 0.0) return {};
  const AxisStatus now = TRY(table_.status(axis));
  double target_deg = told.position_deg ? *told.position_deg : now.position_deg + *told.distance_deg;
  if (told.position_deg && scale.shorter_way)
    target_deg = unwrapped_deg(target_deg, now.position_deg, scale.modulo_deg);
  if (of_all && told.position_deg) {
    const double from_deg = target_deg_[index(axis)].value_or(now.position_deg);
    if (std::abs(from_deg - target_deg) < same_deg || std::abs(now.position_deg - target_deg) < same_deg) return {};
    target_deg_[index(axis)] = target_deg;
  }
  return table_.move_absolute(axis, target_deg, told.rate_degps, told.acceleration_degps2);
}

}  // namespace turncal
