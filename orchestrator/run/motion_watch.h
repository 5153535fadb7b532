// Judges whether the table moves as commanded. Pure functions of readings and of the unit's rates, for a run and for commissioning; both stop
// the table at the first poll that shows otherwise.
//
//   ArrivalMonitor  when a move has arrived, and has settled
//   stray_axis      an axis that was not sent stays where it stood, the one that was sent stays on its way
//   SpeedWatch      no axis exceeds its max_rate or 1.2 times the rate that was sent: by its rate, by its positions and by what the unit
//                   measures; nor 1.2 times the acceleration that was sent; nor does it turn further than it reads
//   HomingWatch     axes that search their zero find it
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

// Tolerance of comparisons of times, so that 0.1 + 0.2 is not later than 0.3.
inline constexpr double time_slack_s = 1e-6;

// Decides when a move has arrived. The device's "done" is not trusted: it can be set before the motion starts, flicker, come late, or be set
// after a stop. A move has arrived when all of this holds:
//   - motion was seen (position, rate or moving flag), or three polls have passed since the acknowledged command;
//   - the axis says in position and not moving, and no axis moves;
//   - abs(position - target) <= position_tolerance_deg; positions are cumulative, so whole turns are told apart;
//   - abs(rate) <= settle_rate_degps;
// It has settled when that has held at every poll for settle_s. All of it has to be over by
//   angle/rate + 2 rate/acceleration + deadline_margin_s,
// and outside the tolerance the axis has to come nearer within each stall_s. The caller first checks faults, limits and emergency stop.
// Without a move, settle_only() waits until every axis has been at rest for settle_s, wherever it stands.
class ArrivalMonitor {
 public:
  explicit ArrivalMonitor(const MotionConfig& config) : config_(config) {}

  // The command was acknowledged at now_s, with the axis at from_deg.
  void start_move(const Move& move, double from_deg, double now_s);
  void settle_only(double now_s);

  // Takes one poll. Returns arrived, unsettled, settled, stall, deadline, or nothing when nothing is new.
  std::optional<RunEvent> update(const TableStatus& status, double now_s);

  // Returns the best time of the next poll: the earliest moment at which the motion, or the settle time, can be over. Until then
  // the poll interval decides.
  double moment_of_interest_s(double now_s) const;
  double allowed_s() const { return at_.deadline_s - at_.started_s; }  // for move and settling
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

// A distance larger than any overshoot or slip of a knocked axis. Beyond it the position is not corrected by a move.
inline double least_runaway_deg(double position_tolerance_deg) { return std::max(1.0, position_tolerance_deg); }

// Returns a message when an axis is astray. held_deg: where the axes stood before the move, if there is one, was sent. standing_deg: how far
// from there an axis that was not sent may read.
std::optional<std::string> stray_axis(const TableStatus& axes, const AxisTriple& held_deg,
                                      const std::optional<Move>& move, double standing_deg,
                                      double position_tolerance_deg);

// The rate at which a unit turns: the norm of its gyro vector, whatever its mounting, in blocks of 10 ms and as the median of five, which
// removes glitches. Time is the unit's own. deg/s by the nominal scale of its frame or, once two turns have agreed on it (end_turn), by the
// measured scale. Four times the mean reading at rest before the turn is subtracted: noise, bias and Earth rate.
// A sample that the unit flags counts as lost.
class FeltRate {
 public:
  explicit FeltRate(const RecordingInfo& info);
  void add(const ImuSample& sample);
  void begin_turn(double allowed_degps2);
  // Ends a turn by turned_deg on the table. Returns the largest rate in it, deg/s; empty when the turn does not determine the unit's scale.
  std::optional<double> end_turn(double turned_deg);
  bool confirmed() const { return confirmed_; }
  static constexpr double largest_scale = 1.7;  // largest angle by the nominal scale per angle turned
  std::optional<double> now_degps() const;      // empty until five blocks are complete since a gap
  // Returns how much more the rate changed, in the turn that ended, than the allowed acceleration a permits, deg/s: the largest
  // |w(t) - w(s)| - a (t - s). 0 while the scale is not confirmed, or when the unit did not feel the whole turn: samples lost without notice
  // look like a jump, too.
  double jump_degps() const { return jump_degps_; }
  // Returns a lower bound of the angle felt in the turn that ended, deg: without the reading at rest, and by largest_scale while the
  // scale is not confirmed.
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
  std::size_t known_ = 0;  // valid ones
  double median_degps_ = 0.0;
  double way_deg_ = 0.0, way_s_ = 0.0, peak_degps_ = 0.0, rest_degps_ = 0.0, up_degps_ = 0.0, down_degps_ = 0.0,
         beyond_degps_ = 0.0;
  double allowed_degps2_ = 0.0, jump_degps_ = 0.0, least_way_deg_ = 0.0;
  double scale_ = 1.0, ratio_ = 0.0;
  bool confirmed_ = false, turning_ = false;  // turning_: from begin_turn to end_turn
};

// Judges how fast the axes turn, poll by poll. Returns one line about an axis that is too fast, or nothing.
//
// The rate, where the device reports one (AxisStatus::rate_told). The positions: over all readings s < t the largest
//   |p(t) - p(s)| - allowed (t - s),  timed by the answers; a fault beyond 0.1 deg plus what stale_s at the allowed rate turns.
// The delay of the first answer is allowed for once, so a slow line neither causes a fault nor hides one; a position that is refreshed
// only several times a second causes none either. The unit: the least rate of the units whose scale is confirmed; first_step_check.h judges
// the first turn. The acceleration is judged when the turn is over.
class SpeedWatch {
 public:
  SpeedWatch(const std::array<AxisLimits, 3>& limits, double speed_up) : limits_(limits), speed_up_(speed_up) {}
  // Starts anew when an axis is sent. axes: the last reading before that.
  void restart(const TableStatus& axes, double asked_s, double answered_s);
  // asked_s, answered_s: station time around the reading of all axes. sent: the present move. searches: the axes search their zero.
  std::optional<std::string> add(const TableStatus& axes, double asked_s, double answered_s,
                                 const std::optional<Move>& sent, bool searches);
  // felt: one for each unit that is still in the run.
  std::optional<std::string> add_felt(const std::vector<const FeltRate*>& felt, const TableStatus& axes,
                                      const std::optional<Move>& sent, bool searches) const;
  // Judges a finished move: whether it was sped up too quickly, or turned further than the table read.
  static std::optional<std::string> judge_turn(const std::vector<const FeltRate*>& felt, const Move& move,
                                               double turned_deg);

  static constexpr double factor = 1.2;
  static constexpr int zeros = 2;          // how often a search may set an angle anew
  static constexpr double stale_s = 0.25;  // wall time, for a table that refreshes its position four times a second
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
  // Cumulative sums for both directions, and when they began.
  struct Excess {
    double deg = -std::numeric_limits<double>::infinity(), since_s = 0.0;
  };
  struct Beyond {
    Excess up, down;
    int set_anew = 0;
  };
  std::array<Beyond, 3> beyond_{};
};

// Judges the search for zero. The angle turned counts by the rate and by the positions, whichever gives more: the position may be set anew
// on the way, and a rate may be missing. An axis may turn by twice its travel, or by its travel and one turn if that is less.
// A drive that does not begin is reported early, not at the deadline of the whole search.
class HomingWatch {
 public:
  explicit HomingWatch(const std::array<AxisLimits, 3>& limits) : limits_(limits) {}
  // Returns a message when an axis has turned further, or does not begin.
  std::optional<std::string> add(const TableStatus& axes);

 private:
  std::array<AxisLimits, 3> limits_;
  AxisTriple turned_deg_{};
  double idle_s_ = 0.0;  // time since any axis turned
  std::optional<TableStatus> before_;
};

}  // namespace turncal
