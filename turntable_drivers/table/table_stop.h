// How a table is left: at rest and with every drive off, both confirmed by reading. One rule for a run that stops, a command that ends and
// a program that unwinds.
//
//   stop      braking stop to every axis; the fastest stop if one does not take it, or the table still moves after the braking time
//   off       fastest stop, drives off, once every axis reads at rest
//   verified  every axis reads at rest with its drive off by the drive's own report (unless the device cannot switch it off), and the order
//             to go off was acknowledged: whoever enabled drives sends it, whatever they report
//
// At rest: no axis reports moving or turns, and all have read the same position for stand_s. A drive's report alone is not enough,
// nor is a position that is read more often than the device updates it.
//
// An unreadable table is not waited for: the fastest stop goes to every axis at once and again every repeat_s, and a lost link is
// reopened meanwhile, for as long as the caller continues. It is also repeated while a drive still reads on.
// A motion is never resumed.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "turntable_drivers/table/turntable.h"

namespace turncal {

class TableStop {
 public:
  // The table must outlive this. A faster axis is not at rest.
  TableStop(Turntable& table, double standing_rate_degps) : table_(table), standing_rate_degps_(standing_rate_degps) {}

  // Begins another stop: what was sent before does not count. brake_s: braking time allowed after the last accepted stop.
  void begin(double now_s, double brake_s);
  Status stop(double now_s);   // an error: some axis did not take it, and abort() was sent
  Status abort(double now_s);  // an error: some axis did not take it
  // Takes the latest readings; null: some axis could not be read. True: verified.
  bool look(const TableStatus* axes, double now_s);
  enum class Motion { not_seen, moves, stands };
  Motion motion(const TableStatus& axes) const;  // compared with earlier readings
  // Returns one line on a table that was not verified: its possible state, and why. `unread`: the first reason why nothing could be read.
  std::string not_verified(const std::string& unread) const;

  static constexpr double repeat_s = 0.5;
  static constexpr double stand_s = 0.5;

 private:
  void reconnect(double now_s);

  Turntable& table_;
  double standing_rate_degps_;
  bool abort_taken_ = false;           // acknowledged by every axis
  std::optional<TableStatus> stands_;  // readings since which it stands
  double brake_s_ = 0.0;
  double brakes_until_s_ = 0.0;
  double repeat_at_s_ = 0.0;
  double reconnect_at_s_ = 0.0;
  double reconnect_wait_s_ = repeat_s;
  bool reached_again_ = false;
  std::string unreached_;       // why the last attempt to reopen the link failed
  std::optional<Motion> seen_;  // at the last look(); none: some axis could not be read
};

// The time limits of a stop on the caller's clock, and how to wait.
struct StopTime {
  std::function<double()> now_s;
  std::function<void(double seconds)> wait;
  double brake_s = 3.0;      // then the fastest stop, even if it still moves
  double deadline_s = 10.0;  // in total
  double poll_s = 0.05;
  double standing_rate_degps = 0.02;
};

// Returns how a table is left after a verified stop.
std::string how_it_rests(const Turntable& table);

// Leaves the table by this rule from any state. Nothing is sent to a table that was not enabled from here if all axes read at rest
// with their drives off.
// An error: it could not be verified.
Status leave_off(Turntable& table, const StopTime& time);

}  // namespace turncal
