// Faults of the table and of the unit, for a rig that two_steps_text turns.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "tests/orchestrator/rig_station.h"

namespace turncal {

inline constexpr double homing_s = 2.0;  // two_steps_text begins then

inline RigFault table_fault(RigFaultKind kind, double time_s, Axis axis = Axis::pitch) {
  RigFault fault;
  fault.kind = kind;
  fault.time_s = time_s;
  fault.axis = static_cast<int>(axis);
  return fault;
}

inline RigFault unit_fault(RigFaultKind kind, std::int64_t sample_of_recording, std::int64_t count = 1) {
  RigFault fault;
  fault.kind = kind;
  fault.sample = sample_of_recording + static_cast<std::int64_t>(homing_s / 0.005);
  fault.count = count;
  return fault;
}

inline RigConfig rig_with(std::vector<RigFault> faults) {
  RigConfig config = default_rig_config();
  config.faults = std::move(faults);
  return config;
}

}  // namespace turncal
