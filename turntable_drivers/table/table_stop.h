// How a table is left: at rest, every drive off, and both read back. One rule for a run that stops, a command that is over and a
// program that unwinds.
//
//   stop      the braking stop to every axis; the fastest where one does not take it, or the table still turns when it should have braked
//   off       once every axis reads at rest: the fastest stop, drives off
//   verified  every axis reads at rest, and its drive off by the drive's own word (not where the device cannot switch it off), after the order to go
//             off was taken: whoever switched drives on sends it, whatever they say of themselves
//
// At rest: no axis says that it moves or turns, and every one has read the same place for stand_s. A drive's own word alone is not believed,
// nor a position that is read anew faster than the device finds a new one.
//
// What cannot be read is not waited for: the fastest stop goes out to every axis at once and again every repeat_s, with attempts to open
// a link anew that is lost in between, for as long as the caller goes on. It is repeated likewise while a drive that was told reads on.
// A motion is never taken up again.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "turntable_drivers/table/turntable.h"

namespace turncal {

class TableStop {
 public:
  // The table must outlive this. Faster than that is no rest.
  TableStop(Turntable& table, double standing_rate_degps) : table_(table), standing_rate_degps_(standing_rate_degps) {}

  // Of another stop: what was sent before does not count. brake_s: so long may a stop that was taken last.
  void begin(double now_s, double brake_s);
  Status stop(double now_s);   // an error: some axis did not take it; then abort() went out
  Status abort(double now_s);  // an error: some axis did not take it
  // What was read just now; null: some axis could not be. True: verified.
  bool look(const TableStatus* axes, double now_s);
  enum class Motion { not_seen, moves, stands };
  Motion motion(const TableStatus& axes) const;  // compared with the looks before
  // One line for a table that was not verified: how it may be, and why. `unread`: the first reason why nothing could be read.
  std::string not_verified(const std::string& unread) const;

  static constexpr double repeat_s = 0.5;
  static constexpr double stand_s = 0.5;

 private:
  void reconnect(double now_s);

  Turntable& table_;
  double standing_rate_degps_;
  bool abort_taken_ = false;           // by every axis
  std::optional<TableStatus> stands_;  // since then
  double brake_s_ = 0.0;
  double brakes_until_s_ = 0.0;
  double repeat_at_s_ = 0.0;
  double reconnect_at_s_ = 0.0;
  double reconnect_wait_s_ = repeat_s;
  bool reached_again_ = false;
  std::string unreached_;       // why the last attempt to open the link anew failed
  std::optional<Motion> seen_;  // at the last look; none: some axis could not be read
};

// The time that a stop may take, on the caller's clock, and how that passes.
struct StopTime {
  std::function<double()> now_s;
  std::function<void(double seconds)> wait;
  double brake_s = 3.0;      // then the fastest stop, though it still moves
  double deadline_s = 10.0;  // in all
  double poll_s = 0.05;
  double standing_rate_degps = 0.02;
};

// How a table is left whose stop was verified.
std::string how_it_rests(const Turntable& table);

// Carries the rule out from wherever the table is. Nothing is sent to a table that was not switched on from here and whose axes all read at rest
// with their drives off.
// An error: it could not be verified.
Status leave_off(Turntable& table, const StopTime& time);

}  // namespace turncal
