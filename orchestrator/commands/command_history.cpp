// `turncal history`: what is in the results database. `turncal restore`: versions of the parameter file in use.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include "imu_io/base/atomic_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line_report/history_document.h"
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

using namespace cell;

Table calibration_list(const Calibrations& all) {
  Table table{{number("id"), name("unit"), text("time"), text("verdict"), text("folder")}};
  for (const StoredCalibration& c : all)
    table.row({count(static_cast<std::size_t>(c.id)), name(c.unit), text(c.time_utc), text(c.verdict),
               text(c.folder + (c.simulated ? "  [simulated]" : ""))});
  return table;
}

Cell as(const char* format, std::optional<double> value) {
  return value ? number(fmt::format(fmt::runtime(format), *value), *value) : number("-");
}

Result<Document> comparison(const Calibrations& all, const std::vector<std::int64_t>& ids) {
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
  Document document{"", "Comparison of unit " + a->unit};
  document.text(fmt::format("unit {}: {} ({}) and {} ({})", a->unit, a->time_utc, a->verdict, b->time_utc, b->verdict));
  Table table{{name("parameter"), number("first"), number("second"), number("difference"), number("/ sigma")}};
  for (const StoredValue& value : a->values) {
    const auto other =
        std::find_if(b->values.begin(), b->values.end(), [&](const auto& v) { return v.key == value.key; });
    if (other == b->values.end()) continue;
    const double difference = other->value - value.value;
    const double sigma = std::hypot(value.sigma.value_or(0.0), other->sigma.value_or(0.0));
    table.row({name(value.key), as("{:.10g}", value.value), as("{:.10g}", other->value), as("{:.3e}", difference),
               sigma > 0.0 ? fixed(difference / sigma, 2) : number("-")});
  }
  document.add(std::move(table));
  return document;
}

Result<Document> parameter_document(const Calibrations& all, const std::string& key) {
  if (std::find(parameter_keys.begin(), parameter_keys.end(), key) == parameter_keys.end()) {
    return input_error("--parameter '" + key + "': expected one of the 24 keys, N01 to a33");
  }
  const ParameterHistory history = parameter_history(all, key);
  const ControlChart& chart = history.chart;
  Document document{"", "Parameter " + key};
  Table table{{number("id"), name("unit"), text("time"), number(key), number("sigma"), text("control")}};
  for (std::size_t i = 0; i < history.values.size(); ++i) {
    const bool outside = std::find(chart.outside.begin(), chart.outside.end(), i) != chart.outside.end();
    table.row({count(static_cast<std::size_t>(history.of[i]->id)), name(history.of[i]->unit),
               text(history.of[i]->time_utc), as("{:.8g}", history.values[i]), as("{:.2e}", history.sigmas[i]),
               text(outside ? "outside the control limits" : "")});
  }
  document.add(std::move(table));
  const auto said = [](std::optional<double> value) { return as("{:.8g}", value).words; };
  document.text(fmt::format("{}: n {}, mean {:.8g}, control limits {} .. {}, limits {} .. {}, Cpk {}", key, chart.count,
                            chart.mean, said(chart.lower), said(chart.upper), said(history.limit.min),
                            said(history.limit.max), chart.cpk ? fmt::format("{:.2f}", chart.cpk->value) : "-"));
  return document;
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
  if (!options.csv.empty()) {
    TRY(write_named(options.csv, calibrations_table(all).csv()));
    out << all.size() << " calibrations in " << options.csv << '\n';
    return {};
  }
  const auto print = [&](const Document& document) {
    out << (options.format.empty() ? as_text(document) : as_json(document)) << std::flush;
    return Status{};
  };
  if (!options.compare.empty()) return print(TRY(comparison(all, options.compare)));
  if (!options.parameter.empty()) return print(TRY(parameter_document(all, options.parameter)));
  if (options.control || !options.report.empty()) {
    const Document charts = history_document(
        all,
        options.database + (options.filter.unit.empty() ? ", all units together" : ", unit " + options.filter.unit));
    if (options.report.empty()) return print(charts);
    TRY(write_named(options.report, as_page(charts).html));
    out << "control charts of " << all.size() << " calibrations in " << options.report << '\n';
    return {};
  }
  out << (options.format.empty() ? as_text(calibration_list(all)) : calibrations_table(all).as(options.format))
      << std::flush;
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
  Table table{{number("id"), name("unit"), text("time"), text("outcome"), text("station"), text("temperature, °C"),
               number("residual"), text("reason")}};
  for (const AttemptRecord& a : all) {
    const std::string temperature =
        a.temperature_min_c ? fmt::format("{:.1f} .. {:.1f}", *a.temperature_min_c, a.temperature_max_c.value_or(0.0))
                            : "-";
    table.row({count(static_cast<std::size_t>(a.id)), name(a.unit), text(a.time_utc), text(a.outcome), text(a.station),
               text(temperature), as("{:.3f}", a.residual),
               text(shorten(a.reason, 200) + (a.simulated ? "  [simulated]" : ""))});
  }
  out << as_text(table);
  return {};
}

Status show_history(const HistoryOptions& options, std::ostream& out) {
  if (!options.format.empty() && (!options.csv.empty() || !options.report.empty()))
    return input_error("--format: prints: expected no --csv or --report, which write a file");
  if (options.format == "csv" && (!options.compare.empty() || !options.parameter.empty() || options.control))
    return input_error("--format csv: is of the list: expected no --compare, --parameter or --control");
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
      out << fmt::format("{:4}  damaged\n", version.number);
      if (damaged) damaged = version.status;
      continue;
    }
    out << fmt::format("{:4}  {:<20}  recording {}{}{}\n", version.number, version.file.time_utc,
                       version.file.recording_hash, version.file.simulated ? "  [simulated]" : "",
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
  command
      .option("--format", options->format,
              "print the calibrations with all values in this form; json: of the others, too")
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
