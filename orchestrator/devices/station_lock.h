// One process at a time on a station's devices: its table and its units, over TCP as well as on serial lines. Taken before anything is
// opened, let go when the process ends, however.
//
// A device in /dev goes by the name that the station says, not by what its links lead to: who has lost its line still holds the name, and
// ttyUSB0 may be another station's adapter by then. Two names of one port are kept apart by the port (SerialPort).
//
// A lock file of this machine for each device, below /run/lock: another machine at the same table is not seen. The name of a table's host is
// that of its address; all addresses by which this machine reaches itself are one.
#pragma once

#include <string>
#include <vector>

#include "imu_io/base/posix_file.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

class StationLock {
 public:
  // Error: kind device, names the device and who holds it.
  static Result<StationLock> acquire(const StationConfig& station);

 private:
  std::vector<LockFile> locks_;
};

// The lock file of a device: a path or HOST:PORT.
std::string lock_path_of(const std::string& device);

}  // namespace turncal
