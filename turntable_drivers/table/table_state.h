// The state of an axis and of a table in one word, for people: the monitor, the run's log and the status page. Nothing is decided by
// that. What is wrong with an axis, for whoever moves it. Pure functions of what was read; stopping is what the reader has to say, since
// a table does not.
#pragma once

#include <span>
#include <string>

#include "imu_io/base/text.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

// From the best to the worst: a table is what its worst axis is. settling: at rest, but not where it was sent. emergency_stop: a person
// has to release it, clear the drives and begin anew; no command here does.
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

// Why nothing may go on with this axis; empty: it may. in_use: it has to be switched on and to know its zero.
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

// Of a table whose status() failed just now.
inline TableState state_unread(const Turntable& table) {
  return table.answers() ? TableState::fault : TableState::link_lost;
}

}  // namespace turncal
