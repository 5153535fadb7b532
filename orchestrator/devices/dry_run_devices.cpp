#include "orchestrator/devices/dry_run_devices.h"

#include <algorithm>

#include "orchestrator/devices/table_device.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/twins/rehearsed_table.h"

namespace turncal {

StationDevices DryRunDevices::devices() {
  return {table, imu, clock, [this](double seconds) { wait(seconds); }};
}

void DryRunDevices::wait(double seconds) {
  group.pass_until(group.now_s() + std::max(seconds, rig.config().sample_period_s));
}

Status DryRunDevices::put_back(std::span<const JournalCommand> commands, double until_s) {
  TRY(table.connect());
  TRY(table.enable());
  for (const JournalCommand& command : commands) {
    group.pass_until(command.time_s);
    const Status given = command.move ? table.move_absolute(command.move->axis, command.move->target_deg,
                                                            command.move->rate_degps, command.move->acceleration_degps2)
                                      : table.home();
    if (!given) return given;
  }
  group.pass_until(until_s);
  const Result<AxisStatus> status = table.status(Axis::heading);  // a table notices only when it is asked
  return status ? Status{} : Status{status.error()};
}

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
