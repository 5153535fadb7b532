// A lot of units: the unit on the rig follows from its serial number, and some are faulty. For rehearsing a line (docs/line.md).
//
// The same serial number is the same unit: its truth is drawn from the lot's seed and the serial. Another beginning is another turn-on:
// noise, and a step of the biases from there. Between turn-ons the biases walk: a step a day.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace turncal {

struct RigConfig;

// What a faulty unit has. All but unsettled have it at every turn-on.
enum class LotFault {
  none,
  gyro_bias,        // one N0 is off by 0.6 deg/h
  accel_nonlinear,  // accel_second_order of one axis, 80 ug/g^2
  g_sensitive,      // gyro_g_sensitivity of one gyro to a force across it, 0.08 deg/h/g
  noisy,            // six times the random walk of the gyros
  unsettled         // at about every second turn-on an accelerometer jumps by 500 ug in mid-run
};
const char* to_string(LotFault fault);

struct RigLot {
  std::optional<std::uint64_t> seed;  // not set: the unit has nothing to do with its serial number
  double faulty = 0.0;                // so many of the units, 0 to 1
  double between_h = 0.25;            // from the end of a run to the beginning of the next
  double turn_on_gyro_degph = 0.0;    // sigma of a bias from turn-on to turn-on
  double turn_on_accel_ug = 0.0;
  double month_gyro_degph = 0.0;  // sigma of the change of a bias in 30 days
  double month_accel_ug = 0.0;
  // Of the unit that rig_of_lot() made, at this turn-on.
  LotFault fault = LotFault::none;
  bool fault_shows = false;
};

// What is true of the unit `serial` when it is turned on at config.start_utc_s; config itself without lot.seed.
RigConfig rig_of_lot(RigConfig config, const std::string& serial);
}  // namespace turncal
