// When has a move arrived? Pure logic on the status words of the table; no I/O, no clock of its own.
//
// "Done" is not trusted: it can be set before the motion starts, flicker, come late, or be set after a stop. A move has arrived
// when all of this holds:
//   - motion was seen (position, rate or moving flag), or three polls have passed since the acknowledged command;
//   - the axis says in position and not moving, and no axis moves;
//   - abs(position - target) <= position_tolerance_deg; positions are cumulative, so whole turns are told apart;
//   - abs(rate) <= settle_rate_degps;
// and it has settled when that has held at every poll for settle_s. The whole has to be over by
//   angle/rate + 2 rate/acceleration + deadline_margin_s,
// and outside the tolerance the axis has to come nearer within each stall_s.
// Faults, limits and emergency stop are checked by the caller before it asks here.
//
// Also used without a move: settle_only() waits until every axis has been at rest for settle_s, wherever it stands.
// Units: degrees, deg/s, seconds on the station's clock.
#pragma once

#include <array>
#include <optional>

#include "calib/types/axis.h"
#include "orchestrator/run/run_state_machine.h"
#include "orchestrator/station/station_config.h"
#include "sequences/sequence.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

class ArrivalMonitor {
 public:
  explicit ArrivalMonitor(const MotionConfig& config) : config_(config) {}

  // The command was acknowledged at now_s, with the axis at from_deg.
  void start_move(const Move& move, double from_deg, double now_s);
  void settle_only(double now_s);

  // One poll. arrived, unsettled, settled, stall, deadline, or nothing new.
  std::optional<RunEvent> update(const TableStatus& status, double now_s);

  // The best time of the next poll: the earliest moment at which the motion, or the settle time, can be over. Before that
  // the poll interval decides.
  double moment_of_interest_s(double now_s) const;
  double allowed_s() const { return deadline_s_ - started_s_; }  // for the whole, settling included
  const std::optional<Move>& move() const { return move_; }
  double from_deg() const { return from_deg_; }  // of the move's axis

 private:
  bool holds(const TableStatus& status) const;

  MotionConfig config_;
  std::optional<Move> move_;  // empty: settle_only
  double from_deg_ = 0.0;
  double started_s_ = 0.0;
  double expected_end_s_ = 0.0;
  double deadline_s_ = 0.0;
  int polls_ = 0;
  bool motion_seen_ = false;
  std::optional<double> arrived_s_;
  double best_distance_deg_ = 0.0;
  double last_progress_s_ = 0.0;
};

// Comparisons of times allow this much, so that 0.1 + 0.2 is not later than 0.3.
inline constexpr double time_slack_s = 1e-6;

}  // namespace turncal
