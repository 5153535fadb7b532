#include "orchestrator/devices/rehearsal_devices.h"

#include "orchestrator/devices/table_device.h"
#include "turntable_drivers/twins/rehearsed_table.h"

namespace turncal {

RehearsalDevices::RehearsalDevices(const RigConfig& config, const StationConfig& station, int input, std::ostream& out)
    : rig_(config),
      watched_(rig_.imu, config.sample_period_s),
      manual_(station.table.manual, rig_.clock, input, out, [this] { return watched_.mean(); }),
      limited_(manual_, motion_limits(station)),
      prompts_(manual_) {
  manual_.rehearse_on(rehearsed_table(rig_.rig));
  manual_.feel_turns([this] { return watched_.turned_deg(); });
}

StationDevices RehearsalDevices::devices() { return {limited_, watched_, rig_.clock, rig_.devices().wait}; }

}  // namespace turncal
