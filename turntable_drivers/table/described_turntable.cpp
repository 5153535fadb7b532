#include "turntable_drivers/table/described_turntable.h"

#include <algorithm>

#include "turntable_drivers/table/drive_rules.h"

namespace turncal {

Error DescribedTurntable::table_error(const std::string& what) const {
  return device_error("table " + table_.name + ": " + what);
}

Error DescribedTurntable::axis_error(Axis axis, const std::string& what) const {
  return table_error(std::string(to_string(axis)) + ": " + what);
}

bool DescribedTurntable::believable(Axis axis, double position_deg) const {
  return memory_[index(axis)].believable(position_deg, clock_.now_s(), table_.plausible_deg,
                                         table_.plausible_rate_degps);
}

Error DescribedTurntable::not_believed(Axis axis, double position_deg) const {
  const std::optional<double>& last_deg = memory_[index(axis)].position_deg;
  return axis_error(axis, "position " + degrees(position_deg) +
                              " is not believed: expected one that can be reached from " +
                              (last_deg ? degrees(*last_deg) : "here"));
}

Status DescribedTurntable::connected() const {
  if (!connected_) return table_error("not connected");
  if (lost()) return table_error("link lost (" + lost_reason() + "): expected it connected again");
  return {};
}

Status DescribedTurntable::commissioned() const {
  if (table_.commissioned) return {};
  return input_error(
      table_error("not commissioned: expected scale, sign and order checked and commissioned = true in " + table_.file)
          .message);
}

Status DescribedTurntable::may_enable(Axis axis) {
  const AxisStatus now = TRY(status(axis));
  if (now.emergency_stop) return axis_error(axis, "enable: emergency stop is pressed");
  if (now.fault) return axis_error(axis, "enable: drive fault: expected it cleared");
  return {};
}

Result<AxisStatus> DescribedTurntable::ready(Axis axis) {
  Result<AxisStatus> now = status(axis);
  if (!now) return now;
  if (const auto refusal = refusal_of_state(*now)) return axis_error(axis, *refusal);
  return now;
}

Result<AxisStatus> DescribedTurntable::ready_to_move(Axis axis, double position_deg, double rate_degps,
                                                     double acceleration_degps2) {
  TRY(commissioned());
  if (const auto refusal = refusal_of_move(position_deg, rate_degps, acceleration_degps2, table_.plausible_deg,
                                           table_.plausible_rate_degps))
    return axis_error(axis, *refusal);
  Result<AxisStatus> now = ready(axis);
  if (now && !now->homed) return axis_error(axis, "not homed");
  return now;
}

bool DescribedTurntable::is_off(Axis axis, bool one) const {
  const auto read_off = [](const AxisMemory& memory) { return memory.drive_on == false; };
  return commanded_off_ ||
         (one ? read_off(memory_[index(axis)]) : std::all_of(memory_.begin(), memory_.end(), read_off));
}

Status DescribedTurntable::abort_all() {
  commanded_off_ = true;
  const Status status = halt(true);
  enable_called_ = false;
  return status;
}

}  // namespace turncal
