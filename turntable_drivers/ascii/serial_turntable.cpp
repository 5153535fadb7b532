#include "turntable_drivers/ascii/serial_turntable.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {
namespace {

constexpr double longest_leg = 0.45;  // of a circle
constexpr double leg_done_deg = 0.5;  // near enough for the next, which is told as an angle and not as a distance

int lines_of(const Exchange& exchange) { return exchange.expect ? exchange.expect->lines() : 0; }

}  // namespace

SerialTurntable::SerialTurntable(Dialect dialect, const Clock& clock, const std::atomic<int>* stop_requests)
    : DescribedTurntable(dialect, clock, stop_requests), dialect_(std::move(dialect)), line_(dialect_.link, stop_) {}

// ---- exchanges ----

Result<SerialTurntable::Values> SerialTurntable::talk(const Exchange& exchange, Axis axis, const Moves& moves) {
  const std::string body = filled(dialect_, exchange.send, axis, moves);
  const Result<std::string> answer = line_.exchange(body, lines_of(exchange));
  const auto about = [&](const std::string& what) { return axis_error(axis, "'" + visible(body) + "': " + what); };
  if (!answer) return Error{answer.error().kind, about(answer.error().message).message};
  for (const std::string& text : dialect_.errors) {
    if (answer->find(text) != std::string::npos) return about("the device says '" + visible(*answer) + "'");
  }
  if (!exchange.expect) {
    if (!answer->empty()) return about("answer '" + visible(*answer) + "': expected none");
    return Values();
  }
  const std::optional<Values> values = exchange.expect->match(*answer);
  if (!values) return about("answer '" + visible(*answer) + "': expected '" + visible(exchange.expect->text()) + "'");
  const auto named = values->find("axis");
  if (named != values->end() && named->second != dialect_.of(axis).name)
    return about("axis '" + named->second + "' answered");
  return *values;
}

Status SerialTurntable::carry_out(DialectOperation operation, Axis axis, const Moves& moves) {
  for (const Exchange& exchange : dialect_.of(operation).exchanges) {
    const Result<Values> values = talk(exchange, axis, moves);
    if (!values) return Error{values.error().kind, std::string(to_string(operation)) + ": " + values.error().message};
  }
  return {};
}

Status SerialTurntable::carry_out_for_all(DialectOperation operation) {
  for (const Axis axis : all_axes) {
    TRY(carry_out(operation, axis, moves_));
    if (!dialect_.of(operation).each_axis) break;
  }
  return {};
}

// ---- commands; reading: serial_reading.cpp ----

Status SerialTurntable::connect() {
  connected_ = false;
  lost_ = false;
  enable_called_ = false;
  memory_ = {};
  way_ = {};
  TRY(line_.open());
  Status status = carry_out_for_all(DialectOperation::prepare);
  for (const Axis axis : all_axes) {
    if (!status) break;
    const Result<Reading> reading = read(axis, true);
    if (!reading) {
      status = reading.error();
    } else {
      moves_[index(axis)] = {reading->position_deg};
    }
  }
  if (!status) {
    line_.close();
    return status;
  }
  connected_ = was_connected_ = true;
  return {};
}

Result<TableIdentity> SerialTurntable::identify() {
  TRY(connected());
  std::string description = dialect_.name + " at " + dialect_.link.address;
  for (const Exchange& exchange : dialect_.of(DialectOperation::identify).exchanges) {
    const std::string answer =
        TRY(line_.exchange(filled(dialect_, exchange.send, Axis::heading, moves_), lines_of(exchange)));
    description += ", " + visible(answer);
  }
  return TableIdentity{description + (dialect_.verified_on_hardware ? "" : ", dialect not verified on hardware"),
                       dialect_.simulated};
}

Status SerialTurntable::enable() {
  TRY(connected());
  TRY(commissioned());
  for (const Axis axis : all_axes) {
    TRY(may_enable(axis));
  }
  commanded_off_ = false;
  commanded_on_ = true;
  for (AxisMemory& memory : memory_) memory.drive_on.reset();
  TRY(carry_out_for_all(DialectOperation::enable));
  enable_called_ = true;
  return {};
}

Status SerialTurntable::home() {
  TRY(connected());
  TRY(commissioned());
  for (const Axis axis : all_axes)
    if (const Result<AxisStatus> now = ready(axis); !now) return now.error();
  way_ = {};
  for (AxisMemory& memory : memory_) memory.homing_began(true);
  targets_void_ = true;
  return carry_out_for_all(DialectOperation::home);
}

Status SerialTurntable::move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) {
  const Result<AxisStatus> now = ready_to_move(axis, position_deg, rate_degps, acceleration_degps2);
  if (!now) return now.error();
  // A table that takes all three angles at once must not go on with a motion that was stopped.
  if (targets_void_) {
    for (const Axis other : all_axes) {
      const AxisStatus there = TRY(other == axis ? now : status(other));
      moves_[index(other)].position_deg = there.position_deg;
    }
    targets_void_ = false;
  }
  way_[index(axis)].reset();
  if (dialect_.of(axis).shorter_way) {
    way_[index(axis)] = {position_deg, 0.0, rate_degps, acceleration_degps2};
    return send_leg(axis, now->position_deg);
  }
  return send_move(axis, {position_deg, position_deg - now->position_deg, rate_degps, acceleration_degps2});
}

Status SerialTurntable::send_leg(Axis axis, double from_deg) {
  // Taken away while it is sent: what goes wrong looks at the axis, and must not send another.
  const std::optional<MoveNumbers> way = std::exchange(way_[index(axis)], {});
  const double left_deg = way->position_deg - from_deg;
  const double legs = std::ceil(std::abs(left_deg) / (longest_leg * dialect_.of(axis).modulo_deg));
  MoveNumbers leg = *way;
  if (legs > 1.0) leg.position_deg = from_deg + left_deg / legs;
  leg.distance_deg = leg.position_deg - from_deg;
  TRY(send_move(axis, leg));
  if (legs > 1.0) way_[index(axis)] = way;
  return {};
}

// REQUIRES: the report is the axis's own reading.
Status SerialTurntable::go_on(Axis axis, AxisStatus& report) {
  std::optional<MoveNumbers>& way = way_[index(axis)];
  if (!way) return {};
  if (refusal_of_state(report) && !report.moving) way.reset();  // a fault, an emergency stop, a drive that is off
  if (!way) return {};
  const bool done = report.in_position && !report.moving &&
                    std::abs(report.position_deg - moves_[index(axis)].position_deg) <= leg_done_deg;
  report.in_position = false;
  report.moving = true;
  return done ? send_leg(axis, report.position_deg) : Status{};
}

Status SerialTurntable::send_move(Axis axis, const MoveNumbers& move) {
  Moves moves = moves_;
  for (MoveNumbers& other : moves) other.distance_deg = 0.0;
  moves[index(axis)] = move;
  if (Status status = check_sentences(dialect_, axis, moves); !status) return axis_error(axis, status.error().message);
  const Status sent = carry_out(DialectOperation::move, axis, moves);
  if (sent) {
    moves_ = moves;
    return {};
  }
  if (sent.error().kind == ErrorKind::aborted || !line_.is_open()) return sent;
  return with_state(sent.error(), status(axis));
}

Status SerialTurntable::halt(bool off) {
  if (!was_connected_) return table_error("not connected");
  way_ = {};
  const bool one = dialect_.of(off ? DialectOperation::abort : DialectOperation::stop).each_axis &&
                   dialect_.of(DialectOperation::abort).each_axis;
  const auto operation_of = [&](Axis axis) {
    return off || is_off(axis, one) ? DialectOperation::abort : DialectOperation::stop;
  };
  stop_.handled();
  if (!line_.is_open()) {
    enable_called_ = false;
    TRY(line_.open());
    lost_ = false;
  }
  // Sentence by sentence, each to every axis: what follows the first of one axis must not keep it from the next.
  std::array<bool, 3> taken{true, true, true};
  for (std::size_t i = 0, more = 1; more != 0; ++i) {
    more = 0;
    for (const Axis axis : all_axes) {
      const DialectSteps& steps = dialect_.of(operation_of(axis));
      if (i >= steps.exchanges.size() || (!steps.each_axis && axis != Axis::heading)) continue;
      more += i + 1 < steps.exchanges.size() ? 1 : 0;
      const Exchange& exchange = steps.exchanges[i];
      if (!line_.send_at_once(filled(dialect_, exchange.send, axis, moves_), exchange.expect, stop_ack_s))
        taken[index(axis)] = false;
    }
  }
  Status first_failure;
  for (const Axis axis : all_axes) {
    if (taken[index(axis)]) continue;
    if (Status status = carry_out(operation_of(axis), axis, moves_); !status && first_failure.ok())
      first_failure = status;
  }
  targets_void_ = true;
  if (off && first_failure) commanded_on_ = false;
  return first_failure;
}

Status SerialTurntable::clear_fault() {
  TRY(connected());
  return carry_out_for_all(DialectOperation::clear_fault);
}

}  // namespace turncal
