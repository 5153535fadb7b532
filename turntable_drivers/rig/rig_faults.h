// What can go wrong on the rig, on demand: faults of the unit (by sample) and of the table (by time).
//
// Samples are numbered from the rig's first one (0), whatever the unit's counter shows. Times are rig time in seconds;
// a fault takes effect at the first sample boundary at or after its time.
#pragma once

#include <cstdint>
#include <string_view>

#include "calib/types/axis.h"

namespace turncal {

enum class RigFaultKind {
  // The unit. `sample` says when, `axis` 0..2 is the sensor axis.
  lost_sample,        // `count` samples are not delivered and their increments are gone; the unit's counter shows the
                      // gap, unless `hidden`: then the counter runs on as if nothing were missing
  duplicated_sample,  // delivered a second time with the same counter; `hidden`: with the next counter value
  gyro_glitch,        // + size [mrad] in the gyro increment of that sample
  velocity_knock,     // + size [m/s] in the accelerometer increment of that sample
  invalid_sample,     // `count` samples from there carry sample_flag_invalid, data as always
  imu_silent,         // from time_s for duration_s nothing is delivered (samples are lost, counter shows the gap)
  imu_unplugged,      // from time_s read() is a device error until the unit is opened again, which succeeds
  // The table. `axis` is the table axis as Axis.
  table_moved,  // at time_s the axis turns by size [deg] at rate_degps by itself and stays there; the encoder
                // shows it, unless `hidden` (the platform moved, the encoder did not)
  too_fast,  // from time_s for duration_s (0: for good) moves of the axis are made at rate_factor and acceleration_factor times
             // what was sent
  never_in_position,  // from time_s for duration_s (0: for good) in_position stays false
  stuck_axis,         // from time_s the axis stops dead and takes commands without moving, until clear_fault()
  axis_fault,         // at time_s the drive trips: the axis brakes at its last acceleration; latched until
                      // clear_fault()
  emergency_stop,     // at time_s all axes stop within one sample; latched until an operator releases the button
                      // (Rig::release_emergency_stop, or by itself after duration_s if that is not 0) and clear_fault()
  link_lost           // from time_s for duration_s (0: for good) every call to the table is a device error
};

// "lost_sample" and so on; false if there is no such kind.
bool parse_rig_fault_kind(std::string_view name, RigFaultKind& kind);
const char* to_string(RigFaultKind kind);
bool concerns_unit(RigFaultKind kind);  // else the table

struct RigFault {
  RigFaultKind kind = RigFaultKind::lost_sample;
  std::int64_t sample = 0;
  std::int64_t count = 1;
  double time_s = 0.0;
  double duration_s = 0.0;
  int axis = 0;
  double size = 0.0;
  double rate_degps = 1.0;
  double rate_factor = 1.0, acceleration_factor = 1.0;
  bool hidden = false;
  int unit = 1;  // of the unit's kinds: which of several on the table, from 1
};

}  // namespace turncal
