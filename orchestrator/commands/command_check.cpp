#include "orchestrator/commands/command_check.h"

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>

#include "imu_io/base/text_pieces.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/real_time.h"
#include "orchestrator/devices/station_rig.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/jobs/sequence_coverage.h"
#include "orchestrator/records/station_records.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

std::string determines_text(const Step& step) {
  std::string text;
  for (const std::string& key : step.determines) {
    text += (text.empty() ? "  determines " : " ") + key;
  }
  return text;
}

void print_item(const PlannedItem& item, std::ostream& out) {
  const std::string start = format_duration(item.start_s);
  if (item.kind == SequenceItem::Kind::dwell) {
    out << formatted("  %8s  %-6s  %-28s %26s %8.1f s  %lld samples\n", start.c_str(),
                     item.dwell_kind == SegmentKind::align ? "align" : "dwell", "", "", item.duration_s,
                     static_cast<long long>(item.samples));
    return;
  }
  out << formatted("  %8s  %-6s  %-7s %8.6g -> %-8.6g %6.6g deg/s %6.6g deg/s^2 %8.1f s%s\n", start.c_str(), "rotate",
                   to_string(item.axis), item.from_deg, item.to_deg, item.rate_degps, item.acceleration_degps2,
                   item.duration_s, item.positioning ? "  to the initial position" : "");
}

void print_totals(const StationConfig& station, const Plan& plan, std::ostream& out) {
  out << "\nTravel, deg   planned            soft limits        cable wound / allowed   turned in all\n";
  for (const Axis axis : all_axes) {
    const AxisLimits& limit = station.axis[index(axis)];
    const std::string allowed = limit.wrap_deg > 0.0 ? formatted("%.6g", limit.wrap_deg) : "no limit";
    out << formatted("  %-8s %7.6g to %-7.6g %7.6g to %-7.6g %9.6g / %-9s %12.6g\n", to_string(axis),
                     plan.travel_min_deg[axis], plan.travel_max_deg[axis], limit.soft_min_deg, limit.soft_max_deg,
                     plan.wrap_used_deg[axis], allowed.c_str(), plan.turned_deg[axis]);
  }
  out << formatted("\nMoves       %d\nDwells      %d (%d alignments, %d static)\nSamples     %lld\n", plan.moves,
                   plan.align_dwells + plan.still_dwells, plan.align_dwells, plan.still_dwells,
                   static_cast<long long>(plan.samples));
  out << formatted("Total time  %s (%.10g s), of which moving %s (%.10g s)\n", format_duration(plan.station_s).c_str(),
                   plan.station_s, format_duration(plan.moving_s).c_str(), plan.moving_s);
}

Result<RecordingInfo> info_of(const StationConfig& station) {
  if (station.imu) return planned_info(station, nullptr);
  const RigConfig rig = TRY(rig_of(station));
  return planned_info(station, &rig);
}

}  // namespace

void print_plan(const Sequence& sequence, const StationConfig& station, const Plan& plan, std::ostream& out) {
  const double period_s = plan.samples > 0 ? plan.station_s / static_cast<double>(plan.samples) : 0.0;
  out << "Sequence  " << sequence.file << " (" << sequence.name << ", " << sequence.steps.size() << " steps)\n";
  out << "Station   " << (station.file.empty() ? "built in" : station.file) << " (" << station.name << ")\n";
  out << formatted("Site      latitude %.10g deg, gravity %.10g m/s^2; IMU at %.6g Hz; settling %.6g s\n",
                   station.latitude_deg, station.gravity_mps2, 1.0 / period_s, station.motion.settle_s);
  out << formatted("Start     heading %.6g, pitch %.6g, roll %.6g deg\n", sequence.start_deg[Axis::heading],
                   sequence.start_deg[Axis::pitch], sequence.start_deg[Axis::roll]);
  std::size_t shown_steps = 0;
  for (const PlannedItem& item : plan.items) {
    if (item.step_index == shown_steps) {
      const Step& step = sequence.steps[shown_steps++];
      out << "\nStep " << step.number << "  " << step.title << determines_text(step) << "\n";
    }
    print_item(item, out);
  }
  print_totals(station, plan, out);
}

std::vector<std::string> guesses_of(const StationConfig& station, bool moving) {
  std::vector<std::string> guesses;
  const auto add = [&](const std::string& file, const std::vector<LineSource>& lines) {
    for (const LineSource& line : lines)
      if (line.is_guess() && (!moving || decides_motion(line.key)))
        guesses.push_back(file + ":" + std::to_string(line.line) + ": " + line.key + " is a guess");
  };
  const TableConfig& table = station.table;
  if (table.map) add(table.map->file, table.map->lines);
  if (table.dialect) add(table.dialect->file, table.dialect->lines);
  if (station.imu && !moving) add(station.imu->frame.file, station.imu->frame.lines);
  return guesses;
}

std::string caution_of(const TableConfig& table) {
  return table.map ? caution_of(*table.map) : table.dialect ? caution_of(*table.dialect) : "";
}

bool is_commissioned(const TableConfig& table) {
  return (!table.map || table.map->commissioned) && (!table.dialect || table.dialect->commissioned);
}

// What is left to be done at the station itself before a run can begin, a line each.
std::vector<std::string> left_to_do(const StationConfig& station) {
  std::vector<std::string> lines;
  const TableConfig& table = station.table;
  const auto unset = [&lines](const std::string& key, const std::string& value) {
    if (value.find("SET-ME") != std::string::npos)
      lines.push_back(key + " = " + turncal::quoted(value) + ": expected the name of this station's line");
  };
  if (table.map) unset("table.address", table.map->link.address);
  if (table.dialect) unset("table.address", table.dialect->link.address);
  if (station.imu) unset("imu.device", station.imu->settings.device);
  if (!is_commissioned(table))
    lines.push_back("the table is not commissioned: turncal commission comes before the first run");
  const std::vector<std::string> guesses = guesses_of(station, false);
  lines.insert(lines.end(), guesses.begin(), guesses.end());
  if (!guesses_of(station, true).empty())
    lines.push_back("some of these guesses decide what moves: commission needs --accept-guess");
  return lines;
}

void print_table(const StationConfig& station, std::ostream& out) {
  const TableConfig& table = station.table;
  const TableDescription* described = nullptr;
  if (table.map) described = &*table.map;
  if (table.dialect) described = &*table.dialect;
  if (described == nullptr) {
    out << "The table is not described by a map or a dialect: there is nothing to explain.\n";
    return;
  }
  out << "Table     " << described->file << " (" << described->name << ")\nMove      shown from 0 to "
      << formatted("%.10g deg at %.10g deg/s and %.10g deg/s^2\n\n", shown_move.position_deg, shown_move.rate_degps,
                   shown_move.acceleration_degps2)
      << format_rows(table.map ? explain(*table.map) : explain(*table.dialect)) << "\n";
}

int run_check(const CheckOptions& options, std::ostream& out, std::ostream& err) {
  const Result<StationConfig> station =
      options.station.empty() ? Result<StationConfig>(default_station_config()) : read_station_config(options.station);
  if (options.explain && station) print_table(*station, out);
  if (options.sequence.empty()) {
    if (!station) err << station.error().message << "\n";
    if (station && !options.explain) err << "--sequence is required: the sequence file (or --explain alone)\n";
    if (!station || !options.explain) return exit_code(ErrorKind::input);
    for (const std::string& line : left_to_do(*station)) err << "warning: " << line << "\n";
    return 0;
  }
  Result<Sequence> sequence = read_sequence(options.sequence);
  const Result<RecordingInfo> info = station ? info_of(*station) : Result<RecordingInfo>(RecordingInfo{});
  for (const Error* error :
       {station ? nullptr : &station.error(), info ? nullptr : &info.error(), sequence ? nullptr : &sequence.error()}) {
    if (error != nullptr) {
      err << error->message << "\n";
    }
  }
  if (!station || !sequence || !info) {
    return exit_code(ErrorKind::input);
  }
  // A station whose unit is the rig's is rehearsed with --dry-run; a real unit does not feel what a mock table does.
  if (station->table.driver == TableDriver::mock && station->imu_driver != ImuDriver::rig) {
    err << check_real_devices(*station).error().message << "\n";
    return exit_code(ErrorKind::input);
  }
  if (const std::string caution = caution_of(station->table); !caution.empty()) {
    err << "warning: table: " << caution << "\n";
  }
  for (const std::string& line : left_to_do(*station)) err << "warning: " << line << "\n";
  const PlanLimits limits = plan_limits(*station, info->sample_period_s);
  Plan plan = make_plan(*sequence, limits);
  const std::vector<std::string> keys = undetermined_by(*sequence, plan, *info);
  if ((station->verify_run || options.verify) && keys.empty()) {  // as a run does, but with --partial
    if (const Result<int> from = append_north_seeking(*station, *sequence); !from) {
      err << from.error().message << "\n";
      return exit_code(from.error().kind);
    }
    plan = make_plan(*sequence, limits);
  }
  print_plan(*sequence, *station, plan, out);
  if (!station->simulated() && station->table.driver != TableDriver::manual)
    out << "Computer  " << RealTime().text() << "\n";
  for (const std::string& violation : plan.violations) {
    err << violation << "\n";
  }
  if (!keys.empty()) {
    out << "\nThis sequence " << coverage_text(keys) << ".\n";
  }
  const std::vector<Error> found = preflight({.station = *station,
                                              .plan = plan,
                                              .folder = options.out,
                                              .units = options.units,
                                              .utc_s = wall_utc_s(),
                                              .simulated = station->simulated(),
                                              .overdue_reason = options.overdue_reason});
  for (const Error& error : found) err << error.message << "\n";
  if (const std::string trouble = server_trouble(*station); !trouble.empty())
    err << "warning: " << trouble << "; a run would keep its rows in " << station->outbox << " and send them later\n";
  if (found.empty()) out << "\nWhat can be written, the room for it, hooks and due dates are in order.\n";
  const bool good = plan.ok() && found.empty();
  out << (!good ? "\nThe station cannot run this sequence.\n"
          : keys.empty()
              ? "\nThe station can run this sequence.\n"
              : "\nThe station can run this sequence with --partial or --capture-only; without, it is refused.\n");
  return good ? 0 : exit_code(plan.ok() ? found.front().kind : ErrorKind::input);
}

void add_check_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<CheckOptions>();
  const Command command = line.command("check", "validate station and sequence, print the plan; nothing moves");
  command.option("--station", options->station, "station configuration; default: the built-in rig station");
  command.option("--sequence", options->sequence, "sequence file; needed unless --explain is given");
  command.flag("--explain", options->explain,
               "print what the table is sent and what its answers mean, for each operation and axis, to be held "
               "against its manual");
  command.flag("--verify", options->verify, "with the north seeking after it, as run --verify");
  command.option("--override-due", options->overdue_reason, "accept a table whose calibration is overdue, as run does");
  command.option("--out", options->out, "folder that a run is to write to: can it, and is there room?");
  command.option("--unit", options->units, "serial number of a unit to be run").one_word_each();
  command.prints(context, [options, &context]() -> Status {
    context.exit_code = run_check(*options, context.out, context.err);
    return {};
  });
}

}  // namespace turncal
