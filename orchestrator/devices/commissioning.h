// First contact of a station with its table: a small move of every axis, seen by the unit's gyros.
//
// With the unit level and all axes at 0 (docs/rig.md: C_nb = Ry(-H) Rz(P) Rx(R)) a turn of +d alone is felt as
//   heading: -d about y    pitch: +d about z    roll: +d about x
// The gyros' sum over the move, less what they show at rest before it, must point there within direction_deg; its size must be the angle
// that the encoder tells, to scale_tolerance, where the size is known (increments in rad, or a nominal pulse weight). The axis then goes
// back, and is stopped on the way: it has to stand there before it goes on.
//
// Then gravity in three poses, level, pitch up and roll over by pose_deg (less where the axis may not turn that far): the specific force
// must point up within direction_deg and be the site's gravity within force_tolerance, so that each accelerometer has shown its axis,
// sign and scale. Coarse for the accelerometers, whose pulse weight and biases a calibration finds; the gyros' 0.5 % is what an encoder of
// some arc minutes and a turn of 5 degrees allow.
//
// While an axis turns it must say so, and its rate must be what its position says.
//
// Every wait has a deadline and ends at the operator's stop, and at the first poll in which an axis turns that nothing sent
// (orchestrator/run/motion_watch.h). The caller sees that the table is left at rest, whatever happens.
#pragma once

#include <atomic>
#include <ostream>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

struct CommissioningSettings {
  double move_deg = 5.0;
  double rate_degps = 1.0;
  double acceleration_degps2 = 2.0;
  double rest_s = 2.0;  // at rest, before each move
  double direction_deg = 5.0;
  double scale_tolerance = 0.005;  // of 1, of the gyros
  double force_tolerance = 0.1;    // of 1, of the accelerometers
  double pose_deg = 90.0;          // at most
  double pose_rate_degps = 10.0;   // at most
  double gyro_pulse_arcsec = 0.0;  // nominal; 0: not known
  double rate_tolerance = 0.3;     // of 1, of the axis's own rate
};

// REQUIRES: table connected, unit open. Prints one line an axis.
Status try_axes(const StationDevices& devices, const StationConfig& station, const CommissioningSettings& settings,
                const std::atomic<int>& stop_requests, std::ostream& out);

// Does an axis say how fast it turns? While it goes its way, what its rate sums up to must be what its position says, and it must say that
// it moves: a stop is judged by both, and a register that is dead reads 0 of a table that turns. Plain arithmetic.
//
//   RateCheck check(where it stood);
//   check.add(what was read, poll after poll);
//   check.judge(axis, tolerance)
//
// A reading is as old as the one before it, at most. What passes between two that may lie further apart than a fifth of the way's time is not
// followed: the host was late, or the station is in fast motion. A rate that is not known (NaN) counts as 0.
class RateCheck {
 public:
  // lasts_s: the way, at the rate that is sent.
  RateCheck(const AxisStatus& began, double lasts_s)
      : longest_s_(0.2 * lasts_s), last_(began), before_s_(began.time_s) {}
  void add(const AxisStatus& now);
  // 0: it does. Where too little of the way was followed, by how much the host was late. tolerance: of 1, of what was followed. The
  // error is of the kind input: the map or dialect does not fit.
  Result<double> judge(Axis axis, double tolerance) const;

 private:
  static constexpr double least_followed = 0.8;  // of 1, of the way
  double longest_s_;
  AxisStatus last_;
  double before_s_;  // of the reading before the last
  bool said_moving_ = false;
  double turned_deg_ = 0.0, followed_deg_ = 0.0, summed_deg_ = 0.0, late_s_ = 0.0;
};

}  // namespace turncal
