// The only interface through which the station commands a temperature chamber around the unit.
//
// Units: degrees Celsius, C/min. Rules every chamber obeys, and the contract test checks:
// - No call waits for a temperature. A call returns within the time-outs of the link. The caller (orchestrator/run/chamber_watch.h) reads
//   back with status() what became of a command, and has the deadlines.
// - An implausible reading (garbled, not a number, beyond the limits and a margin) is an error, never a number.
// - Set points and ramps beyond the limits are refused. set() and on() are sent only to a chamber opened by connect(); off() reopens a
//   closed link if necessary.
// - Every command may be repeated: it sets a state, not a change.
// Not modelled: humidity, the chamber's own programs.
#pragma once

#include <optional>
#include <string>

#include "calib/types/status.h"

namespace turncal {

struct ChamberStatus {
  double actual_c = 0.0;  // of the air, by the chamber's sensor
  double set_point_c = 0.0;
  bool on = false;                           // heating and cooling is on
  std::optional<bool> door_open{}, alarm{};  // empty: not reported
};

struct ChamberLimits {
  double low_c = 0.0, high_c = 0.0;  // range of set points
  double ramp_c_per_min = 1.0;       // maximum
  double grain_c = 0.1;              // resolution of set points, sent and read
};

class Chamber {
 public:
  virtual ~Chamber() = default;
  virtual Status connect() = 0;
  virtual std::string identity() const = 0;
  virtual const ChamberLimits& limits() const = 0;
  virtual Result<ChamberStatus> status() = 0;
  virtual Status set(double temperature_c, double ramp_c_per_min) = 0;
  virtual Status on() = 0;
  virtual Status off() = 0;
  virtual void disconnect() = 0;
};

// Returns an input error for a set point or ramp beyond the limits.
Status check_set_point(const ChamberLimits& limits, double temperature_c, double ramp_c_per_min);

// How far beyond the limits a reading may be before the sensor counts as faulty: air overshoots, and a room may have any temperature.
inline constexpr double sensor_margin_c = 50.0;
bool is_believable(const ChamberLimits& limits, double actual_c);

}  // namespace turncal
