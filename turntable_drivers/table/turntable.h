// The only interface through which the station commands a three-axis table.
//
// Units: degrees, deg/s, deg/s^2. Axes: heading (outer), pitch (middle), roll (inner). Positions are cumulative (a turn
// of +360 from 0 ends at 360, not at 0); a driver unwraps the position of a circular device.
//
// Rules every driver obeys, and the contract test checks:
// - No call waits for a motion. Calls return within the response timeout of the link; poll status() for the arrival.
// - A move command is never retried blindly. stop_all() is sent to every axis even if one fails, and returns an error if
//   any axis did not take it; the caller verifies the effect with status().
// - Unknown means "not arrived" and "not enabled". A number that cannot be parsed is an error, never 0.
// - After a lost link nothing is answered until connect(). The axes are then disabled; motion never resumes by itself.
// - After a successful connect(), stop_all() and abort_all() are sent whatever can be read; a closed link is reopened for them.
// - After abort_all() only enable() may enable a drive: a stop is then another abort, because a braking stop may
//   set a drive's enable bit.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>

#include "calib/types/axis.h"
#include "calib/types/status.h"

namespace turncal {

struct TableIdentity {
  std::string description;  // maker, model and serial as the device reports them
  bool simulated = false;
};

struct AxisStatus {
  double position_deg = 0.0;
  double rate_degps = 0.0;
  bool rate_told = false;  // reported by the device; false: computed from two positions
  bool enabled = false;    // by this program and by the drive's own report: it may be moved
  bool drive_on = false;   // reported by the drive, whoever enabled it; the command if it does not report
  bool homed = false;
  bool moving = true;
  bool in_position = false;
  bool limit = false;
  bool fault = false;
  bool emergency_stop = false;
  bool remote = false;
  std::uint32_t raw = 0;  // raw status word of the device, for the log
  double time_s = 0.0;    // time of the reading on the station's clock
  std::string text;       // alarm text of the device, if any
};

using TableStatus = std::array<AxisStatus, 3>;  // indexed by Axis

class Turntable {
 public:
  virtual ~Turntable() = default;
  virtual Status connect() = 0;
  virtual Result<TableIdentity> identify() = 0;
  virtual Status enable() = 0;
  virtual Status home() = 0;  // starts homing; it is done when every axis reads homed and not moving
  virtual Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) = 0;
  virtual Status stop_all() = 0;   // decelerate and hold
  virtual Status abort_all() = 0;  // fastest stop, drives off
  virtual Status clear_fault() = 0;
  virtual Result<AxisStatus> status(Axis axis) = 0;
  // True when a person makes the moves (a manual table): prompts are shown, and time limits are longer.
  virtual bool needs_operator() const { return false; }
  // Sets a function for other checks while an answer is awaited. The calls above call it at least every 10 ms. It must
  // not wait or use the table. Empty: none.
  virtual void set_meanwhile(std::function<void()> meanwhile) { static_cast<void>(meanwhile); }
  // False until the first successful connect(): until then the drives have received only their setup.
  virtual bool was_connected() const { return true; }
  // True from the first command that enables drives or moves an axis until abort_all() is acknowledged: meanwhile the drives' own report is not
  // enough.
  virtual bool was_switched_on() const { return false; }
  // After a failed status(): true if the device answers, so that the fault is its own and not the link's.
  virtual bool answers() const { return false; }
  // False: abort_all() leaves the drives enabled, since the device has no command to disable them.
  virtual bool can_switch_off() const { return true; }
  // True if the device reports whether drives are on; otherwise AxisStatus has what was commanded.
  virtual bool tells_drives() const { return true; }
};

}  // namespace turncal
