// `turncal history`, `shift`, `records`: the contents of the results database, and the upkeep of it and of the folders of runs.
//
// `records prune`: removes a recording when its run has given its unit a verdict other than `hold`, it was sealed more than so many days ago, its
// unit has a newer one of a finished run, and no process works in the run's folder. Its results stay, and the log names what was removed.
// Unreadable ones are left as they are, and are an error at the end.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>

#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line/shift_report.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

using Calibrations = std::vector<StoredCalibration>;

struct HistoryOptions {
  std::string database, parameter, report, format;
  RecordFilter filter;
  std::vector<std::int64_t> compare;
  bool attempts = false, control = false, simulated = false, together = false;
};

// Requires one unit for a control chart, unless the spread between units is requested.
Status check_one_unit(const HistoryOptions& options, const Calibrations& all) {
  std::set<std::string> units;
  for (const StoredCalibration& c : all) units.insert(c.unit);
  if (units.size() <= 1 || options.together) return {};
  return input_error(
      "{}: holds {} units, whose control limits and Cpk would be mixed: expected --unit SERIAL, or --together to "
      "chart them together",
      options.database, units.size());
}

using namespace cell;

Table calibration_list(const Calibrations& all) {
  Table table{{number("id"), name("unit"), text("time"), text("verdict"), text("folder")}};
  for (const StoredCalibration& c : all)
    table.row({count(std::size_t(c.id)), name(c.unit), text(c.time_utc), word(c.verdict),
               text(c.folder + (c.simulated ? "  [simulated]" : ""))});
  return table;
}

Result<Document> comparison(const Calibrations& all, const std::vector<std::int64_t>& ids) {
  const StoredCalibration* pair[2] = {};
  for (std::size_t i = 0; i < 2; ++i) {
    for (const StoredCalibration& c : all)
      if (c.id == ids[i]) pair[i] = &c;
    if (!pair[i])
      return input_error("--compare " + std::to_string(ids[i]) + ": expected the id of a calibration in the list");
  }
  const auto& [a, b] = pair;
  if (a == b) return input_error("--compare: {} twice: expected two calibrations", ids[0]);
  if (a->unit != b->unit)
    return input_error("--compare: {} is of unit '{}', {} of unit '{}': expected two of one unit", ids[0], a->unit,
                       ids[1], b->unit);
  Document document{"", "Comparison of unit " + a->unit};
  document.text(fmt::format("unit {}: {} ({}) and {} ({})", a->unit, a->time_utc, in_words(a->verdict), b->time_utc,
                            in_words(b->verdict)));
  Table table{{name("parameter"), text("meaning"), text("unit"), number("first"), number("second"),
               number("difference"), number("/ sigma")}};
  for (const StoredValue& value : a->values) {
    const auto other = std::ranges::find_if(b->values, [&](const auto& v) { return v.key == value.key; });
    if (other == b->values.end()) continue;
    const double difference = other->value - value.value;
    const double sigma = std::hypot(value.sigma.value_or(0.0), other->sigma.value_or(0.0));
    table.row({name(value.key), text(quantity_name(value.key)),
               text(unit_text(parameter_unit(value.key, a->gyro_increment))), with_sigma(value.value, sigma),
               with_sigma(other->value, sigma), with_sigma(difference, sigma),
               sigma > 0.0 ? fixed(difference / sigma, 2) : number("-")});
  }
  document.add(std::move(table));
  return document;
}

Result<Document> parameter_document(const Calibrations& all, const std::string& key) {
  if (std::ranges::find(parameter_keys, key) == parameter_keys.end())
    return input_error("--parameter '" + key + "': expected one of the 24 keys, N01 to a33" +
                       did_you_mean(key, {parameter_keys.begin(), parameter_keys.end()}));
  const auto [history, of] = parameter_history(all, key);
  const std::vector<std::size_t>& beyond = history.chart.outside;
  Document document{"", "Parameter " + key};
  Table table{{number("id"), name("unit"), text("time"), number(key), number("sigma"), text("control")}};
  for (std::size_t i = 0; i < history.values.size(); ++i) {
    const bool outside = std::ranges::find(beyond, i) != beyond.end();
    table.row({count(std::size_t(of[i]->id)), name(of[i]->unit), text(of[i]->time_utc),
               with_sigma(history.values[i], history.sigmas[i].value_or(0.0)), number(history.sigmas[i], 2),
               text(outside ? "outside the control limits" : "")});
  }
  document.add(std::move(table));
  add_control_table({history}, document);
  return document;
}

Status print_history(const HistoryOptions& options, Calibrations all, std::ostream& out) {
  // Simulated and real units are never in one list of numbers.
  if (options.control || !options.parameter.empty() || !options.report.empty()) {
    const std::size_t others =
        std::erase_if(all, [&](const StoredCalibration& c) { return c.simulated != options.simulated; });
    if (all.empty() && others > 0)
      return input_error("{}: {}, of {}", options.database, counted(others, "calibration"),
                         options.simulated ? "real units: expected no --simulated" : "dry runs: expected --simulated");
    TRY(check_one_unit(options, all));
  }
  const auto print = [&](const Document& document) {
    out << as(options.format, document) << std::flush;
    return Status{};
  };
  if (!options.compare.empty()) return print(TRY(comparison(all, options.compare)));
  if (!options.parameter.empty()) return print(TRY(parameter_document(all, options.parameter)));
  if (options.control || !options.report.empty()) {
    const Document charts = history_document(
        all,
        options.database + (options.filter.unit.empty() ? ", all units together" : ", unit " + options.filter.unit));
    if (options.report.empty()) return print(charts);
    TRY(check_replaceable(options.report, "<!DOCTYPE html>"));
    TRY(write_file_atomically(options.report, as_page(charts).html));
    out << "control charts of " << counted(std::ssize(all), "calibration") << " in " << options.report << '\n';
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
  Table table{{number("id"), name("unit"), text("time"), text("outcome"), text("station"), text("temperature, °C"),
               number("residual"), text("reason")}};
  for (const AttemptRecord& a : all) {
    const std::string temperature =
        a.temperature_min_c ? fmt::format("{:.1f} .. {:.1f}", *a.temperature_min_c, a.temperature_max_c.value_or(0.0))
                            : "-";
    table.row({count(std::size_t(a.id)), name(a.unit), text(a.time_utc), word(a.outcome), text(a.station),
               text(temperature), number(a.residual, 4),
               text(shorten(a.reason, 200) + (a.simulated ? "  [simulated]" : ""))});
  }
  out << as_text(table);
  return {};
}

Status show_history(const HistoryOptions& options, CommandContext& context) {
  std::ostream& out = context.out;
  if (!options.format.empty() && !options.report.empty())
    return input_error("--format: prints the list: expected no --report, which writes a file");
  const bool charts = !options.compare.empty() || !options.parameter.empty() || options.control;
  if (options.format == "csv" && charts)
    return input_error("--format csv: only for the list: expected no --compare, --parameter or --control");
  if (options.attempts && (charts || !options.report.empty()))
    return input_error(
        "--attempts: expected no --compare, --report, --parameter or --control, which list calibrations");
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
  // A row that differs from its parameter file is listed, and used for nothing else.
  const bool listed = options.format.empty() && !charts && options.report.empty();
  if (!listed) std::erase_if(all, [](const StoredCalibration& c) { return !c.defect.empty(); });
  TRY(print_history(options, std::move(all), out));
  if (damaged.empty()) return {};
  return input_error(damaged + (more > 0 ? " (and " + counted(more, "more row") + ")" : ""));
}

struct RestoreOptions {
  std::string store, unit;
  int version = 0;
  bool simulated = false;
};

Status restore(const RestoreOptions& options, CommandContext& context) {
  std::ostream& out = context.out;
  if (options.version > 0) TRY(restore_version(options.store, options.unit, options.version, options.simulated));
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

struct ShiftOptions {
  std::string database, out, format;
  RecordFilter filter;
  bool simulated = false, pdf = false;
  double target_percent = 0.0;
};

// Writes the report; an earlier one in the folder is replaced, and nothing else.
Status write_shift(const ShiftOptions& options, const ShiftReport& report, const Document& document) {
  TRY(make_folder(options.out));
  const LockFile held = TRY(hold_folder(options.out));
  const std::string page = as_page(document).html;
  const std::vector<NamedText> files = {{options.out + "/shift.html", page},
                                        {options.out + "/shift.csv", shift_csv(report)},
                                        {options.out + "/signals.csv", signals_csv(report)},
                                        {options.out + "/attempts.csv", attempts_table(report.attempts).csv()}};
  constexpr std::size_t alike = 30;
  for (const NamedText& file : files)
    TRY(check_replaceable(file.path, std::string_view(file.content).substr(0, alike)));
  const std::string pdf = options.out + "/shift.pdf";
  if (options.pdf) {
    TRY(check_replaceable(pdf, "%PDF-"));
    if (const Result<std::string> warning = write_pdf(page, pdf); !warning) return warning.error();
  }
  return write_files_atomically(files);
}

Status run_shift(const ShiftOptions& options, CommandContext& context) {
  std::ostream& out = context.out;
  if (options.pdf && options.out.empty()) return input_error("--pdf: expected --out DIR, the folder for shift.pdf");
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(options.database));
  ShiftReport report = TRY(shift_report(database, options.database, options.filter, options.simulated));
  report.target = 0.01 * options.target_percent;
  const Document document = shift_document(report);
  out << as(options.format, document);
  if (options.out.empty()) return {};
  TRY(write_shift(options, report, document));
  if (options.format.empty())
    out << "\nreport   " << options.out << "/shift.html"
        << (options.pdf ? "\npdf      " + options.out + "/shift.pdf" : "") << '\n';
  return {};
}

struct DatabaseOptions {
  std::string database, other, out;
};

std::string contents_of(const ResultsDatabase& database) {
  const auto attempts = database.attempts({});
  const auto calibrations = database.list({}, "N01");
  if (!attempts || !calibrations) return "";
  return counted(std::ssize(*attempts), "attempt") + ", " + counted(std::ssize(*calibrations), "calibration") +
         fmt::format(", schema {}", database_version);
}

Status backup(const DatabaseOptions& options, CommandContext& context) {
  TRY(check_apart({{"database", options.database}, {"--out", options.out}}));
  TRY(check_replaceable(options.out, "SQLite format 3"));
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(options.database));
  TRY(database.check());
  const std::string copy = temporary_name(options.out);
  const Result<std::string> checked = [&]() -> Result<std::string> {
    TRY(database.copy_into(copy));
    const ResultsDatabase written = TRY(ResultsDatabase::open_to_read(copy));
    TRY(written.check());
    return read_whole_file(copy, SIZE_MAX);
  }();
  ::unlink(copy.c_str());
  if (!checked) return named(checked.error(), copy, options.out);
  TRY(write_file_atomically(options.out, *checked));
  context.out << "backup of " << contents_of(database) << " in " << options.out << '\n';
  return {};
}

Status copy_rows(const DatabaseOptions& options, CommandContext& context) {
  TRY(check_apart({{"database", options.database}, {"other", options.other}}));
  const ResultsDatabase from = TRY(ResultsDatabase::open_to_read(options.database));
  ResultsDatabase to = TRY(ResultsDatabase::open(options.other));
  const CopiedRows copied = TRY(from.copy_to(to));
  context.out << options.other << ": " << counted(copied.calibrations, "new calibration") << " and "
              << counted(copied.attempts, "new note") << " of attempts\n";
  return {};
}

Status make_roles(const DatabaseOptions& options, CommandContext& context) {
  if (!names_a_server(options.database))
    return input_error(options.database + ": a file has no roles: expected postgresql://USER@HOST/NAME");
  ResultsDatabase database = TRY(ResultsDatabase::open(options.database));
  TRY(database.make_roles());
  context.out << options.database << ": turncal_station adds and reads, turncal_reader reads\n";
  return {};
}

Status check_database(const DatabaseOptions& options, CommandContext& context) {
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(options.database));
  TRY(database.check());
  context.out << options.database << ": whole, " << contents_of(database) << '\n';
  return {};
}

namespace fs = std::filesystem;

struct PruneOptions {
  std::string folder;
  double days = 0.0;
  bool list = false;
};

// A recording of a unit that has its verdict.
struct OldRecording {
  std::string unit, run, path, tag;
  double sealed_utc_s = 0.0;
  bool simulated = false, held = false;
  std::pair<std::string, bool> whose() const { return {unit, simulated}; }
};

Status add_recordings(const std::string& run, std::vector<OldRecording>& found) {
  const JournalContents journal = TRY(read_journal(run + "/" + journal_name));
  const std::vector<std::string> units = journal.units();
  for (const std::string& unit : units) {
    const std::string folder = units.size() > 1 ? run + "/" + name_of_unit(unit) : run;
    const std::string path = folder + "/" + binary_recording_name;
    const JournalFields* const verdict = journal.newest(journal.verdicts, unit);
    if (!verdict || !journal.seal_utc_s || !path_exists(path)) continue;
    const std::pair<std::string, std::string> hold("result", to_string(UnitVerdict::hold));
    found.push_back({.unit = unit,
                     .run = run,
                     .path = path,
                     .tag = std::string(tag_of(journal)),
                     .sealed_utc_s = *journal.seal_utc_s,
                     .simulated = journal.begin_value("simulated") == "true",
                     .held = std::find(verdict->begin(), verdict->end(), hold) != verdict->end()});
  }
  return {};
}

Status remove(const OldRecording& recording) {
  const LockFile held = TRY(hold_folder(recording.run));
  RunLog log = TRY(RunLog::append(recording.run + "/" + log_name, recording.tag));
  log.line(format_utc(wall_utc_s()) + "  " + recording.path + removed_by_prune);
  if (!log.status()) return log.status();
  std::error_code error;
  fs::remove(recording.path, error);
  return error ? Status(storage_error(recording.path, "cannot be removed", error.value())) : Status();
}

std::string megabytes(std::uintmax_t bytes) { return fmt::format("{:.1f} MB", 1e-6 * double(bytes)); }

Status prune(const PruneOptions& options, CommandContext& context) {
  std::ostream& out = context.out;
  std::error_code error;
  fs::recursive_directory_iterator entries(options.folder, error);
  if (error) return input_error(options.folder + ": cannot be read: " + error.message());
  std::vector<OldRecording> found;
  Status left;
  for (const fs::recursive_directory_iterator end; !error && entries != end; entries.increment(error)) {
    if (entries->path().filename() != journal_name) continue;
    const Status added = add_recordings(entries->path().parent_path().string(), found);
    if (left && !added) left = added;
  }
  if (error) return device_error(options.folder + ": cannot be read: " + error.message());

  std::map<std::pair<std::string, bool>, double> newest;
  for (const OldRecording& recording : found) {
    double& utc_s = newest.emplace(recording.whose(), recording.sealed_utc_s).first->second;
    utc_s = std::max(utc_s, recording.sealed_utc_s);
  }
  std::ranges::sort(found, [](const auto& a, const auto& b) { return a.path < b.path; });
  const double before_utc_s = wall_utc_s() - 86400.0 * options.days;
  std::size_t gone = 0;
  std::uintmax_t bytes = 0;
  for (const OldRecording& recording : found) {
    if (recording.held || recording.sealed_utc_s >= before_utc_s ||
        recording.sealed_utc_s >= newest.at(recording.whose()))
      continue;
    const std::uintmax_t size = fs::file_size(recording.path, error);
    const Status removed = options.list ? Status() : remove(recording);
    if (left && !removed) left = removed;
    if (!removed || error) continue;
    ++gone;
    bytes += size;
    out << recording.path << "  unit " << recording.unit << ", " << format_utc(recording.sealed_utc_s) << ", "
        << megabytes(size) << '\n';
  }
  out << gone << " of " << counted(std::ssize(found), "recording") << ' '
      << (options.list ? "would be removed, " : "removed, ") << megabytes(bytes) << std::endl;
  return left;
}

}  // namespace

void add_filter_options(const Command& command, RecordFilter& filter) {
  command.option("--station", filter.station, "only this station");
  command.option("--part", filter.part, "only this part");
  command.option("--from", filter.from, "start of the period, UTC: 2026-01-31 or 2026-01-31T06:00:00Z");
  command.option("--to", filter.to, "end of the period, UTC; a date includes the whole day");
}

void add_history_command(CommandLine& line) {
  const auto [command, options] =
      line.command<HistoryOptions>("history", "list, compare and export what is in the results database", show_history);
  command.option("database", options.database, {is::required}, "the station's record.database");
  add_filter_options(command, options.filter);
  command.option("--unit", options.filter.unit, "only this unit");
  command.option("--verdict", options.filter.verdict, "only this verdict or outcome: pass, hold, dropped, ...");
  command.option("--after", options.filter.after, "only rows that reached the database after the one with this id");
  command.flag("--attempts", options.attempts, "list every attempt, including those refused, aborted or failed");
  command.option("--compare", options.compare, {is::words(2)}, "compare two calibrations of one unit, by id");
  command.flag("--control", options.control, "control limits and Cpk of every parameter over all calibrations");
  command.option("--parameter", options.parameter, "one parameter, calibration by calibration");
  command.option("--report", options.report, "write a page (HTML) with the control charts of every parameter");
  command.flag("--simulated", options.simulated, "use dry runs for --control, --parameter and --report");
  command.flag("--together", options.together, "chart all units together, to show the spread between them");
  command.format(options.format,
                 "print the calibrations with all values in this form; json: also with the other options");
}

void add_shift_command(CommandLine& line) {
  const auto [command, options] = line.command<ShiftOptions>(
      "shift", "report on a production shift: yield, reasons of failures, hours, control charts, stations", run_shift);
  command.option("database", options.database, {is::required}, "the station's record.database");
  add_filter_options(command, options.filter);
  command.flag("--simulated", options.simulated, "report dry runs, which are never mixed with real units");
  command.option("--target", options.target_percent, {is::in(1.0, 100.0)},
                 "first-pass yield that is wanted, in per cent: a line in the chart of the yield over time");
  command.option("--out", options.out, "folder for the report: shift.html and its tables as CSV");
  command.option("--format", options.format, {is::one_of({"json"})}, "print the report in this form instead of text");
  command.flag("--pdf", options.pdf, "with --out: also write shift.pdf (needs weasyprint)");
}

void add_records_command(CommandLine& line) {
  CommandLine records =
      line.family("records", "maintain the results database, the parameter files in use and old recordings");
  const auto of_database = [&records](const char* name, const char* help,
                                      Status (*job)(const DatabaseOptions&, CommandContext&)) {
    const auto added = records.command<DatabaseOptions>(name, help, job);
    added.first.option("database", added.second.database, {is::required},
                       "the station's record.database: a file, or postgresql://USER@HOST/NAME");
    return added;
  };
  of_database("check", "check that a results database is whole", check_database);
  const auto [backing_up, image] = of_database("backup", "back up a results database, also while it is used", backup);
  backing_up.option("--out", image.out, {is::required}, "file for the backup");
  const auto [copying, rows] = of_database("copy", "copy the rows of a results database into another one", copy_rows);
  copying.option("other", rows.other, {is::required}, "database that the rows are added to, each once");
  of_database("roles", "make the roles of a results database on a server", make_roles);
  const auto [restoring, version] = records.command<RestoreOptions>(
      "restore", "list the versions of a unit's parameter file, or bring one back into use", restore);
  restoring.option("store", version.store, {is::required}, "the station's record.store");
  restoring.option("--unit", version.unit, {is::required}, "serial number of the unit");
  restoring.option("--version", version.version, {is::positive},
                   "the version to bring back; without it they are listed");
  restoring.flag("--simulated", version.simulated, "use the parameter files of dry runs");
  const auto [pruning, old] = records.command<PruneOptions>(
      "prune", "remove old recordings of finished units, but never a unit's last one or one that is on hold", prune);
  pruning.option("folder", old.folder, {is::required}, "folder with the folders of runs");
  pruning.option("--older-than", old.days, {is::time(1, 36500, "d"), is::required},
                 "age of the recording since it was sealed");
  pruning.flag("--list", old.list, "only list what would be removed");
}

}  // namespace turncal
