// Does the table move as commanded? Pure functions of readings and of the unit's rates, for a run and for commissioning; both stop the table
// at the first poll that shows that it does not.
//
//   ArrivalMonitor  when a move has arrived, and has settled
//   stray_axis   an axis that nothing sent stays where it stood, the one that was sent on its way
//   SpeedWatch   no axis turns faster than 1.2 times the rate that was sent, nor than its max_rate, by its rate, by its positions and by
//                what the unit measures; nor is it accelerated by more than 1.2 times what was sent, nor turned further than it reads
//   HomingWatch  axes that look for their zero find it
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "orchestrator/run/run_state_machine.h"
#include "orchestrator/station/station_config.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

// Comparisons of times allow this much, so that 0.1 + 0.2 is not later than 0.3.
inline constexpr double time_slack_s = 1e-6;

// "Done" is not trusted: it can be set before the motion starts, flicker, come late, or be set after a stop. A move has arrived
// when all of this holds:
//   - motion was seen (position, rate or moving flag), or three polls have passed since the acknowledged command;
//   - the axis says in position and not moving, and no axis moves;
//   - abs(position - target) <= position_tolerance_deg; positions are cumulative, so whole turns are told apart;
//   - abs(rate) <= settle_rate_degps;
// and it has settled when that has held at every poll for settle_s. The whole has to be over by
//   angle/rate + 2 rate/acceleration + deadline_margin_s,
// and outside the tolerance the axis has to come nearer within each stall_s. Faults, limits and emergency stop are the caller's to see first.
// Without a move, settle_only() waits until every axis has been at rest for settle_s, wherever it stands.
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
  double allowed_s() const { return at_.deadline_s - at_.started_s; }  // for the whole, settling included
  const std::optional<Move>& move() const { return at_.move; }
  double from_deg() const { return at_.from_deg; }  // of the move's axis

 private:
  bool holds(const TableStatus& status) const;

  MotionConfig config_;
  struct Progress {
    std::optional<Move> move{};  // empty: settle_only
    double from_deg = 0.0, started_s = 0.0, expected_end_s = 0.0, deadline_s = 0.0;
    double best_distance_deg = 0.0, last_progress_s = 0.0;
    int polls = 0;
    bool motion_seen = false;
    std::optional<double> arrived_s{};
  };
  Progress at_;
};

// More than any overshoot of a move, or the slip of an axis that is knocked: beyond it no move corrects it.
inline double least_runaway_deg(double position_tolerance_deg) { return std::max(1.0, position_tolerance_deg); }

// What is said of it; nothing: all is well. held_deg: where the axes stood when the move, if there is one, was sent. standing_deg: how far
// from there an axis may read that was not sent.
std::optional<std::string> stray_axis(const TableStatus& axes, const AxisTriple& held_deg,
                                      const std::optional<Move>& move, double standing_deg,
                                      double position_tolerance_deg);

// How fast a unit turns: the magnitude of its gyros' vector, whatever its mounting, by blocks of 10 ms and as the median of five, so that
// a glitch is none. Time is the unit's own. deg/s by the nominal scale of its frame; where two turns have told alike what the unit makes of a
// degree (end_turn), by that. Four times its mean reading at rest before the turn is subtracted: noise, bias and the earth's rate.
// A sample that the unit flags counts as lost.
class FeltRate {
 public:
  explicit FeltRate(const RecordingInfo& info);
  void add(const ImuSample& sample);
  void begin_turn(double allowed_degps2);
  // The table turned by so much since then. Returns the largest rate measured meanwhile, deg/s; nothing: the unit's scale does not follow from it.
  std::optional<double> end_turn(double turned_deg);
  bool confirmed() const { return confirmed_; }
  static constexpr double largest_scale = 1.7;  // of what a unit's pulse may weigh, to its nominal weight
  std::optional<double> now_degps() const;      // nothing: no block is whole since a gap
  // How much faster, or slower, it became in the turn that ended than the allowed acceleration makes it, deg/s: the largest
  // |w(t) - w(s)| - a (t - s). 0 where the unit did not feel the way that the table turned: samples that it lost without saying so are a
  // jump, too.
  double jump_degps() const { return jump_degps_; }
  // Least angle of the turn that ended, deg: where the unit's scale is not known, by the largest one, and without what it
  // feels at rest.
  double least_way_deg() const { return least_way_deg_; }

 private:
  static constexpr std::size_t blocks = 5;
  void close_block();
  double degrees_per_count_, period_s_;
  std::int64_t block_samples_;
  std::optional<std::int64_t> next_counter_;
  std::array<double, 3> sum_{};
  std::int64_t in_block_ = 0;
  std::array<double, blocks> last_degps_{};
  std::size_t known_ = 0;  // of them
  double median_degps_ = 0.0;
  double way_deg_ = 0.0, way_s_ = 0.0, peak_degps_ = 0.0, rest_degps_ = 0.0, up_degps_ = 0.0, down_degps_ = 0.0,
         beyond_degps_ = 0.0;
  double allowed_degps2_ = 0.0, jump_degps_ = 0.0, least_way_deg_ = 0.0;
  double scale_ = 1.0, ratio_ = 0.0;
  bool confirmed_ = false, turning_ = false;  // the latter from begin_turn to end_turn
};

// How fast the axes turn, poll after poll. What is said of one that is too fast is one line; nothing: all is well.
//
// By its rate: where the device tells one (AxisStatus::rate_told). By its positions: of all readings s < t the largest
//   |p(t) - p(s)| - allowed (t - s),  a fault beyond the way of stale_s at the allowed rate and 0.1 deg,
// by their answers. A reading is as old as its answer is late, which counts once, where a change begins, so that a slow line is no fault and
// hides none; a position that is found anew only several times a second is none either. By the unit: the least of those on the table whose
// scale is known; that of the first turn is for first_step_check.h to judge. How it was sped up is judged when the turn is over.
class SpeedWatch {
 public:
  SpeedWatch(const std::array<AxisLimits, 3>& limits, double speed_up) : limits_(limits), speed_up_(speed_up) {}
  // An axis is sent; the axes were read like this before.
  void restart(const TableStatus& axes, double asked_s, double answered_s);
  // asked_s, answered_s: station time around the reading of all axes. sent: the move that goes on. searches: the axes look for their zero.
  std::optional<std::string> add(const TableStatus& axes, double asked_s, double answered_s,
                                 const std::optional<Move>& sent, bool searches);
  // felt: of each unit that is alive.
  std::optional<std::string> add_felt(const std::vector<const FeltRate*>& felt, const TableStatus& axes,
                                      const std::optional<Move>& sent, bool searches) const;
  // Of a move that is over: sped up too quickly, or further than the table read.
  static std::optional<std::string> judge_turn(const std::vector<const FeltRate*>& felt, const Move& move,
                                               double turned_deg);

  static constexpr double factor = 1.2;
  static constexpr int zeros = 2;          // so often a search may set an angle anew
  static constexpr double stale_s = 0.25;  // wall time: a table that finds its position four times a second
  static double rate_margin_degps(double allowed_degps) { return std::max(0.5, 0.05 * allowed_degps); }
  static double felt_margin_degps(double allowed_degps) { return 1.0 + 0.05 * allowed_degps; }
  static double jump_margin_degps(double rate_degps) { return 1.0 + 0.25 * rate_degps; }
  static double way_margin_deg(double turned_deg) { return 2.0 + 0.1 * std::abs(turned_deg); }

 private:
  double allowed_degps(Axis axis, const std::optional<Move>& sent, bool searches) const;
  std::string too_fast(Axis axis, double degps, const char* by, const std::optional<Move>& sent) const;

  std::array<AxisLimits, 3> limits_;
  double speed_up_;
  struct Reading {
    AxisTriple at_deg;
    double asked_s = 0.0, answered_s = 0.0;
  };
  std::optional<Reading> before_;
  // Cumulative sums, for either way, and since when.
  struct Excess {
    double deg = -std::numeric_limits<double>::infinity(), since_s = 0.0;
  };
  struct Beyond {
    Excess up, down;
    int set_anew = 0;
  };
  std::array<Beyond, 3> beyond_{};
};

// Whether the axes look for their zero. How far each turns meanwhile counts by its rate and by its angle, whichever says more: the angle may be
// set anew on the way, and a rate may not be told. A search goes there and back within its travel, and needs no more than a turn beyond it.
// A drive that was told to, and has not begun, is not waited for until the whole search should be over.
class HomingWatch {
 public:
  explicit HomingWatch(const std::array<AxisLimits, 3>& limits) : limits_(limits) {}
  // What is said of an axis that has turned further, or does not begin; nothing: all is well.
  std::optional<std::string> add(const TableStatus& axes);

 private:
  std::array<AxisLimits, 3> limits_;
  AxisTriple turned_deg_{};
  double idle_s_ = 0.0;  // since any of them turned
  std::optional<TableStatus> before_;
};

}  // namespace turncal
