// `turncal commission`: is the table what its map or dialect says, and does the unit feel its axes as it should? (docs/twin.md)
#include <memory>

#include "imu_io/base/console.h"
#include "orchestrator/commands/command_check.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/commissioning.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/jobs/run_results.h"

namespace turncal {

namespace {

struct Options {
  std::string station;
  std::optional<double> heading, pitch, roll;  // where the axes stand now
  double tolerance_deg = 0.1;
  bool accept_guess = false;
  CommissioningSettings settings;
};

// switched_on: whether the drives were. said_last: what is said once the table was left.
Status commission(const Options& options, const StationConfig& station, LiveDevices& live, std::ostream& out,
                  bool& switched_on, std::string& said_last) {
  const StationDevices devices = live.devices();
  const Status connected = devices.table.connect();
  // With the wrong word order no position may be plausible: commission_table says which fits.
  if (!connected && !(options.heading && station.table.map)) return connected;
  if (connected) {
    const TableIdentity table = TRY(devices.table.identify());
    out << table.description << std::endl;
    if (const std::string caution = caution_of(station.table); !caution.empty()) {
      out << "warning: table: " << caution << std::endl;
    }
  }
  if (options.heading) {
    const AxisTriple known{*options.heading, *options.pitch, *options.roll};
    TRY(live.commission_table(known, options.tolerance_deg));
    if (!connected) return connected;
    out << "every axis reads where it stands; no other word order, sign or scale would" << std::endl;
  } else if (!is_commissioned(station.table)) {
    return input_error(
        "the table is not commissioned: expected --heading, --pitch and --roll, the angles (not 0) at which its axes "
        "stand");
  }
  if (!is_commissioned(station.table)) {
    said_last = "write commissioned = true into your copy of the table's file, then call this again without angles";
    return {};
  }
  TRY(devices.imu.open());
  switched_on = true;
  said_last = "every axis turns the unit as it should, and gravity is felt where it should be";
  return try_axes(devices, station, options.settings, StopSignals::requests(), out);
}

Status run_commission(const Options& options, CommandContext& context) {
  const StationConfig station = TRY(read_station_config(options.station));
  TRY(check_real_devices(station));
  if (station.table.driver == TableDriver::manual) {
    return input_error("station '" + station.name + "': a table turned by hand has nothing to commission");
  }
  if (station.simulated()) context.tag = simulated_tag;
  if (const std::vector<std::string> guesses = guesses_of(station, true); !guesses.empty() && !options.accept_guess) {
    return input_error(guesses.front() +
                       (guesses.size() > 1 ? ", and " + std::to_string(guesses.size() - 1) + " more lines" : "") +
                       ": it decides what moves; expected it checked against the table's manual and its [guess] taken "
                       "out, or --accept-guess (turncal check --explain shows what is sent)");
  }
  const StopSignals signals;
  std::unique_ptr<LiveDevices> live = TRY(LiveDevices::make(station, StopSignals::requests(), context.out));
  const LinePrefix marked(context.out, context.tag);
  bool switched_on = false;
  std::string said;
  Status status = commission(options, station, *live, context.out, switched_on, said);
  const std::string how_left = switched_on ? "; " + how_it_rests(live->devices().table) : "; nothing was moved";
  status = live->leave_table(status, how_left);
  if (switched_on && live->left_off()) {
    if (const std::string sag = live->sag_since({}); !sag.empty()) context.warn(sag);
  }
  if (status) context.out << said << how_left << std::endl;
  return status;
}

}  // namespace

void add_commission_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<Options>();
  const Command command = line.command(
      "commission", "compare a table with known angles, then move each axis a little and see the unit feel it");
  command.option("--station", options->station, "station configuration").required();
  const Option heading =
      command.option("--heading", options->heading, "angle at which the axis stands now, degrees; not 0");
  const Option pitch = command.option("--pitch", options->pitch, "the same");
  const Option roll = command.option("--roll", options->roll, "the same");
  heading.needs(pitch).needs(roll);
  pitch.needs(heading);
  roll.needs(heading);
  command.flag("--accept-guess", options->accept_guess,
               "although lines of the table's file that decide what moves are marked as guesses");
  command.option("--tolerance", options->tolerance_deg, "of these angles, degrees").positive();
  command.option("--move", options->settings.move_deg, "how far each axis is moved, degrees").range(0.5, 30.0);
  command
      .option("--pose", options->settings.pose_deg,
              "how far pitch and roll are tilted to compare gravity, degrees at most")
      .range(30.0, 90.0);
  command
      .option("--gyro-pulse-arcsec", options->settings.gyro_pulse_arcsec,
              "nominal weight of a gyro pulse, to check the scale of the gyros against the table")
      .positive();
  command.runs(context, [options, &context] { return run_commission(*options, context); });
}

}  // namespace turncal
