// The one interface through which the station commands a temperature chamber about the unit.
//
// Units: degrees Celsius, C/min. Rules every chamber obeys, and the contract test checks:
// - No call waits for a temperature. A call returns within the link's time-outs; what became of a command is read back with status(), by the
//   caller (orchestrator/run/chamber_watch.h), which has the deadlines.
// - A reading that is not believed (garbled, not a number, beyond the limits and a margin) is an error, never a number.
// - Set points and ramps beyond the limits are refused. set() and on() go out only to a chamber that connect() has opened; off() goes out on a
//   link that is opened anew where need be.
// - All commands may be repeated: they say what shall be, not by how much.
// Not modelled: humidity, programs of the chamber's own.
#pragma once

#include <optional>
#include <string>

#include "calib/types/status.h"

namespace turncal {

struct ChamberStatus {
  double actual_c = 0.0;  // of the air, by the chamber's own sensor
  double set_point_c = 0.0;
  bool on = false;                           // it heats and cools
  std::optional<bool> door_open{}, alarm{};  // empty: the chamber does not tell
};

struct ChamberLimits {
  double low_c = 0.0, high_c = 0.0;  // of set points
  double ramp_c_per_min = 1.0;       // the fastest
  double grain_c = 0.1;              // a set point is told, and read, to this
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

// An input error beyond the limits.
Status check_set_point(const ChamberLimits& limits, double temperature_c, double ramp_c_per_min);

// What is wrong with a reading, where something is: a sensor that cannot be right. Its margin: air may overshoot, a room may be anything.
inline constexpr double sensor_margin_c = 50.0;
bool is_believable(const ChamberLimits& limits, double actual_c);

}  // namespace turncal
