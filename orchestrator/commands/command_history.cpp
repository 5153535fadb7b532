// `turncal history`: what is in the results database. `turncal restore`: versions of the parameter file in use.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <set>

#include "imu_io/base/atomic_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line_report/history_page.h"
#include "orchestrator/line_report/history_table.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

namespace {

using Calibrations = std::vector<StoredCalibration>;

struct HistoryOptions {
  std::string database, parameter, csv, report, format;
  RecordFilter filter;
  std::vector<std::int64_t> compare;
  bool attempts = false, control = false, simulated = false, together = false;
};

// A control chart is of one unit, unless the spread between units is asked for.
Status check_one_unit(const HistoryOptions& options, const Calibrations& all) {
  std::set<std::string> units;
  for (const StoredCalibration& c : all) units.insert(c.unit);
  if (units.size() <= 1 || options.together) return {};
  return input_error(options.database + ": holds " + std::to_string(units.size()) +
                     " units, of which control limits and Cpk would be one mixture: expected --unit SERIAL, or "
                     "--together for all of them on purpose");
}

void print_list(const Calibrations& all, std::ostream& out) {
  print_line(out, "%5s  %-20s  %-20s  %-16s  %s", "id", "unit", "time", "verdict", "folder");
  for (const StoredCalibration& c : all) {
    print_line(out, "%5lld  %-20s  %-20s  %-16s  %s%s", static_cast<long long>(c.id), c.unit.c_str(),
               c.time_utc.c_str(), c.verdict.c_str(), c.folder.c_str(), c.simulated ? "  [simulated]" : "");
  }
}

Status print_comparison(const Calibrations& all, const std::vector<std::int64_t>& ids, std::ostream& out) {
  const StoredCalibration* pair[2] = {};
  for (std::size_t i = 0; i < 2; ++i) {
    for (const StoredCalibration& c : all) {
      if (c.id == ids[i]) pair[i] = &c;
    }
    if (!pair[i])
      return input_error("--compare " + std::to_string(ids[i]) + ": expected the id of a calibration in the list");
  }
  const auto& [a, b] = pair;
  if (a->unit != b->unit) {
    return input_error("--compare: " + std::to_string(ids[0]) + " is of unit '" + a->unit + "', " +
                       std::to_string(ids[1]) + " of unit '" + b->unit + "': expected two of one unit");
  }
  out << "unit " << a->unit << ": " << a->time_utc << " (" << a->verdict << ") and " << b->time_utc << " ("
      << b->verdict << ")\n";
  print_line(out, "%-5s %18s %18s %12s %12s", "", "first", "second", "difference", "/ sigma");
  for (const StoredValue& value : a->values) {
    const auto other =
        std::find_if(b->values.begin(), b->values.end(), [&](const auto& v) { return v.key == value.key; });
    if (other == b->values.end()) continue;
    const double difference = other->value - value.value;
    const double sigma = std::hypot(value.sigma.value_or(0.0), other->sigma.value_or(0.0));
    char ratio[40] = "-";
    if (sigma > 0.0) std::snprintf(ratio, sizeof ratio, "%.2f", difference / sigma);
    print_line(out, "%-5s %18.10g %18.10g %12.3e %12s", value.key.c_str(), value.value, other->value, difference,
               ratio);
  }
  return {};
}

std::string number(std::optional<double> value, const char* format = "%.8g") {
  char text[40] = "-";
  if (value) std::snprintf(text, sizeof text, format, *value);
  return text;
}

std::optional<double> value_of(const std::optional<Capability>& index) {
  return index ? std::optional(index->value) : std::nullopt;
}

void print_control(const Calibrations& all, std::ostream& out) {
  print_line(out, "%-5s %5s %15s %15s %15s %8s %8s", "", "n", "mean", "lower", "upper", "outside", "Cpk");
  for (const std::string_view key : free_parameter_keys()) {
    const ParameterHistory history = parameter_history(all, key);
    const ControlChart& chart = history.chart;
    print_line(out, "%-5s %5zu %15.8g %15s %15s %8zu %8s", std::string(key).c_str(), chart.count, chart.mean,
               number(chart.lower).c_str(), number(chart.upper).c_str(), chart.outside.size(),
               number(value_of(chart.cpk), "%.2f").c_str());
  }
}

Status print_parameter(const Calibrations& all, const std::string& key, std::ostream& out) {
  if (std::find(parameter_keys.begin(), parameter_keys.end(), key) == parameter_keys.end()) {
    return input_error("--parameter '" + key + "': expected one of the 24 keys, N01 to a33");
  }
  const ParameterHistory history = parameter_history(all, key);
  const ControlChart& chart = history.chart;
  for (std::size_t i = 0; i < history.values.size(); ++i) {
    const bool outside = std::find(chart.outside.begin(), chart.outside.end(), i) != chart.outside.end();
    print_line(out, "%5lld  %-20s  %-20s  %15.8g  %10s%s", static_cast<long long>(history.of[i]->id),
               history.of[i]->unit.c_str(), history.of[i]->time_utc.c_str(), history.values[i],
               number(history.sigmas[i], "%.2e").c_str(), outside ? "  outside the control limits" : "");
  }
  print_line(out, "%s: n %zu, mean %.8g, control limits %s .. %s, limits %s .. %s, Cpk %s", key.c_str(), chart.count,
             chart.mean, number(chart.lower).c_str(), number(chart.upper).c_str(), number(history.limit.min).c_str(),
             number(history.limit.max).c_str(), number(value_of(chart.cpk), "%.2f").c_str());
  return {};
}

// The first 40 bytes tell the table, and the page, from every other file.
Status write_named(const std::string& path, const std::string& text) {
  TRY(check_replaceable(path, std::string_view(text).substr(0, 40)));
  return write_file_atomically(path, text);
}

Status print_history(const HistoryOptions& options, Calibrations all, std::ostream& out) {
  // Simulated and real units are never in one list of numbers.
  if (options.control || !options.parameter.empty() || !options.report.empty()) {
    const std::size_t others =
        std::erase_if(all, [&](const StoredCalibration& c) { return c.simulated != options.simulated; });
    if (all.empty() && others > 0)
      return input_error(
          options.database + ": all " + std::to_string(others) + " calibrations are of " +
          (options.simulated ? "real units: expected no --simulated" : "dry runs: expected --simulated"));
    TRY(check_one_unit(options, all));
  }
  if (!options.format.empty()) {
    out << calibrations_table(all).as(options.format) << std::flush;
    return {};
  }
  if (!options.csv.empty()) {
    TRY(write_named(options.csv, calibrations_table(all).csv()));
    out << all.size() << " calibrations in " << options.csv << '\n';
    return {};
  }
  if (!options.compare.empty()) return print_comparison(all, options.compare, out);
  if (!options.report.empty()) {
    const std::string source =
        options.database + (options.filter.unit.empty() ? ", all units together" : ", unit " + options.filter.unit);
    TRY(write_named(options.report, history_page(all, source)));
    out << "control charts of " << all.size() << " calibrations in " << options.report << '\n';
    return {};
  }
  if (!options.parameter.empty()) return print_parameter(all, options.parameter, out);
  options.control ? print_control(all, out) : print_list(all, out);
  return {};
}

Status show_attempts(const HistoryOptions& options, const ResultsDatabase& database, std::ostream& out) {
  const std::vector<AttemptRecord> all = TRY(database.attempts(options.filter));
  if (!options.format.empty()) {
    out << attempts_table(all).as(options.format) << std::flush;
    return {};
  }
  if (!options.csv.empty()) {
    TRY(write_named(options.csv, attempts_table(all).csv()));
    out << all.size() << " attempts in " << options.csv << '\n';
    return {};
  }
  print_line(out, "%5s  %-20s  %-20s  %-16s  %-12s  %-14s  %8s  %s", "id", "unit", "time", "outcome", "station",
             "temperature, C", "residual", "reason");
  for (const AttemptRecord& a : all) {
    const std::string temperature =
        a.temperature_min_c ? number(a.temperature_min_c, "%.1f") + " .. " + number(a.temperature_max_c, "%.1f") : "-";
    print_line(out, "%5lld  %-20s  %-20s  %-16s  %-12s  %-14s  %8s  %s%s", static_cast<long long>(a.id), a.unit.c_str(),
               a.time_utc.c_str(), a.outcome.c_str(), a.station.c_str(), temperature.c_str(),
               number(a.residual, "%.3f").c_str(), shorten(a.reason, 200).c_str(), a.simulated ? "  [simulated]" : "");
  }
  return {};
}

Status show_history(const HistoryOptions& options, std::ostream& out) {
  if (!options.format.empty() && (!options.csv.empty() || !options.compare.empty() || !options.report.empty() ||
                                  !options.parameter.empty() || options.control))
    return input_error("--format: is of the list: expected no --csv, --compare, --report, --parameter or --control");
  if (options.attempts &&
      (!options.compare.empty() || !options.report.empty() || !options.parameter.empty() || options.control))
    return input_error(
        "--attempts: expected no --compare, --report, --parameter or --control, which are of calibrations");
  TRY(check(options.filter));
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(options.database));
  TRY(database.check_known(options.filter));
  if (options.attempts) return show_attempts(options, database, out);
  Calibrations all = TRY(database.list(options.filter, ""));
  std::string damaged;
  int more = -1;
  for (const StoredCalibration& c : all) {
    if (c.defect.empty()) continue;
    if (damaged.empty()) damaged = c.defect;
    ++more;
  }
  // A row that is not what its parameter file says is shown in the list, and used for nothing.
  const bool listed = options.csv.empty() && options.format.empty() && options.compare.empty() &&
                      options.report.empty() && options.parameter.empty() && !options.control;
  if (!listed) std::erase_if(all, [](const StoredCalibration& c) { return !c.defect.empty(); });
  TRY(print_history(options, std::move(all), out));
  if (damaged.empty()) return {};
  return input_error(damaged + (more > 0 ? " (and " + std::to_string(more) + " more rows)" : ""));
}

struct RestoreOptions {
  std::string store, unit;
  int version = 0;
  bool simulated = false;
};

Status restore(const RestoreOptions& options, std::ostream& out) {
  if (options.version > 0) {
    TRY(restore_version(options.store, options.unit, options.version, options.simulated));
  }
  const std::vector<StoredVersion> versions = TRY(stored_versions(options.store, options.unit, options.simulated));
  Status damaged;
  for (const StoredVersion& version : versions) {
    if (!version.status) {
      print_line(out, "%4d  damaged", version.number);
      if (damaged) damaged = version.status;
      continue;
    }
    print_line(out, "%4d  %-20s  recording %s%s%s", version.number, version.file.time_utc.c_str(),
               version.file.recording_hash.c_str(), version.file.simulated ? "  [simulated]" : "",
               version.in_use ? "  in use" : "");
  }
  return damaged;
}

}  // namespace

void add_filter_options(const Command& command, RecordFilter& filter) {
  command.option("--station", filter.station, "of this station only");
  command.option("--part", filter.part, "of this part only");
  command.option("--from", filter.from, "from this time on, UTC: 2026-01-31 or 2026-01-31T06:00:00Z");
  command.option("--to", filter.to, "up to this time; a date: to its end");
}

void add_history_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<HistoryOptions>();
  const Command command = line.command("history", "list, compare and export what is in the results database");
  command.option("database", options->database, "the station's record.database").required();
  add_filter_options(command, options->filter);
  command.option("--unit", options->filter.unit, "of this unit only");
  command.option("--verdict", options->filter.verdict, "with this verdict or outcome only: pass, hold, dropped, ...");
  command.flag("--attempts", options->attempts, "every attempt, also those that were refused, aborted, or failed");
  command.option("--compare", options->compare, "two ids: the differences of one unit's parameters").words(2);
  command.flag("--control", options->control, "every parameter over all calibrations: control limits and Cpk");
  command.option("--parameter", options->parameter, "one parameter, calibration by calibration");
  command.option("--report", options->report, "writes a page (HTML) with the control charts of every parameter");
  command.flag("--simulated", options->simulated, "of the dry runs, for --control, --parameter and --report");
  command.flag("--together", options->together, "charts of all units in one: the spread between them");
  command.option("--csv", options->csv, "writes the calibrations with all values to this file");
  command.option("--format", options->format, "print the calibrations with all values in this form")
      .one_of(data_formats);
  command.prints(context, [options, &context] { return show_history(*options, context.out); });
}

void add_restore_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<RestoreOptions>();
  const Command command =
      line.command("restore", "list the versions of a unit's parameter file, bring one back into use");
  command.option("store", options->store, "the station's record.store").required();
  command.option("--unit", options->unit, "serial number of the unit").required();
  command.option("--version", options->version, "the version to bring back; without it they are listed").positive();
  command.flag("--simulated", options->simulated, "of the dry runs");
  command.prints(context, [options, &context] { return restore(*options, context.out); });
}

}  // namespace turncal
