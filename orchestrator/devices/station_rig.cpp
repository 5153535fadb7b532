#include "orchestrator/devices/station_rig.h"

namespace turncal {

Result<RigConfig> rig_of(const StationConfig& station, const std::string& file) {
  RigConfig rig = default_rig_config();
  rig.site.latitude_deg = station.latitude_deg;
  rig.site.gravity_mps2 = station.gravity_mps2;
  const std::string& path = file.empty() ? station.rig_file : file;
  return path.empty() ? Result<RigConfig>(rig) : read_rig_config(path, rig);
}

}  // namespace turncal
