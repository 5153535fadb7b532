// `turncal check`; `commission`, `monitor` and `twin` (docs/tables.md); `serve`: the page of several stations, in a process of its own.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iterator>
#include <thread>

#include "imu_io/base/console.h"
#include "imu_io/base/text.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/commissioning.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/devices/rig_twin.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/run/chamber_watch.h"
#include "orchestrator/service/service_page.h"
#include "orchestrator/watch/progress.h"
#include "sequences/plan.h"
#include "turntable_drivers/table/table_state.h"

namespace turncal {

std::vector<std::string> guesses_of(const StationConfig& station, bool moving, bool heating) {
  std::vector<std::string> guesses;
  const auto add = [&](const std::string& file, const std::vector<LineSource>& lines) {
    for (const LineSource& line : lines)
      if (line.is_guess() && (heating ? decides_heat(line.key) : !moving || decides_motion(line.key)))
        guesses.push_back(file + ":" + std::to_string(line.line) + ": " + line.key + " is a guess");
  };
  const TableConfig& table = station.table;
  if (station.chamber && !moving) add(station.chamber->described.file, station.chamber->described.lines);
  if (heating) return guesses;
  if (const TableDescription* const described = table.described()) add(described->file, described->lines);
  if (station.imu && !moving) add(station.imu->frame.file, station.imu->frame.lines);
  return guesses;
}

namespace {

void print_item(const PlannedItem& item, std::ostream& out) {
  const std::string start = format_duration(item.start_s);
  if (item.kind == SequenceItem::Kind::dwell)
    out << fmt::format("  {:>8}  {:<6}  {:55} {:8.1f} s  {} samples\n", start,
                       item.dwell_kind == SegmentKind::align ? "align" : "dwell", "", item.duration_s, item.samples);
  else
    out << fmt::format("  {:>8}  rotate  {:<7} {:8.6g} -> {:<8.6g} {:6.6g} deg/s {:6.6g} deg/s^2 {:8.1f} s{}\n", start,
                       to_string(item.axis), item.from_deg, item.to_deg, item.rate_degps, item.acceleration_degps2,
                       item.duration_s, item.positioning ? "  to the initial position" : "");
}

void print_totals(const StationConfig& station, const Plan& plan, std::ostream& out) {
  out << "\nTravel, deg   planned            soft limits        cable wound / allowed   turned in all\n";
  for (const Axis axis : all_axes) {
    const AxisLimits& limit = station.axis[index(axis)];
    const std::string allowed = limit.wrap_deg > 0.0 ? fmt::format("{:.6g}", limit.wrap_deg) : "no limit";
    out << fmt::format("  {:<8} {:7.6g} to {:<7.6g} {:7.6g} to {:<7.6g} {:9.6g} / {:<9} {:12.6g}\n", to_string(axis),
                       plan.travel_min_deg[axis], plan.travel_max_deg[axis], limit.soft_min_deg, limit.soft_max_deg,
                       plan.wrap_used_deg[axis], allowed, plan.turned_deg[axis]);
  }
  out << fmt::format(
      "\nMoves       {}\nDwells      {} ({} alignments, {} static)\nSamples     {}\nTotal time  {} ({:.10g} s), of "
      "which moving {} ({:.10g} s)\n",
      plan.moves, plan.align_dwells + plan.still_dwells, plan.align_dwells, plan.still_dwells, plan.samples,
      format_duration(plan.station_s), plan.station_s, format_duration(plan.moving_s), plan.moving_s);
}

void print_plan(const Sequence& sequence, const StationConfig& station, const Plan& plan, std::ostream& out) {
  const double period_s = plan.samples > 0 ? plan.station_s / double(plan.samples) : 0.0;
  out << "Sequence  " << sequence.file << " (" << sequence.name << ", " << counted(std::ssize(sequence.steps), "step")
      << ")\n";
  out << "Station   " << (station.file.empty() ? "built in" : station.file) << " (" << station.name << ")\n";
  const AxisTriple& start_deg = sequence.start_deg;
  out << fmt::format(
      "Site      latitude {:.10g} deg, gravity {:.10g} m/s^2; IMU at {:.6g} Hz; settling {:.6g} s\n"
      "Start     heading {:.6g}, pitch {:.6g}, roll {:.6g} deg\n",
      station.latitude_deg, station.gravity_mps2, 1.0 / period_s, station.motion.settle_s, start_deg[Axis::heading],
      start_deg[Axis::pitch], start_deg[Axis::roll]);
  std::size_t shown_steps = 0;
  for (const PlannedItem& item : plan.items) {
    if (item.step_index == shown_steps) {
      const Step& step = sequence.steps[shown_steps++];
      out << fmt::format("\nStep {}  {}{}{}\n", step.number, step.title, step.determines.empty() ? "" : "  determines ",
                         fmt::join(step.determines, " "));
    }
    print_item(item, out);
  }
  print_totals(station, plan, out);
}

std::string caution_of(const TableConfig& table) {
  return table.map ? caution_of(*table.map) : table.dialect ? caution_of(*table.dialect) : "";
}

bool is_commissioned(const TableConfig& table) { return !table.described() || table.described()->commissioned; }

// Refuses guesses among the lines that decide what moves, or what heats.
Status check_guesses(const StationConfig& station, bool heating, bool accepted) {
  const std::vector<std::string> guesses = guesses_of(station, !heating, heating);
  if (guesses.empty() || accepted) return {};
  const std::string more =
      !heating && guesses.size() > 1 ? ", and " + counted(std::ssize(guesses) - 1, "more line") : "";
  return input_error(
      "{}{}: it decides what {}: expected a line checked against the {}'s manual, without its [guess], or "
      "--accept-guess (turncal check --explain shows what is sent)",
      guesses.front(), more, heating ? "heats" : "moves", heating ? "chamber" : "table");
}

// Defects of the station's files: `blocks` keep it from every run, `doubts` are for somebody to check.
struct Against {
  std::vector<std::string> blocks, doubts;
};

Against against(const StationConfig& station) {
  Against found;
  const TableConfig& table = station.table;
  // A station with mock devices only is made for --dry-run.
  if (station.table.driver != TableDriver::mock || station.imu) found.blocks = no_real_devices(station);
  if (station.chamber && !station.chamber->described.commissioned)
    found.blocks.push_back(
        "the chamber is not commissioned: turncal commission --chamber comes before the first run with it");
  if (!is_commissioned(table))
    found.blocks.push_back("the table is not commissioned: turncal commission comes before the first run");
  if (const std::string caution = caution_of(table); !caution.empty()) found.doubts.push_back("table: " + caution);
  std::ranges::copy(guesses_of(station, false), std::back_inserter(found.doubts));
  if (!guesses_of(station, true).empty())
    found.doubts.push_back("some of these guesses decide what moves: commission needs --accept-guess");
  return found;
}

std::string chamber_line(const ChamberConfig& chamber) {
  const ChamberDescription& described = chamber.described;
  return fmt::format("Chamber   {} ({}), {} to {} C, {} C/min at most, the unit to {} C{}{}", described.file,
                     described.name, format_number(described.limits.low_c), format_number(described.limits.high_c),
                     format_number(described.limits.ramp_c_per_min), format_number(chamber.limit_unit_c),
                     chamber.temperature_c ? "; runs at " + format_number(*chamber.temperature_c) + " C" : "",
                     described.verified_on_hardware ? "" : "; not verified on hardware");
}

void print_devices(const StationConfig& station, std::ostream& out) {
  const TableConfig& table = station.table;
  if (const TableDescription* const described = table.described())
    out << fmt::format(
        "Table     {} ({})\nMove      shown from 0 to {:.10g} deg at {:.10g} deg/s and {:.10g} deg/s^2\n\n{}\n",
        described->file, described->name, shown_move.position_deg, shown_move.rate_degps,
        shown_move.acceleration_degps2, format_rows(table.map ? explain(*table.map) : explain(*table.dialect)));
  else
    out << "The table is not described by a map or a dialect: there is nothing to explain.\n";
  if (station.chamber)
    out << chamber_line(*station.chamber) << "\n\n" << format_rows(explain(station.chamber->described)) << "\n";
}

struct Options {
  std::string station;
  std::optional<double> heading, pitch, roll;  // present angles of the axes
  double tolerance_deg = 0.1;
  bool accept_guess = false, chamber = false;
  CommissioningSettings settings;
};

// Tries the table. switched_on: whether the drives were on. said_last: what to print after the table was left.
Status commission(const Options& options, const StationConfig& station, LiveDevices& live, std::ostream& out,
                  bool& switched_on, std::string& said_last) {
  const StationDevices devices = live.devices();
  const Status connected = devices.table.connect();
  // With the wrong word order no position may be plausible; commission_table finds the right one.
  if (!connected && !(options.heading && station.table.map)) return connected;
  if (connected) {
    const TableIdentity table = TRY(devices.table.identify());
    out << table.description << std::endl;
    if (const std::string caution = caution_of(station.table); !caution.empty())
      out << "warning: table: " << caution << std::endl;
  }
  if (options.heading) {
    const AxisTriple known{*options.heading, *options.pitch, *options.roll};
    TRY(live.commission_table(known, options.tolerance_deg));
    if (!connected) return connected;
    out << "every axis reads where it stands; no other word order, sign or scale would" << std::endl;
    said_last = is_commissioned(station.table) ? "call this without angles to have the axes moved"
                                               : "write commissioned = true into your copy of the table's file, then "
                                                 "call this again without angles";
    return {};
  }
  if (!is_commissioned(station.table))
    return input_error(
        "the table is not commissioned: expected --heading, --pitch and --roll, the angles (not 0) at which its axes "
        "stand");
  TRY(devices.imu.open());
  switched_on = true;
  said_last = "every axis turns the unit as it should, and gravity is measured where it should be";
  return try_axes(devices, station, options.settings, StopSignals::requests(), out);
}

// Tries the chamber alone: 2 C up and down from its present temperature; the air must follow, and off must be off.
Status commission_chamber(StationConfig station, CommandContext& context) {
  station.chamber->described.commissioned = true;  // it is being commissioned now
  const StopSignals signals;
  std::unique_ptr<LiveDevices> live = TRY(LiveDevices::make(station, StopSignals::requests(), context.out));
  const LinePrefix marked(context.out, context.tag);
  ChamberConfig config = *station.chamber;
  const ChamberLimits& limits = config.described.limits;
  config.settle_s = 10.0;  // it has to get there, not stay there
  ChamberKeeper chamber(*live->chamber(), config, BackgroundQueue::By::thread);
  const StationDevices devices = live->devices();
  const ChamberTime time{
      [&] { return devices.clock.now_s(); }, devices.wait, [] { return StopSignals::any(); }, {}, {}};
  TRY(chamber.connect());
  context.out << live->chamber()->identity() << ": " << chamber.text() << std::endl;
  Status followed;
  const double from_c = TRY(live->chamber()->status()).actual_c;
  for (const double by_c : {2.0, -2.0}) {
    if (!followed) break;
    const double to_c = std::clamp(from_c + by_c, limits.low_c, std::min(limits.high_c, config.limit_unit_c));
    followed = bring_to(chamber, to_c, limits.ramp_c_per_min, time);
    if (followed) context.out << fmt::format("set {:+.1f} C: its air followed, {}", by_c, chamber.text()) << std::endl;
  }
  const Status off = leave_off(chamber, time);
  if (!off) return followed ? off : Status(device_error(followed.error().message + "; " + off.error().message));
  if (!followed) return Error{followed.error().kind, followed.error().message + "; the chamber is off"};
  context.out << "off is off; write commissioned = true into your copy of the chamber's file" << std::endl;
  return {};
}

Status run_commission(const Options& options, CommandContext& context) {
  const StationConfig station = TRY(read_station_config(options.station));
  TRY(check_real_devices(station));
  if (options.chamber && !station.chamber)
    return input_error("--chamber: station '" + station.name + "' has no chamber: expected chamber.file in its file");
  if (station.simulated()) context.tag = simulated_tag;
  if (options.chamber) {
    TRY(check_guesses(station, true, options.accept_guess));
    return commission_chamber(station, context);
  }
  if (station.table.driver == TableDriver::manual)
    return input_error("station '" + station.name + "': a table turned by hand has nothing to commission");
  TRY(check_guesses(station, false, options.accept_guess));
  const StopSignals signals;
  std::unique_ptr<LiveDevices> live = TRY(LiveDevices::make(station, StopSignals::requests(), context.out));
  const LinePrefix marked(context.out, context.tag);
  bool switched_on = false;
  std::string said;
  Status status = commission(options, station, *live, context.out, switched_on, said);
  const std::string how_left = switched_on ? "; " + how_it_rests(live->devices().table) : "; nothing was moved";
  status = live->leave_table(status, how_left);
  if (switched_on && live->left_off())
    if (const std::string sag = live->sag_since({}); !sag.empty()) context.warn(sag);
  if (status) context.out << said << how_left << std::endl;
  return status;
}

constexpr double line_every_s = 1.0;
constexpr double look_every_s = 0.1;  // for a signal, and for a silent unit

struct MonitorOptions {
  std::string station;
  double seconds = 0.0;  // 0: until a signal
};

// Samples received since the last line.
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

// Returns the state in a word, and flags that the word hides.
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
    text += status ? fmt::format("{} {:9.4f} deg {:8.4f} deg/s {}; ", "HPR"[index(axis)], status -> position_deg,
                                 status -> rate_degps, state_text(*status))
                   : fmt::format("{} {}; ", to_string(axis), to_string(state_unread(table)));
  }
  return text;
}

std::string unit_text(const Second& second, const RecordingInfo& info, double seconds) {
  if (second.samples == 0) return "no samples";
  const double weight = info.accel_increment == IncrementKind::pulses ? info.accel_pulse_mps : 1.0;
  const double per_s = weight / (double(second.samples) * info.sample_period_s);
  return fmt::format("{:.1f} samples/s, {} ({} lost), {} flagged, |f| {:.4f} m/s^2", double(second.samples) / seconds,
                     counted(second.gaps, "gap"), second.lost, second.flagged,
                     per_s * std::hypot(second.accel[0], second.accel[1], second.accel[2])) +
         (info.has_temperature ? fmt::format(", {:.2f} C", second.temperature_c) : "");
}

std::string chamber_text(Chamber* chamber) {
  if (!chamber) return "";
  Result<ChamberStatus> now = chamber->status();
  if (!now && chamber->connect()) now = chamber->status();
  if (!now) return now.error().message + "; ";
  return fmt::format("chamber {:.1f} C of {:.1f} C {}{}{}; ", now->actual_c, now->set_point_c, now->on ? "on" : "off",
                     now->door_open.value_or(false) ? ", door open" : "", now->alarm.value_or(false) ? ", alarm" : "");
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
    // Includes samples that came while a slow table was polled.
    for (bool more = true; (more || now_s - line_s < line_every_s) && StopSignals::requests() == 0;) {
      const std::size_t got = TRY(devices.imu.read(buffer, look_every_s));
      add(std::span(buffer).first(got), last_counter, second);
      more = got == buffer.size();
      now_s = devices.clock.now_s();
    }
    const std::uint64_t bad_frames = devices.imu.counters().bad_frames;
    const std::string table_now = table_text(devices.table), chamber_now = chamber_text(live.chamber());
    if (StopSignals::requests() != 0) break;  // the readings of the table were abandoned
    out << fmt::format("{:8.1f} s  ", now_s - began_s) << table_now << chamber_now
        << unit_text(second, info, now_s - line_s);
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
  // Also switches off a drive that another program had switched on.
  return live->leave_table(watch(*live, options.seconds, context.out));
}

struct TwinCommandOptions {
  std::string station, rig;
  TwinSettings settings{.speed_up = 0.0, .table = {}};  // 0: the station's value
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
              << twin->imu_devices()
              << (twin->chamber_address().empty() ? "" : ", chamber at " + twin->chamber_address()) << ", "
              << format_number(settings.speed_up) << " times real time, rig seed " << rig.seed << std::endl;
  const Status status = twin->run(
      StopSignals::requests(), [&context](const std::string& what) { context.out << "[twin] " << what << std::endl; });
  context.out << "[twin] ends at " << fmt::format("{:.3f}", twin->rig_time_s()) << " s of rig time";
  if (twin->batches_dropped() > 0)
    context.out << "; not read in time: " << counted(twin->batches_dropped(), "batch") << " of samples";
  context.out << std::endl;
  return status;
}

struct ServeOptions {
  std::string file, listen = "127.0.0.1:8081";
};

Status serve(const ServeOptions& options, CommandContext& context) {
  const ServiceConfig config = TRY(read_service_config(options.file));
  const std::unique_ptr<ServicePage> page = TRY(ServicePage::open(options.listen, config, wall_utc_s));
  const StopSignals signals;
  context.out << "stations  " << page->url() << std::endl;
  if (!page->loopback())
    context.out << "warning: everybody who reaches " << page->url()
                << " can read the page: it has no access control and is not encrypted" << std::endl;
  while (!StopSignals::any()) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  return {};
}

// Asks what a run of this request would ask before anything moves. Nothing is written, opened or moved.
struct CheckOptions {
  RunRequest request;
  std::string out;       // folder of a run; empty: not checked
  bool explain = false;  // explain the table, too; without a sequence, only that
};

Status run_check(const CheckOptions& options, CommandContext& context) {
  std::ostream& out = context.out;
  RunRequest request = options.request;
  const Result<StationConfig> station = read_station_config(request.station);
  if (options.explain && station) print_devices(*station, out);
  if (request.sequence.empty()) {
    if (!station) return station.error();
    if (!options.explain) return input_error("--sequence is required: the sequence file (or --explain alone)");
    const Against found = against(*station);
    for (const std::vector<std::string>& lines : {found.blocks, found.doubts})
      for (const std::string& line : lines) context.warn(line);
    return {};
  }
  const Result<Sequence> sequence = read_sequence(request.sequence);
  for (const Error* error : {station ? nullptr : &station.error(), sequence ? nullptr : &sequence.error()})
    if (error != nullptr) context.fail({ErrorKind::input, error->message});
  if (!station || !sequence) return {};
  request.dry_run = !station->imu;
  const RunPlan run = TRY(read_run(request));
  Against found = against(*station);
  print_plan(run.sequence, *station, run.plan, out);
  if (station->chamber) out << chamber_line(*station->chamber) << "\n";
  if (!station->simulated() && station->table.driver != TableDriver::manual)
    out << "Computer  " << RealTime().text() << "\n";
  std::vector<Error> blocks = sequence_refusals(run, in_part);
  for (const std::string& line : found.blocks) blocks.push_back(input_error(line));
  const std::vector<Error> refused = preflight(run, options.out, wall_utc_s());
  if (const std::string trouble = server_trouble(*station); !trouble.empty())
    found.doubts.push_back(trouble + "; a run would keep its rows in " + station->outbox + " and send them later");
  blocks.insert(blocks.end(), refused.begin(), refused.end());
  if (refused.empty())
    out << (options.out.empty() ? "\nHooks" : "\nOutput folder, disk space, hooks") << " and due dates are in order.\n";
  // Defects come last, because the plan above is longer than a screen.
  out << (blocks.empty() ? "\nThe station can run this sequence.\n" : "\nThe station cannot run this sequence:\n")
      << std::flush;
  for (const Error& error : blocks) context.fail(error);
  for (const std::string& line : found.doubts) context.warn(line);
  if (std::ranges::any_of(blocks, [](const Error& error) { return error.kind == ErrorKind::input; }))
    context.exit_code = exit_code(ErrorKind::input);
  return {};
}

}  // namespace

void add_check_command(CommandLine& line) {
  const auto [command, options] =
      line.command<CheckOptions>("check", "validate station and sequence, print the plan; nothing moves", run_check);
  RunRequest& request = options.request;
  command.option("--station", request.station, "station configuration; default: the built-in rig station");
  command.option("--sequence", request.sequence, "sequence file; needed unless --explain is given");
  command.flag("--explain", options.explain,
               "print what each operation sends to the table and what its answers mean, to compare with its manual");
  command.flag("--verify", request.verify, "include the north seeking of run --verify");
  command.flag("--partial", request.partial, "check a run that estimates what the sequence determines");
  command.flag("--capture-only", request.capture_only, "check a run that only records");
  command.option("--override-due", request.overdue_reason,
                 "reason for using a table whose calibration is overdue, as for run");
  command.option("--out", options.out, "folder of the run: check that it is writable and has enough space");
  command.option("--unit", request.units, {is::one_word_each}, "serial number of a unit");
}

void add_commission_command(CommandLine& line) {
  const auto [command, options] = line.command<Options>(
      "commission",
      "compare the table's readings with known angles, then move each axis a little and check that the unit senses it",
      run_commission);
  command.option("--station", options.station, {is::required}, "station configuration");
  CLI::Option* const heading =
      command.option("--heading", options.heading, "present angle of the heading axis, degrees; must not be 0");
  CLI::Option* const pitch = command.option("--pitch", options.pitch, "the same for the pitch axis");
  CLI::Option* const roll = command.option("--roll", options.roll, "the same for the roll axis");
  for (CLI::Option* const tilt : {pitch, roll}) {
    needs(heading, tilt);
    needs(tilt, heading);
  }
  command.flag("--accept-guess", options.accept_guess,
               "proceed although lines of the map or dialect that decide what moves are marked [guess]");
  command.flag("--chamber", options.chamber, "try the chamber alone: 2 C both ways, then off; nothing turns");
  command.option("--tolerance", options.tolerance_deg, {is::positive}, "tolerance of these angles, degrees");
  command.option("--move", options.settings.move_deg, {is::in(0.5, 30.0)}, "travel of each axis, degrees");
  command.option("--rate", options.settings.rate_degps, {is::in(0.1, 10.0)},
                 "rate of these moves, deg/s; the first move of each axis uses half of it");
  command.option("--pose", options.settings.pose_deg, {is::in(30.0, 90.0)},
                 "largest tilt of pitch and roll to compare gravity, degrees");
  command.option("--gyro-pulse-arcsec", options.settings.gyro_pulse_arcsec, {is::positive},
                 "nominal weight of a gyro pulse, to check the scale of the gyros against the table");
}

void add_monitor_command(CommandLine& line) {
  const auto [command, options] = line.command<MonitorOptions>(
      "monitor", "show a station's table and unit, one line a second; nothing moves", run_monitor);
  command.option("--station", options.station, {is::required}, "station configuration");
  command.option("--for", options.seconds, {is::time(0.001, 1e9)},
                 "duration in station time; default: until it is interrupted");
}

void add_twin_command(CommandLine& line) {
  const auto [command, options] = line.command<TwinCommandOptions>(
      "twin", "simulate a station's table and unit on real serial or network lines", run_twin);
  command.option("--station", options.station, {is::required},
                 "station configuration: its lines, map or dialect, and frame");
  command.option("--rig", options.rig,
                 "rig configuration (docs/rig.md); default: rig.file of the station, or the built-in one");
  command.option("--speed-up", options.settings.speed_up, {is::in(0.01, 1000.0)},
                 "how many times faster than the wall clock; default: clock.speed_up");
  command.option("--table", options.settings.table,
                 "line of the table: tcp:PORT (0: any free port), pty or pty:LINK; default: the station's");
}

void add_serve_command(CommandLine& line) {
  const auto [command, options] = line.command<ServeOptions>(
      "serve", "serve a page that shows what every station is doing and what needs an operator", serve);
  command.option("stations", options.file, {is::required}, "file with the stations, their queues and folders");
  command.option("--listen", options.listen, {is::default_in_help}, "address and port of the page");
}

}  // namespace turncal
