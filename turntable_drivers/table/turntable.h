// The one interface through which the station commands a three-axis table.
//
// Units: degrees, deg/s, deg/s^2. Axes: heading (outer), pitch (middle), roll (inner). Positions are cumulative (a turn
// of +360 from 0 ends at 360, not at 0); a driver whose device knows only a circle unwraps.
//
// Rules every driver obeys, and the contract test checks:
// - No call blocks for a motion. Calls return within the link's response timeout; arrival is found by polling status().
// - A move command is never retried blindly. stop_all() is sent to every axis even if one fails, and returns an error if
//   any axis did not take it; that it took effect is verified by the caller through status().
// - What is unknown is "not arrived" and "not enabled". A number that cannot be parsed is an error, never 0.
// - After a lost link nothing is answered until connect(), and then the axes are off; motion never resumes by itself.
// - Once connect() has succeeded, stop_all() and abort_all() go out whatever can be read, on a link that is opened anew where need be.
// - After abort_all() nothing switches a drive on but enable(): a stop is then another abort, since the word for a braking stop may
//   hold a drive's enable bit.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>

#include "calib/types/axis.h"
#include "calib/types/status.h"

namespace turncal {

struct TableIdentity {
  std::string description;  // maker, model, serial as the device tells them
  bool simulated = false;
};

struct AxisStatus {
  double position_deg = 0.0;
  double rate_degps = 0.0;
  bool rate_told = false;  // by the device; else it comes from two positions
  bool enabled = false;    // by this program, and the drive says so: it may be moved
  bool drive_on = false;   // the drive's own word, whoever switched it on; what was commanded where it does not tell
  bool homed = false;
  bool moving = true;
  bool in_position = false;
  bool limit = false;
  bool fault = false;
  bool emergency_stop = false;
  bool remote = false;
  std::uint32_t raw = 0;  // the device's own status word, for the log
  double time_s = 0.0;    // on the station's clock, when it was read
  std::string text;       // alarm text if the device gives one
};

using TableStatus = std::array<AxisStatus, 3>;  // indexed by Axis

class Turntable {
 public:
  virtual ~Turntable() = default;
  virtual Status connect() = 0;
  virtual Result<TableIdentity> identify() = 0;
  virtual Status enable() = 0;
  virtual Status home() = 0;  // starts homing; done when every axis says homed and not moving
  virtual Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) = 0;
  virtual Status stop_all() = 0;   // decelerate and hold
  virtual Status abort_all() = 0;  // fastest stop, drives off
  virtual Status clear_fault() = 0;
  virtual Result<AxisStatus> status(Axis axis) = 0;
  // True when moves wait for a person (a manual table): prompts are shown, and time limits are longer.
  virtual bool needs_operator() const { return false; }
  // What else has to be looked at while an answer is awaited: called every 10 ms or more often, from within the calls above. It must
  // not wait, nor use the table. Empty: nothing.
  virtual void set_meanwhile(std::function<void()> meanwhile) { static_cast<void>(meanwhile); }
  // False until connect() has succeeded once: until then the drives were told nothing but their setup.
  virtual bool was_connected() const { return true; }
  // True from the first order that switches drives on or moves an axis, until abort_all() was taken: what the drives say of themselves is not
  // enough then.
  virtual bool was_switched_on() const { return false; }
  // After a status() that failed: whether the device is there all the same, so that the fault is its own and not the link's.
  virtual bool answers() const { return false; }
  // False: abort_all() leaves the drives on, since the device has no word for it.
  virtual bool can_switch_off() const { return true; }
  // Whether they are on, by the device; else AxisStatus has what was commanded.
  virtual bool tells_drives() const { return true; }
};

}  // namespace turncal
