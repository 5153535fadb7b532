#include "turntable_drivers/modbus/modbus_turntable.h"

#include <algorithm>
#include <cmath>

#include "imu_io/base/format_number.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {
namespace {

// A pulse of the stop itself is not cut short.
void hold(double seconds) { static_cast<void>(StopSignal().pause(seconds)); }

}  // namespace

ModbusTurntable::ModbusTurntable(RegisterMap map, const Clock& clock, const std::atomic<int>* stop_requests)
    : DescribedTurntable(map, clock, stop_requests), map_(std::move(map)), link_(map_.link, stop_) {}

Status ModbusTurntable::connect() {
  TRY(open_drives(true));
  connected_ = was_connected_ = true;
  return {};
}

Status ModbusTurntable::open_drives(bool judge_positions) {
  connected_ = false;
  enable_called_ = false;
  memory_ = {};
  TRY(link_.open());
  for (const Axis axis : all_axes) {
    Status prepared;
    if (is_due(DriveOperation::setup, axis)) prepared = write_list(axis, DriveOperation::setup, {});
    if (!prepared) {
      link_.close();
      return prepared;
    }
    // Every drive has to answer, with a block that makes sense.
    Result<std::vector<std::uint16_t>> block = read_block(axis);
    Status status;
    if (!block) {
      status = block.error();
    } else if (judge_positions && !believed_position(axis, *block)) {
      status = axis_error(axis, "position " + degrees(angle_of(map_.of(axis), raw_counts(axis, *block, map_.layout))) +
                                    " is not plausible: expected a map with the drive's word order and scale");
    }
    if (!status) {
      link_.close();
      return status;
    }
  }
  memory_ = {};
  return {};
}

Result<TableIdentity> ModbusTurntable::identify() {
  TRY(connected());
  return TableIdentity{
      map_.name + " at " + map_.link.address + (map_.verified_on_hardware ? "" : ", map not verified on hardware"),
      map_.simulated};
}

// ---- writing; reading: modbus_reading.cpp ----

Status ModbusTurntable::write_list(Axis axis, DriveOperation operation, const Moves& moves) {
  // Everything is encoded before anything is sent.
  std::vector<std::vector<std::uint16_t>> requests;
  for (const WriteStep& step : map_.list(operation)) {
    Result<std::vector<std::uint16_t>> words = words_of(map_, step, axis, moves);
    if (!words) return axis_error(axis, words.error().message);
    requests.push_back(std::move(*words));
  }
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const WriteStep& step = map_.list(operation)[i];
    if (step.operands.empty()) {
      if (!stop_.pause(step.wait_s)) return Error{ErrorKind::aborted, axis_error(axis, "given up for a stop").message};
      continue;
    }
    if (Status status = link_.write(map_.unit_of(operation, axis), function_for(requests[i].size()),
                                    map_.address_of(step, operation, axis), requests[i]);
        !status) {
      return Error{status.error().kind,
                   axis_error(axis, std::string(to_string(operation)) + ": " + status.error().message).message};
    }
  }
  return {};
}

Status ModbusTurntable::enable() {
  TRY(commissioned());
  for (const Axis axis : all_axes) {
    TRY(may_enable(axis));
    if (map_.once(DriveOperation::enable) && axis != Axis::roll) continue;  // all three were looked at
    commanded_off_ = false;
    memory_[index(axis)].drive_on.reset();
    if (Status status = write_list(axis, DriveOperation::enable, {}); !status) return status;
  }
  for (AxisMemory& memory : memory_) memory.drive_on.reset();
  enable_called_ = true;
  return {};
}

Status ModbusTurntable::home() {
  if (Status status = commissioned(); !status && !map_.home_by_encoder) return status;
  for (const Axis axis : all_axes)
    if (const Result<AxisStatus> now = ready(axis); !now) return now.error();
  for (const Axis axis : all_axes) {
    AxisMemory& memory = memory_[index(axis)];
    memory.homing_began(!map_.home_by_encoder);
    if (map_.home_by_encoder || !is_due(DriveOperation::home, axis)) continue;
    targets_void_ = true;
    if (Status status = write_list(axis, DriveOperation::home, {}); !status) return status;
  }
  return {};
}

Status ModbusTurntable::move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) {
  const AxisStatus now = TRY(ready_to_move(axis, position_deg, rate_degps, acceleration_degps2));
  memory_[index(axis)].arrived_seen = false;
  Moves moves = moves_;
  for (const Axis other : all_axes) {
    if (!map_.once(DriveOperation::move) || other == axis) continue;
    MoveNumbers& kept = moves[index(other)];
    kept.distance_deg = 0.0;
    if (!targets_void_) continue;
    // A table that takes all three angles at once must not go on with a motion that was stopped.
    const AxisStatus there = TRY(status(other));
    kept = {there.position_deg, 0.0, rate_degps, acceleration_degps2};
  }
  moves[index(axis)] = {position_deg, position_deg - now.position_deg, rate_degps, acceleration_degps2};
  const Status written = write_list(axis, DriveOperation::move, moves);
  if (written) {
    moves_ = moves;
    targets_void_ = false;
  }
  if (written || written.error().kind == ErrorKind::aborted || link_.lost()) return written;
  return with_state(written.error(), status(axis));
}

Status ModbusTurntable::halt(bool off) {
  if (!was_connected_) return table_error("not connected");
  stop_.handled();
  if (!link_.is_open()) {
    enable_called_ = false;  // whoever comes back finds it not ready
    TRY(link_.open());
  }
  targets_void_ = true;
  const bool one = !map_.once(off ? DriveOperation::abort : DriveOperation::stop);
  const auto operation_of = [&](Axis axis) {
    return off || is_off(axis, one) ? DriveOperation::abort : DriveOperation::stop;
  };
  const auto send = [&](Axis axis, const WriteStep& step, bool at_once) -> Status {
    const Result<std::vector<std::uint16_t>> words = words_of(map_, step, axis, {});
    if (!words) return axis_error(axis, words.error().message);
    const int function = function_for(words->size());
    const int unit = map_.unit_of(operation_of(axis), axis);
    const int address = map_.address_of(step, operation_of(axis), axis);
    const Status status = at_once ? link_.write_at_once(unit, function, address, *words, stop_ack_s)
                                  : link_.write(unit, function, address, *words);
    if (status) return {};
    return Error{status.error().kind,
                 axis_error(axis, std::string(to_string(operation_of(axis))) + ": " + status.error().message).message};
  };
  // Step by step, each to every axis: what follows the first step of one axis must not keep it from the next.
  std::array<bool, 3> taken{true, true, true};
  for (std::size_t i = 0, more = 1; more != 0; ++i) {
    more = 0;
    double wait_s = 0.0;
    for (const Axis axis : all_axes) {
      const WriteList& list = map_.list(operation_of(axis));
      if (i >= list.size() || !is_due(operation_of(axis), axis)) continue;
      more += i + 1 < list.size() ? 1 : 0;
      if (list[i].operands.empty()) {
        wait_s = std::max(wait_s, list[i].wait_s);
      } else if (taken[index(axis)]) {
        taken[index(axis)] = send(axis, list[i], true).ok();
      }
    }
    hold(wait_s);
  }
  Status first_failure;
  for (const Axis axis : all_axes) {
    if (taken[index(axis)] || !is_due(operation_of(axis), axis)) continue;
    Status status;
    for (const WriteStep& step : map_.list(operation_of(axis))) {
      if (!status) break;
      status = step.operands.empty() ? Status() : send(axis, step, false);
      if (step.operands.empty()) hold(step.wait_s);
    }
    if (!status && first_failure.ok()) first_failure = status;
  }
  return first_failure;
}

Status ModbusTurntable::clear_fault() {
  for (const Axis axis : all_axes) {
    const AxisStatus now = TRY(status(axis));
    if (!is_due(DriveOperation::clear_fault, axis)) continue;
    if (Status status = write_list(axis, DriveOperation::clear_fault, {}); !status) return status;
  }
  return {};
}

}  // namespace turncal
