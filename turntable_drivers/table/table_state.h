// The state of an axis and of a table in one word, for people: the monitor, the log of a run and the status page. Nothing is decided
// from it. Also what is wrong with an axis, for whoever moves it. Pure functions of the readings; the caller must report `stopping`, which
// a table does not know.
#pragma once

#include <span>
#include <string>

#include "imu_io/base/text.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

// From best to worst: a table has the state of its worst axis. settling: at rest, but not at its target. emergency_stop: a person
// must release it, clear the drives and start again; no command here does.
enum class TableState { idle, settling, moving, stopping, not_ready, fault, emergency_stop, link_lost };
template <>
inline constexpr auto enum_words<TableState> = std::to_array({"idle", "settling", "moving", "stopping", "not ready",
                                                              "FAULT", "E-STOP", "link lost"});

constexpr TableState state_of(const AxisStatus& axis, bool stopping = false) {
  if (axis.emergency_stop) return TableState::emergency_stop;
  if (axis.fault || axis.limit) return TableState::fault;
  if (axis.moving && stopping) return TableState::stopping;
  if (!axis.enabled || !axis.homed || !axis.remote) return TableState::not_ready;
  if (axis.moving) return TableState::moving;
  return axis.in_position ? TableState::idle : TableState::settling;
}

constexpr TableState state_of(std::span<const AxisStatus> axes, bool stopping = false) {
  TableState worst = TableState::idle;
  for (const AxisStatus& axis : axes) {
    const TableState state = state_of(axis, stopping);
    if (worst < state) worst = state;
  }
  return worst;
}

// Returns why nothing may continue with this axis; empty if it may. in_use: it must be enabled and homed.
inline std::string trouble_of(Axis axis, const AxisStatus& read, bool in_use) {
  const std::string name = to_string(axis);
  const std::string text = read.text.empty() ? "" : ": " + read.text;
  if (read.emergency_stop) return "emergency stop is pressed" + text;
  if (read.fault) return "fault of axis " + name + text;
  if (read.limit) return "limit switch of axis " + name + text;
  if (!read.remote) return "axis " + name + " is not in remote mode" + text;
  if (in_use && !read.enabled) return "drive of axis " + name + " is off" + text;
  if (in_use && !read.homed) return "axis " + name + " lost its zero" + text;
  return "";
}

// Returns the state of a table whose status() has just failed.
inline TableState state_unread(const Turntable& table) {
  return table.answers() ? TableState::fault : TableState::link_lost;
}

}  // namespace turncal
