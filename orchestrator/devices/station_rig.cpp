#include "orchestrator/devices/station_rig.h"

#include <cmath>

#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

constexpr double same_period = 1e-6;  // of two files that were written by people

}  // namespace

Result<RigConfig> rig_of(const StationConfig& station, const std::string& file) {
  RigConfig rig = default_rig_config();
  rig.site.latitude_deg = station.latitude_deg;
  rig.site.gravity_mps2 = station.gravity_mps2;
  if (station.imu) {
    rig.sample_period_s = station.imu->frame.sample_period_s;
    if (station.imu->frame.accel().pulses) rig.accel_pulse_mps = station.imu->frame.accel_pulse_mps;
  }
  const std::string& path = file.empty() ? station.rig_file : file;
  if (path.empty()) return rig;
  const double period_s = rig.sample_period_s;
  Result<RigConfig> read = read_rig_config(path, rig);
  if (!read) return read;
  if (station.imu && std::abs(read->sample_period_s / period_s - 1.0) > same_period) {
    return input_error(path + ": sample_period_s = " + format_number(read->sample_period_s) + ": expected " +
                       format_number(period_s) + ", as frame " + station.imu->frame.name + " of the station has it");
  }
  if (read->quantisation == RigQuantisation::off)
    return input_error(path + ": quantisation = off: expected floor or round: a unit counts whole pulses");
  return read;
}

}  // namespace turncal
