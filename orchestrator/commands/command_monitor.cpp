// `turncal monitor`: looks at the station's table and unit, one line a second; moves nothing, and sees the drives off when it ends
// (docs/twin.md).
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "imu_io/base/console.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/jobs/run_results.h"
#include "turntable_drivers/table/table_state.h"

namespace turncal {

namespace {

constexpr double line_every_s = 1.0;
constexpr double look_every_s = 0.1;  // at a signal, and at a unit that is silent

struct MonitorOptions {
  std::string station;
  double seconds = 0.0;  // 0: until a signal
};

// What came in since the last line.
struct Second {
  std::int64_t samples = 0, gaps = 0, lost = 0, flagged = 0;
  std::array<double, 3> accel{};  // increments
  double temperature_c = 0.0;
};

void add(std::span<const ImuSample> samples, std::optional<std::int64_t>& last_counter, Second& second) {
  for (const ImuSample& sample : samples) {
    if (last_counter && sample.counter > *last_counter + 1) {
      ++second.gaps;
      second.lost += sample.counter - *last_counter - 1;
    }
    last_counter = sample.counter;
    ++second.samples;
    second.flagged += (sample.flags & sample_flag_invalid) != 0 ? 1 : 0;
    for (std::size_t i = 0; i < 3; ++i) second.accel[i] += sample.accel[i];
    second.temperature_c = sample.temperature_c;
  }
}

// The state in a word, and what it hides.
std::string state_text(const AxisStatus& axis) {
  std::string text;
  const auto add = [&text](bool set, const char* name) {
    if (set) text += std::string(text.empty() ? "" : ", ") + name;
  };
  add(axis.limit, "limit");
  add(!axis.remote, "local");
  add(!axis.drive_on, "off");
  add(axis.drive_on && !axis.enabled, "on, by somebody else");
  add(!axis.homed, "not homed");
  return to_string(state_of(axis)) + (text.empty() ? "" : " (" + text + ")");
}

std::string table_text(Turntable& table) {
  std::string text;
  for (const Axis axis : all_axes) {
    const Result<AxisStatus> status = table.status(axis);
    char part[160];
    if (status) {
      std::snprintf(part, sizeof part, "%c %9.4f deg %8.4f deg/s %s; ", to_string(axis)[0] - 'a' + 'A',
                    status->position_deg, status->rate_degps, state_text(*status).c_str());
      text += part;
    } else {
      text += std::string(to_string(axis)) + ' ' + to_string(state_unread(table)) + "; ";
    }
  }
  return text;
}

std::string unit_text(const Second& second, const RecordingInfo& info, double seconds) {
  if (second.samples == 0) return "no samples";
  const double weight = info.accel_increment == IncrementKind::pulses ? info.accel_pulse_mps : 1.0;
  const double per_s = weight / (static_cast<double>(second.samples) * info.sample_period_s);
  char text[200];
  std::snprintf(text, sizeof text, "%.1f samples/s, %lld gaps (%lld lost), %lld flagged, |f| %.4f m/s^2",
                static_cast<double>(second.samples) / seconds, static_cast<long long>(second.gaps),
                static_cast<long long>(second.lost), static_cast<long long>(second.flagged),
                per_s * std::hypot(second.accel[0], second.accel[1], second.accel[2]));
  std::string whole = text;
  if (info.has_temperature) {
    std::snprintf(text, sizeof text, ", %.2f C", second.temperature_c);
    whole += text;
  }
  return whole;
}

Status watch(LiveDevices& live, double seconds, std::ostream& out) {
  const StationDevices devices = live.devices();
  TRY(devices.table.connect());
  const TableIdentity table = TRY(devices.table.identify());
  TRY(devices.imu.open());
  const ImuIdentity unit = TRY(devices.imu.identify());
  RecordingInfo info;
  devices.imu.describe(info);
  out << table.description << "; " << unit.description << std::endl;

  std::vector<ImuSample> buffer(1024);
  std::optional<std::int64_t> last_counter;
  std::uint64_t bad_frames_before = 0;
  const double began_s = devices.clock.now_s();
  for (double line_s = began_s; StopSignals::requests() == 0 && (seconds == 0.0 || line_s - began_s < seconds);) {
    Second second;
    double now_s = line_s;
    // Also what came while a slow table was asked.
    for (bool more = true; (more || now_s - line_s < line_every_s) && StopSignals::requests() == 0;) {
      const std::size_t got = TRY(devices.imu.read(buffer, look_every_s));
      add(std::span(buffer).first(got), last_counter, second);
      more = got == buffer.size();
      now_s = devices.clock.now_s();
    }
    char time[32];
    std::snprintf(time, sizeof time, "%8.1f s  ", now_s - began_s);
    const std::uint64_t bad_frames = devices.imu.counters().bad_frames;
    const std::string table_now = table_text(devices.table);
    if (StopSignals::requests() != 0) break;  // its readings were given up
    out << time << table_now << unit_text(second, info, now_s - line_s);
    if (bad_frames > bad_frames_before) out << ", " << bad_frames - bad_frames_before << " bad frames";
    out << std::endl;
    bad_frames_before = bad_frames;
    line_s = now_s;
  }
  out << "unit: " << live.unit_summary(0) << std::endl;
  return {};
}

Status run_monitor(const MonitorOptions& options, CommandContext& context) {
  const StationConfig station = TRY(read_station_config(options.station));
  TRY(check_real_devices(station));
  const StopSignals signals;
  std::unique_ptr<LiveDevices> live = TRY(LiveDevices::make(station, StopSignals::requests(), context.out));
  if (station.simulated()) context.tag = simulated_tag;
  const LinePrefix marked(context.out, context.tag);
  // A drive that somebody else had switched on, too.
  return live->leave_table(watch(*live, options.seconds, context.out));
}

}  // namespace

void add_monitor_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<MonitorOptions>();
  const Command command =
      line.command("monitor", "look at a station's table and unit, one line a second; nothing is moved");
  command.option("--station", options->station, "station configuration").required();
  command.option("--seconds", options->seconds, "how long, in the station's time; default: until a signal").positive();
  command.runs(context, [options, &context] { return run_monitor(*options, context); });
}

}  // namespace turncal
