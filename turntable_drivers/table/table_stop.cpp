#include "turntable_drivers/table/table_stop.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr double longest_reconnect_wait_s = 5.0;
constexpr double same_place_deg = 0.01;  // the last digits of an encoder fluctuate

bool drives_on(const TableStatus& axes) {
  return std::ranges::any_of(axes, [](const AxisStatus& axis) { return axis.drive_on; });
}

}  // namespace

void TableStop::begin(double now_s, double brake_s) {
  brake_s_ = brake_s;
  brakes_until_s_ = now_s + brake_s;
  abort_taken_ = false;
  stands_.reset();
  repeat_at_s_ = reconnect_at_s_ = 0.0;
  reconnect_wait_s_ = repeat_s;
  reached_again_ = false;
  unreached_.clear();
  seen_.reset();
}

Status TableStop::stop(double now_s) {
  brakes_until_s_ = now_s + brake_s_;
  const Status stopped = table_.stop_all();
  if (!stopped) static_cast<void>(abort(now_s).ok());
  return stopped;
}

Status TableStop::abort(double now_s) {
  repeat_at_s_ = now_s + repeat_s;
  brakes_until_s_ = now_s;
  const Status aborted = table_.abort_all();
  abort_taken_ = abort_taken_ || aborted.ok();
  return aborted;
}

TableStop::Motion TableStop::motion(const TableStatus& axes) const {
  bool long_enough = stands_.has_value();
  for (std::size_t i = 0; i < axes.size(); ++i) {
    if (axes[i].moving || !(std::abs(axes[i].rate_degps) <= standing_rate_degps_)) return Motion::moves;
    if (!stands_) continue;
    const AxisStatus& since = (*stands_)[i];
    const double stood_s = axes[i].time_s - since.time_s, may_deg = standing_rate_degps_ * stood_s;
    if (!(std::abs(axes[i].position_deg - since.position_deg) <= std::max(same_place_deg, may_deg)))
      return Motion::moves;
    long_enough = long_enough && stood_s >= stand_s;
  }
  return long_enough ? Motion::stands : Motion::not_seen;
}

bool TableStop::look(const TableStatus* axes, double now_s) {
  const Motion seen = axes != nullptr ? motion(*axes) : Motion::moves;
  seen_ = axes != nullptr ? std::optional(seen) : std::nullopt;
  if (axes == nullptr)
    stands_.reset();
  else if (seen == Motion::moves || !stands_)
    stands_ = *axes;
  if (seen == Motion::stands) {
    if (drives_on(*axes) ? abort_taken_ && !table_.can_switch_off() : !table_.was_switched_on()) return true;
  } else if (axes != nullptr && now_s < brakes_until_s_) {
    return false;
  }
  // Success is judged by what the axes do.
  if (now_s >= repeat_at_s_) static_cast<void>(abort(now_s).ok());
  if (axes == nullptr && !table_.answers()) reconnect(now_s);
  return false;
}

void TableStop::reconnect(double now_s) {
  if (now_s < reconnect_at_s_) return;
  reconnect_at_s_ = now_s + reconnect_wait_s_;
  reconnect_wait_s_ = std::min(2.0 * reconnect_wait_s_, longest_reconnect_wait_s);
  const Status connected = table_.connect();
  reached_again_ = connected.ok();
  unreached_ = connected ? "" : connected.error().message;
  if (!connected) return;
  // No fastest stop was taken while the link was down, so a braking stop is tried again.
  if (!abort_taken_) static_cast<void>(stop(now_s).ok());
}

std::string TableStop::not_verified(const std::string& unread) const {
  const std::string why = seen_ == Motion::stands ? "the drives do not go off"
                          : seen_                 ? "the table does not come to rest"
                          : !unreached_.empty()   ? "the link could not be opened again: " + unreached_
                          : reached_again_        ? "the link was opened again, and the table does not answer"
                                                  : unread;
  return "THE STOP COULD NOT BE VERIFIED, the table may still move, its drives may be on" +
         (why.empty() ? "" : ": " + why);
}

std::string how_it_rests(const Turntable& table) {
  if (!table.can_switch_off()) return "the table rests; its drives cannot be switched off from here";
  return table.tells_drives()
             ? "the table rests, its drives are off"
             : "the table rests; its drives were told to go off, and it does not tell whether they are";
}

Status leave_off(Turntable& table, const StopTime& time) {
  if (table.needs_operator() || !table.was_connected()) return {};
  TableStop stop(table, time.standing_rate_degps);
  const double began_s = time.now_s();
  stop.begin(began_s, time.brake_s);
  bool stop_sent = false;
  std::optional<Error> unread;  // the first reason why nothing can be read
  for (;;) {
    TableStatus axes{};
    bool readable = true, given_up = false;
    for (const Axis axis : all_axes) {
      Result<AxisStatus> now = table.status(axis);
      if (!now) {
        readable = false;
        // A driver that gave up a reading because of a stop request can read again once a stop was sent.
        given_up = now.error().kind == ErrorKind::aborted || now.error().kind == ErrorKind::interrupted;
        if (!given_up && !unread) unread = now.error();
        break;
      }
      axes[index(axis)] = std::move(*now);
    }
    const double now_s = time.now_s();
    if (readable) unread.reset();
    const bool moves = readable && stop.motion(axes) == TableStop::Motion::moves;
    if (!stop_sent && (given_up || moves)) {
      stop_sent = true;
      static_cast<void>(stop.stop(now_s).ok());
    } else if (stop.look(readable ? &axes : nullptr, now_s)) {
      return {};
    }
    if (now_s - began_s > time.deadline_s) break;
    time.wait(time.poll_s);
  }
  return device_error(stop.not_verified(unread ? unread->message : ""));
}

}  // namespace turncal
