// The keys of a station file that say which unit is on which line:
//
//   imu.device          = /dev/serial/by-id/...   by-id, since ttyUSB0 may come back as ttyUSB1
//                         or tcp:HOST:PORT, udp:PORT, udp:ADDRESS:PORT, udp_to:HOST:PORT (byte_line.h)
//   imu.frame           = laser_gyro              a built-in name, or a file (with '/' or '.frame'), relative to the station file
//   imu.unit_serial     =                         of a unit that does not tell
//   imu.baud            = 230400                  instead of the frame's
//   imu.accel_pulse_mps = 0.00049                 instead of the frame's nominal one; only with pulses
//   imu.simulated       = false                   true for a twin: recordings are marked, and never make a production file
//   imu.speedup         = 1                       of a twin; 1 unless simulated
// Only the first two are required.
#pragma once

#include "imu_io/base/key_value.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/units/serial_imu.h"

namespace turncal {

struct SerialImuConfig {
  FrameDescription frame;
  SerialImuSettings settings;
};

// An error of the frame description is returned with its own file and line; defects of the station file's keys also stay with
// `file`, as with all its getters.
Result<SerialImuConfig> read_serial_imu_config(KeyValueFile& file);

}  // namespace turncal
