#include "turntable_drivers/table/limited_turntable.h"

#include <algorithm>

#include "imu_io/base/format_number.h"

namespace turncal {
namespace {

constexpr double rounding_deg = 1e-9;

Error refused(Axis axis, const std::string& what, double value, const char* unit, double limit) {
  return input_error(std::string("motion limits: ") + to_string(axis) + ": " + what + " " + format_number(value) + " " +
                     unit + ": expected at most " + format_number(limit) + " " + unit);
}

}  // namespace

Status LimitedTurntable::enable() {
  switched_on_ = true;  // also where the answer was lost
  return table_.enable();
}

Status LimitedTurntable::abort_all() {
  const Status aborted = table_.abort_all();
  if (aborted) switched_on_ = false;
  return aborted;
}

Status LimitedTurntable::home() {
  travel_ = {};  // the zero may change, and a cable is wound as it is at zero
  return table_.home();
}

Result<AxisStatus> LimitedTurntable::status(Axis axis) {
  Result<AxisStatus> now = table_.status(axis);
  std::optional<Travel>& travel = travel_[index(axis)];
  if (now && now->homed) {
    if (!travel) travel = Travel{now->position_deg, now->position_deg};
    travel->min_deg = std::min(travel->min_deg, now->position_deg);
    travel->max_deg = std::max(travel->max_deg, now->position_deg);
  }
  return now;
}

Status LimitedTurntable::move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) {
  const MotionLimits& limit = limits_[index(axis)];
  if (!(position_deg >= limit.soft_min_deg && position_deg <= limit.soft_max_deg)) {
    return input_error(std::string("motion limits: ") + to_string(axis) + ": move to " + format_number(position_deg) +
                       " deg: expected " + format_number(limit.soft_min_deg) + " to " +
                       format_number(limit.soft_max_deg) + " deg");
  }
  if (!(rate_degps <= limit.max_rate_degps)) return refused(axis, "rate", rate_degps, "deg/s", limit.max_rate_degps);
  if (!(acceleration_degps2 <= limit.max_acceleration_degps2)) {
    return refused(axis, "acceleration", acceleration_degps2, "deg/s^2", limit.max_acceleration_degps2);
  }
  // Where it stands now belongs to the travel.
  const AxisStatus now = TRY(status(axis));
  const std::optional<Travel>& known = travel_[index(axis)];
  if (known && limit.wrap_deg > 0.0) {
    const double wound_deg = std::max(known->max_deg, position_deg) - std::min(known->min_deg, position_deg);
    const double before_deg = known->max_deg - known->min_deg;
    if (wound_deg > limit.wrap_deg + rounding_deg && wound_deg > before_deg + rounding_deg) {
      return refused(axis, "the move to " + format_number(position_deg) + " deg winds the cable by", wound_deg, "deg",
                     limit.wrap_deg);
    }
  }
  TRY(table_.move_absolute(axis, position_deg, rate_degps, acceleration_degps2));
  return {};
}

}  // namespace turncal
