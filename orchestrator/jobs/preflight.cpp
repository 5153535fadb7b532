#include "orchestrator/jobs/preflight.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <climits>
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "orchestrator/jobs/prediction_job.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

namespace {

constexpr std::uintmax_t bytes_a_sample = 64;       // upper limit, in a binary recording
constexpr std::uintmax_t bytes_beside = 64u << 20;  // journal, log, report, database
constexpr std::size_t longest_file_name = 60;       // of a file made in a folder

Status check_space(const RunPlan& run, const std::string& path) {
  std::error_code error;
  const std::string folder = existing_folder_of(path);
  const std::uintmax_t free = std::filesystem::space(folder, error).available;
  if (error) return device_error(folder + ": its free space cannot be read: " + error.message());
  const std::uintmax_t needed =
      run.request.units.size() * static_cast<std::uintmax_t>(run.plan.samples) * bytes_a_sample + bytes_beside;
  if (free >= needed) return {};
  return device_error(
      fmt::format("{}: {} MiB are free: expected {} MiB for this run", folder, free >> 20, needed >> 20));
}

Status check_names(const std::string& path) {
  const std::filesystem::path whole = std::filesystem::absolute(path);
  for (const std::filesystem::path& part : whole)
    if (part.string().size() > NAME_MAX)
      return input_error("'{}': {} bytes: expected a name of at most {}", part.string(), part.string().size(),
                         NAME_MAX);
  if (whole.string().size() + longest_file_name < PATH_MAX) return {};
  return input_error("{}: too long a path: expected at most {} bytes", whole.string(), PATH_MAX - longest_file_name);
}

// Checks the plan against plausible.angle_deg: a driver rejects positions beyond it, and refuses to move there.
Status check_plausible(const StationConfig& station, const Plan& plan) {
  const TableDescription* const table = station.table.described();
  if (!table) return {};
  double farthest_deg = 0.0;
  Axis axis = Axis::heading;
  for (const PlannedItem& item : plan.items) {
    const double here_deg = std::max(std::abs(item.from_deg), std::abs(item.to_deg));
    if (item.kind != SequenceItem::Kind::move || here_deg <= farthest_deg) continue;
    farthest_deg = here_deg;
    axis = item.axis;
  }
  if (farthest_deg <= table->plausible_deg) return {};
  return input_error("{}: plausible.angle_deg = {}: expected at least {}, as far as the sequence turns {}", table->file,
                     format_number(table->plausible_deg), format_number(farthest_deg), to_string(axis));
}

// Checks that the registers of a map, or the sentences of a dialect, can express every move of the plan and resolve the tolerance.
Status check_moves(const StationConfig& station, const Plan& plan) {
  const TableDescription* const table = station.table.described();
  if (!table) return {};
  const std::optional<RegisterMap>& map = station.table.map;
  for (const Axis axis : all_axes) {
    if (!map) break;
    const double count_deg = 1.0 / map->of(axis).units_per_degree;
    if (is_floating(map->of(axis).position.type) || 0.5 * count_deg <= station.motion.position_tolerance_deg) continue;
    return input_error(
        "{}: axis.{}.counts_per_degree: a count is {} deg: expected at most twice "
        "motion.position_tolerance_deg",
        table->file, to_string(axis), format_number(count_deg));
  }
  for (const PlannedItem& item : plan.items) {
    if (item.kind != SequenceItem::Kind::move) continue;
    Moves moves;
    for (const Axis axis : all_axes)
      moves[index(axis)] = {item.commanded_deg[axis], 0.0, item.rate_degps, item.acceleration_degps2};
    moves[index(item.axis)].distance_deg = item.to_deg - item.from_deg;
    const Status fits =
        map ? check_move(*map, item.axis, moves)
            : check_move(*station.table.dialect, item.axis, moves, station.motion.position_tolerance_deg);
    if (!fits)
      return input_error("{}: {}, for {} to {} deg at {} deg/s", table->file, fits.error().message,
                         to_string(item.axis), format_number(item.to_deg), format_number(item.rate_degps));
  }
  return {};
}

// Returns the shell's message when it cannot parse the command; empty: it can. Nothing is run.
std::string unreadable(const std::string& command) {
  const Result<ChildEnd> end = run_child({.words = {"/bin/sh", "-n", "-c", command},
                                          .package = "",
                                          .environment = {"LC_ALL=C.UTF-8"},
                                          .replaced = "LC_",
                                          .most_printed = std::size_t{1} << 16U});
  return !end || end->good() ? "" : end->errors.substr(0, end->errors.find('\n'));
}

// Checks that the shell can parse the command and find its program. A program that is not a plain word is judged when the hook runs.
Status check_hook(const std::string& name, const std::string& command) {
  if (const std::string said = unreadable(command); !said.empty())
    return input_error(name + " = '" + command + "': expected a command of /bin/sh, which says: " + said);
  const std::string program = command.substr(0, command.find_first_of(" \t"));
  const bool plain = std::ranges::all_of(program, [](unsigned char c) {
    return std::isalnum(c) || c == '/' || c == '.' || c == '_' || c == '-' || c == '+';
  });
  if (program.empty() || !plain) return {};
  if (std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) == 0) return {};
  return input_error(name + " = '" + command + "': there is no command '" + program + "'");
}

// Returns an error after the day of table.calibration_due, unless there is a reason, which goes on record.
Status check_due(const StationConfig& station, double utc_s, const std::string& overdue_reason) {
  const std::string& due = station.table_calibration_due;
  const std::string today = format_utc(utc_s).substr(0, 10);
  // Days in the form 2026-12-31 sort by date.
  if (due.empty() || today <= due || !overdue_reason.empty()) return {};
  return input_error(
      "the calibration of {} was due on {}, today is {}: expected a calibrated table, or --override-due REASON, which "
      "goes on record",
      station.table_id.empty() ? "the table" : "table " + turncal::quoted(station.table_id), due, today);
}

constexpr std::size_t most_predicted = 20000;  // items: some 10 s of a core

}  // namespace

std::vector<Error> preflight(const RunPlan& run, const std::string& folder, double utc_s) {
  std::vector<Error> errors;
  const auto add = [&errors](const Status& status) {
    if (!status) errors.push_back(status.error());
  };
  const StationConfig& station = run.station;
  const std::vector<std::string>& units = run.request.units;
  add(check_due(station, utc_s, run.request.overdue_reason));
  if (station.table.driver != TableDriver::manual) {
    add(check_plausible(station, run.plan));
    add(check_moves(station, run.plan));
  }
  if (!folder.empty()) {
    add(check_folder_writable(folder));
    add(check_space(run, folder));
    for (const std::string& unit : units)
      add(check_names(units.size() > 1 ? folder + "/" + name_of_unit(unit) : folder));
  }
  if (const std::string records = records_file(station); !records.empty())
    add(ResultsDatabase::check_writable(records));  // without a server the rows are kept here
  if (!station.store.empty()) {
    add(check_folder_writable(station.store));
    for (const std::string& unit : units) {
      const std::string kept = unit_folder(station.store, unit, run.simulated());
      add(check_names(kept + "/versions"));
      if (path_exists(kept)) add(check_folder_writable(kept));
    }
  }
  for (const auto& [event, command] : hook_events)
    add(check_hook(std::string("hook.") + event, station.hooks.*command));
  return errors;
}

PlannedMotion planned_motion(const Sequence& sequence, const Plan& plan) {
  return {sequence.start_deg, {plan.items.begin(), plan.items.end()}};
}

std::vector<std::string> undetermined_by(const Sequence& sequence, const Plan& plan, const RecordingInfo& info) {
  if (plan.items.size() > most_predicted) return {};
  PredictOptions options;
  options.noise = noise_model({});
  ParameterVector asked;
  for (int k = 0; k < parameter_count; ++k) asked[k] = parameter_is_free[std::size_t(k)] ? 1.0 : 0.0;
  return open_parameters(predict(info, planned_motion(sequence, plan), options), asked);
}

std::vector<std::string> open_parameters(const Prediction& prediction, const ParameterVector& asked) {
  std::vector<std::string> keys;
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    const bool determined = prediction.valid && prediction.determined[k];
    if (asked[Eigen::Index(k)] > 0.0 && !determined) keys.emplace_back(parameter_keys[k]);
  }
  return keys;
}

std::string coverage_text(const std::vector<std::string>& keys) {
  const bool all = keys.size() == parameter_keys.size() - 3;
  return fmt::format("does not determine {}: expected steps that do (turncal predict)",
                     all ? "any parameter" : fmt::format("{}", fmt::join(keys, " ")));
}

}  // namespace turncal
