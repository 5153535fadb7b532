#include "turntable_drivers/manual/manual_turntable.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {

ManualTurntable::ManualTurntable(ManualSettings settings, const Clock& clock, int input, std::ostream& out,
                                 GravitySense sense)
    : settings_(settings),
      clock_(clock),
      input_(input),
      out_(out),
      sense_(std::move(sense)),
      texts_(OperatorTexts::of(settings_.language)) {}

void ManualTurntable::say(const std::string& text) {
  if (!lines_) return;
  for (std::string_view remaining = text; !remaining.empty();) out_ << next_line(remaining) << '\n';
  out_ << std::flush;
}

void ManualTurntable::note(const std::string& text, bool wrong) {
  note_ = text;
  wrong_ = wrong;
  say(text);
  tell_changed();
}

double ManualTurntable::patience_s() const { return rehearsed_ ? monotonic_s() : clock_.now_s(); }

Status ManualTurntable::usable() {
  if (!connected_) return device_error("manual table: not connected");
  look_at_input();
  const bool ends_now = end_ && (end_->kind == ErrorKind::aborted || !queue_.empty());
  return ends_now && !stopped_ ? Status(*end_) : Status{};
}

void ManualTurntable::end(ErrorKind kind, const std::string& why) {
  if (!end_) end_ = Error{kind, "manual table: " + why};
}

std::optional<ManualTurntable::Wanted> ManualTurntable::wanted() const {
  if (queue_.empty()) return {};
  return queue_.front();
}

OperatorTask ManualTurntable::task() const {
  OperatorTask task;
  task.note = note_;
  task.wrong = wrong_;
  task.answers = answers_;
  if (end_ || queue_.empty()) return task;
  const Wanted& now = queue_.front();
  using enum OperatorTask::Kind;
  task.kind = paused_ ? paused : answered_ ? compare : now.homing ? where : turn;
  task.axis = now.axis;
  if (hands_[index(now.axis)].known) task.from_deg = hands_[index(now.axis)].position_deg;
  task.target_deg = now.target_deg;
  return task;
}

// ---- the interface; what is said in between: manual_dialogue.cpp ----

Status ManualTurntable::connect() {
  connected_ = true;
  enabled_ = false;
  stopped_ = false;
  paused_ = false;
  queue_.clear();
  answered_.reset();
  return usable();
}

Result<TableIdentity> ManualTurntable::identify() {
  TRY(usable());
  return TableIdentity{"table turned by hand", rehearsed_.has_value()};
}

Status ManualTurntable::enable() {
  TRY(usable());
  enabled_ = true;
  return {};
}

Status ManualTurntable::home() {
  TRY(usable());
  if (end_) return *end_;
  if (!enabled_) return device_error("manual table: home: not enabled");
  if (!queue_.empty()) return device_error("manual table: home: a move is under way");
  stopped_ = false;
  for (const Axis axis : {Axis::roll, Axis::pitch, Axis::heading}) {
    hands_[index(axis)] = {};
    queue_.push_back({.axis = axis, .homing = true});
  }
  begin_question();
  return {};
}

Status ManualTurntable::move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) {
  TRY(usable());
  if (end_) return *end_;
  const auto refused = [&](const std::string& what) {
    return device_error(std::string("manual table: ") + to_string(axis) + ": " + what);
  };
  // Nobody turns by hand at a given rate, but what makes no sense is a mistake all the same.
  if (!std::isfinite(position_deg))
    return refused("move to " + format_number(position_deg) + " deg: expected an angle");
  if (!(rate_degps > 0.0) || !std::isfinite(rate_degps) || !(acceleration_degps2 > 0.0) ||
      !std::isfinite(acceleration_degps2)) {
    return refused("rate and acceleration: expected numbers above 0");
  }
  if (!enabled_) return refused("not enabled");
  if (!hands_[index(axis)].homed) return refused("not homed");
  for (const Wanted& wanted : queue_) {
    if (wanted.axis == axis) return refused("a move is under way: expected it finished or stopped");
  }
  stopped_ = false;
  queue_.push_back({axis, position_deg, false, rate_degps, acceleration_degps2});
  asked_s_ = patience_s();
  if (queue_.size() == 1) begin_question();
  return {};
}

Status ManualTurntable::stop_all() {
  if (!connected_) return device_error("manual table: not connected");
  if (!queue_.empty()) {
    for (const Wanted& wanted : queue_) hands_[index(wanted.axis)].known = false;
    queue_.clear();
    answered_.reset();
    note(texts_.say("said.stop"), false);
  }
  if (rehearsed_) rehearsed_->stop();
  paused_ = false;
  stopped_ = true;
  return {};  // also when the operator is gone: nothing turns by itself
}

Status ManualTurntable::abort_all() {
  const Status status = stop_all();
  enabled_ = false;
  return status;
}

Status ManualTurntable::clear_fault() { return usable(); }

Result<AxisStatus> ManualTurntable::status(Axis axis) {
  TRY(usable());
  const Hand& hand = hands_[index(axis)];
  AxisStatus report;
  report.position_deg = hand.position_deg;
  report.moving =
      std::any_of(queue_.begin(), queue_.end(), [axis](const Wanted& wanted) { return wanted.axis == axis; });
  report.rate_degps = report.moving ? std::numeric_limits<double>::quiet_NaN() : 0.0;
  report.enabled = report.drive_on = enabled_;
  report.homed = hand.homed;
  report.in_position = hand.known && !report.moving;
  report.remote = true;
  report.time_s = clock_.now_s();
  if (paused_) report.text = "paused";
  return report;
}

}  // namespace turncal
