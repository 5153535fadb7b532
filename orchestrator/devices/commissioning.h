// Tries a station's table for the first time: a small move of every axis, felt by the unit's gyros.
//
// With the unit level and all axes at 0 (docs/rig.md: C_nb = Ry(-H) Rz(P) Rx(R)) a turn by +d alone is felt as
//   heading: -d about y    pitch: +d about z    roll: +d about x
// The gyros' sum over the move, minus their rate at rest before it, must point there within direction_deg. Its size, where it is known
// (increments in rad, or a nominal pulse weight), must equal the encoder's angle within scale_tolerance. The axis then goes
// back and is stopped on the way: it has to come to rest there before it goes on.
//
// Then gravity is measured in three poses, level, pitch up and roll over by pose_deg (less if the axis cannot turn that far). The specific force
// must point up within direction_deg and equal the site's gravity within force_tolerance, so that each accelerometer has shown its axis,
// sign and scale. This is coarse for the accelerometers, whose pulse weight and biases a calibration finds; 0.5 % for the gyros is what an
// encoder of some arc minutes and a turn of 5 degrees allow.
//
// While an axis turns, its status must show it, and its rate must agree with its position. The clock is the unit's counter: the samples decide when a
// rest has lasted and a turn is complete, however late the host is. A reading has the time of the last sample before the next reading.
//
// Every wait has a deadline and ends at the operator's stop, and at the first poll in which an axis turns that was not sent
// (orchestrator/run/motion_watch.h). The caller makes sure that the table is left at rest, whatever happens.
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
  double scale_tolerance = 0.005;  // relative, of the gyros
  double force_tolerance = 0.1;    // relative, of the accelerometers
  double pose_deg = 90.0;          // at most
  double pose_rate_degps = 10.0;   // at most
  double gyro_pulse_arcsec = 0.0;  // nominal; 0: not known
  double rate_tolerance = 0.3;     // relative, of the axis's own rate
};

// REQUIRES: table connected, unit open. Prints one line an axis.
Status try_axes(const StationDevices& devices, const StationConfig& station, const CommissioningSettings& settings,
                const std::atomic<int>& stop_requests, std::ostream& out);

// Checks the rate that an axis reports: along a move its integral must match the change of position, and the axis must report that it
// moves. A stop is judged by both, and a dead register reads 0 on a table that turns. Plain arithmetic.
//
//   RateCheck check(status before the move);
//   check.add(status at each poll);
//   check.judge(axis, tolerance)
//
// A reading is at most as old as the previous one. An interval that may exceed a fifth of the move's time is not integrated:
// the host was late, or the station runs in fast motion. An unknown rate (NaN) counts as 0.
class RateCheck {
 public:
  // lasts_s: time of the move at the commanded rate.
  RateCheck(const AxisStatus& began, double lasts_s)
      : longest_s_(0.2 * lasts_s), last_(began), before_s_(began.time_s) {}
  void add(const AxisStatus& now);
  // Returns 0 when rate and position agree, or the host's delay when too little of the move was integrated. tolerance: relative, of that part.
  // An error is of kind input: the map or dialect does not fit.
  Result<double> judge(Axis axis, double tolerance) const;

 private:
  static constexpr double least_followed = 0.8;  // fraction of the move
  double longest_s_;
  AxisStatus last_;
  double before_s_;  // time of the reading before the last
  bool said_moving_ = false;
  double turned_deg_ = 0.0, followed_deg_ = 0.0, summed_deg_ = 0.0, late_s_ = 0.0;
};

}  // namespace turncal
