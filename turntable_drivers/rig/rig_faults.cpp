#include "turntable_drivers/rig/rig_faults.h"

#include <array>
#include <utility>

namespace turncal {
namespace {

constexpr std::array<std::pair<RigFaultKind, const char*>, 14> names = {{
    {RigFaultKind::lost_sample, "lost_sample"},
    {RigFaultKind::duplicated_sample, "duplicated_sample"},
    {RigFaultKind::gyro_glitch, "gyro_glitch"},
    {RigFaultKind::velocity_knock, "velocity_knock"},
    {RigFaultKind::invalid_sample, "invalid_sample"},
    {RigFaultKind::imu_silent, "imu_silent"},
    {RigFaultKind::imu_unplugged, "imu_unplugged"},
    {RigFaultKind::table_moved, "table_moved"},
    {RigFaultKind::too_fast, "too_fast"},
    {RigFaultKind::never_in_position, "never_in_position"},
    {RigFaultKind::stuck_axis, "stuck_axis"},
    {RigFaultKind::axis_fault, "axis_fault"},
    {RigFaultKind::emergency_stop, "emergency_stop"},
    {RigFaultKind::link_lost, "link_lost"},
}};

}  // namespace

bool parse_rig_fault_kind(std::string_view name, RigFaultKind& kind) {
  for (const auto& [candidate, text] : names) {
    if (name == text) {
      kind = candidate;
      return true;
    }
  }
  return false;
}

bool concerns_unit(RigFaultKind kind) { return kind <= RigFaultKind::imu_unplugged; }

const char* to_string(RigFaultKind kind) {
  for (const auto& [candidate, text] : names) {
    if (kind == candidate) return text;
  }
  return "unknown";
}

}  // namespace turncal
