// `turncal twin`: serves the rig outside, as the table and the unit that the station file describes, until a signal ends it (docs/twin.md).
#include <memory>

#include "imu_io/base/format_number.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/rig_twin.h"
#include "orchestrator/devices/station_rig.h"
#include "orchestrator/devices/stop_signals.h"

namespace turncal {

namespace {

struct TwinCommandOptions {
  std::string station;
  std::string rig;
  TwinSettings settings{.speed_up = 0.0, .table = {}};  // 0: the station's
};

Status run_twin(const TwinCommandOptions& options, CommandContext& context) {
  const StationConfig station = TRY(read_station_config(options.station));
  const RigConfig rig = TRY(rig_of(station, options.rig));
  TwinSettings settings = options.settings;
  if (settings.speed_up == 0.0) settings.speed_up = station.clock_speed_up;
  const StopSignals signals;
  std::unique_ptr<RigTwin> twin = TRY(RigTwin::open(station, rig, settings));
  context.out << "[twin] ready: table " << (station.table.map ? "modbus" : "serial") << " at " << twin->table_address()
              << (station.imu_places() > 1 ? ", units " : ", unit ") << station.imu->frame.name << " on "
              << twin->imu_devices() << ", " << format_number(settings.speed_up) << " times real time, rig seed "
              << rig.seed << std::endl;
  const Status status = twin->run(
      StopSignals::requests(), [&context](const std::string& what) { context.out << "[twin] " << what << std::endl; });
  context.out << "[twin] ends at " << format_number(twin->rig_time_s()) << " s of rig time";
  if (twin->batches_dropped() > 0) {
    context.out << "; " << twin->batches_dropped() << " batches of samples were not read in time";
  }
  context.out << std::endl;
  return status;
}

}  // namespace

void add_twin_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<TwinCommandOptions>();
  const Command command = line.command("twin", "serve the simulated table and unit of a station on real lines");
  command.option("--station", options->station, "station configuration: which lines, which map or dialect, which frame")
      .required();
  command.option("--rig", options->rig,
                 "rig configuration (docs/rig.md); default: rig.file of the station, or the built-in one");
  command
      .option("--speed-up", options->settings.speed_up,
              "how many times faster than the wall clock; default: clock.speed_up")
      .range(0.01, 1000.0);
  command.option("--table", options->settings.table,
                 "tcp:PORT (0: any free one), pty or pty:LINK; default: as the station says");
  command.runs(context, [options, &context] { return run_twin(*options, context); });
}

}  // namespace turncal
