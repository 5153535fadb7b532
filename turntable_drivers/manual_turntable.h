// ManualTurntable: the table is turned by hand. The operator is told which axis to turn to which angle and why, turns it, and types the
// angle reached.
//
// - A typed angle is taken when it lies within tolerance_deg of the one wanted (whole turns are understood: a dial shows 90 where
//   450 is meant) and when gravity, as the unit senses it, agrees with the tilt that follows (heading cannot be seen by it).
//   Anything else is answered and asked again. Nothing is ever assumed: no answer within answer_timeout_s pauses, and a pause
//   ends only when the operator types `continue`.
// - Besides an angle: `repeat` shows the question again, `skip REASON` gives the move up (a fault, which needs clear_fault()),
//   `pause`, `continue`, `abort`. The first letter will do.
// - The end of the input, and `abort`, are errors of every further call: the run stops. Nothing moves by itself, so that is safe; once
//   stop_all() was called status() answers again, so that the stop can be verified.
// - Several moves may be asked for at once; they are put to the operator one after another. Homing asks for 0 of all three axes.
// - After a stop in the middle of a turn the angle is not known: the axis is not in position until a move to somewhere is answered.
//
// Expected direction of gravity's reaction in the body, from C_nb = Ry(-H) Rz(P) Rx(R) and f_n = (0, g, 0):
//   f_b / g = (sin P, cos P cos R, -cos P sin R)
// Calls do not block: the input is looked at in status(). One thread.
#pragma once

#include <array>
#include <deque>
#include <functional>
#include <optional>
#include <ostream>
#include <string>

#include "imu_io/clock.h"
#include "turntable_drivers/turntable.h"

namespace turncal {

struct ManualSettings {
  double tolerance_deg = 0.1;
  double gravity_tolerance_deg = 2.0;
  double answer_timeout_s = 600.0;
};

// Mean specific force in body axes over the last second, any unit; empty: not known (no samples, or the unit moves).
using GravitySense = std::function<std::optional<std::array<double, 3>>()>;

class ManualTurntable : public Turntable {
 public:
  // `input` is a file descriptor (0: the terminal); clock and stream must outlive the table.
  ManualTurntable(ManualSettings settings, const Clock& clock, int input, std::ostream& out, GravitySense sense = {});

  Status connect() override;
  Result<TableIdentity> identify() override;
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status stop_all() override;
  Status abort_all() override;
  Status clear_fault() override;
  Result<AxisStatus> status(Axis axis) override;
  bool needs_operator() const override { return true; }

  // Why the next move is asked for: "step 3, of 14: rotate pitch".
  void set_reason(const std::string& reason) { reason_ = reason; }
  struct Wanted {
    Axis axis = Axis::heading;
    double target_deg = 0.0;
    std::string why;
  };
  std::optional<Wanted> wanted() const;  // what the operator is asked for now
  bool paused() const { return paused_; }
  const std::optional<std::string>& skipped() const { return skipped_; }  // the reason

 private:
  struct Hand {
    double position_deg = 0.0;
    bool known = false;  // an answer was taken, and no stop has interrupted a turn since
    bool homed = false;
  };
  Status usable();        // connected, input open, not aborted
  Status look_at_input();
  void answer(const std::string& line);
  void take_angle(const std::string& text);
  std::optional<std::string> gravity_objection(Axis axis, double angle_deg) const;
  void ask();
  void say(const std::string& text);

  ManualSettings settings_;
  const Clock& clock_;
  int input_;
  std::ostream& out_;
  GravitySense sense_;
  std::string reason_;
  std::string typed_;  // the line that is not complete yet
  std::deque<Wanted> queue_;
  std::array<Hand, 3> hands_;
  double asked_s_ = 0.0;
  bool connected_ = false;
  bool enabled_ = false;
  bool paused_ = false;
  bool ended_ = false;    // the input
  bool aborted_ = false;  // by the operator
  bool stopped_ = false;  // and nothing was asked for since
  std::optional<std::string> skipped_;
};

}  // namespace turncal
