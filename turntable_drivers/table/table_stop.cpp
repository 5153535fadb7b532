#include "turntable_drivers/table/table_stop.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr double longest_reconnect_wait_s = 5.0;

bool drives_on(const TableStatus& axes) {
  return std::any_of(axes.begin(), axes.end(), [](const AxisStatus& axis) { return axis.drive_on; });
}

}  // namespace

void TableStop::begin() {
  abort_taken_ = false;
  repeat_at_s_ = reconnect_at_s_ = 0.0;
  reconnect_wait_s_ = repeat_s;
}

Status TableStop::stop(double now_s) {
  const Status stopped = table_.stop_all();
  return stopped ? stopped : abort(now_s);
}

Status TableStop::abort(double now_s) {
  repeat_at_s_ = now_s + repeat_s;
  const Status aborted = table_.abort_all();
  abort_taken_ = abort_taken_ || aborted.ok();
  return aborted;
}

bool TableStop::standing(const TableStatus& axes) const {
  return std::all_of(axes.begin(), axes.end(), [this](const AxisStatus& axis) {
    return !axis.moving && std::abs(axis.rate_degps) <= standing_rate_degps_;
  });
}

bool TableStop::look(const TableStatus* axes, double now_s) {
  if (axes != nullptr && standing(*axes)) {
    const bool on = drives_on(*axes);
    if (!on || (abort_taken_ && !table_.can_switch_off())) return true;
  } else if (axes != nullptr && !abort_taken_) {
    return false;  // it brakes
  }
  // Whether it is taken is judged by what the axes do.
  if (now_s >= repeat_at_s_) static_cast<void>(abort(now_s).ok());
  if (axes == nullptr) reconnect(now_s);
  return false;
}

void TableStop::reconnect(double now_s) {
  if (now_s < reconnect_at_s_) return;
  reconnect_at_s_ = now_s + reconnect_wait_s_;
  reconnect_wait_s_ = std::min(2.0 * reconnect_wait_s_, longest_reconnect_wait_s);
  if (!table_.connect()) return;
  // Nobody took the fastest stop while the link was down: it may still brake as it should.
  if (!abort_taken_) static_cast<void>(stop(now_s).ok());
}

Status leave_off(Turntable& table, const StopTime& time) {
  if (table.needs_operator() || !table.was_connected()) return {};
  TableStop stop(table, time.standing_rate_degps);
  const double began_s = time.now_s();
  bool stop_sent = false, abort_sent = false;
  Error why = device_error("the drives do not go off");
  for (;;) {
    TableStatus axes{};
    bool readable = true;
    for (const Axis axis : all_axes) {
      Result<AxisStatus> now = table.status(axis);
      if (!now) {
        readable = false;
        why = now.error();
        break;
      }
      axes[static_cast<std::size_t>(axis)] = std::move(*now);
    }
    const double now_s = time.now_s();
    const bool moves = std::any_of(axes.begin(), axes.end(), [&](const AxisStatus& axis) {
      return axis.moving || !(std::abs(axis.rate_degps) <= time.standing_rate_degps);
    });
    // A driver that gives a reading up for a stop that was asked for reads again once a stop went out.
    const bool given_up = !readable && (why.kind == ErrorKind::aborted || why.kind == ErrorKind::interrupted);
    if (!stop_sent && (given_up || (readable && moves))) {
      stop_sent = true;
      static_cast<void>(stop.stop(now_s).ok());
    } else if (stop.look(readable ? &axes : nullptr, now_s)) {
      return {};
    } else if (readable && moves && !abort_sent && now_s - began_s > time.brake_s) {
      abort_sent = true;
      static_cast<void>(stop.abort(now_s).ok());
    }
    if (now_s - began_s > time.deadline_s) break;
    time.wait(time.poll_s);
  }
  return device_error("THE STOP COULD NOT BE VERIFIED, the table may still move, its drives may be on: " + why.message);
}

}  // namespace turncal
