// `turncal calibrate`, `diagnose`, `recalibrate`, `fleet`, `allan`, `thermal`, `campaign`. Exit code 20 when results were written, but the
// data speak against the sigmas of a calibration, a diagnosis is not clean, or a fleet shows an effect that no unit shows by itself. recalibrate
// exits with 0 even if some recordings failed: they are listed. A truth.conf beside the first recording is compared with the result.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>
#include <thread>

#include "imu_io/base/console.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/number_table.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/fleet/fleet_members.h"
#include "orchestrator/fleet/recalibration.h"
#include "orchestrator/jobs/allan_job.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/thermal_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/allan_report.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/station/version.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

namespace fs = std::filesystem;

struct CalibrateOptions {
  std::vector<std::string> recordings;
  std::string out, format;
  std::string method = calibration_methods[0];
  bool partial = false, verbose = false;
  PriorSource prior;
};

std::optional<ParameterVector> truth_beside(const std::string& recording) {
  std::error_code error;
  const fs::path folder = fs::is_directory(recording, error) ? fs::path(recording) : fs::path(recording).parent_path();
  const fs::path file = folder / "truth.conf";
  if (!fs::exists(file, error)) return std::nullopt;
  const Result<ParameterVector> truth = read_truth(file.string());
  return truth ? std::optional(*truth) : std::nullopt;
}

// Prints the last lines of a calibration or a diagnosis.
void say_end(const Document& report, const OutputFolder& folder, std::ostream& out) {
  out << as_brief_text(report) << "open " << shell_path(folder.file(report_name)) << std::endl;
}

Status calibrate(const CalibrateOptions& options, CommandContext& context) {
  std::vector<LoadedRecording> recordings;
  for (const std::string& path : options.recordings) {
    TRY(check_not_source(options.out, path));
    recordings.push_back(TRY(load_recording(path)));
  }
  OutputFolder folder = TRY(OutputFolder::prepare_results(options.out, recordings.front().data.info.unit_serial));
  const bool with_prior = !options.prior.from.empty();
  if (with_prior && (recordings.size() > 1 || options.method != calibration_methods[0]))
    return input_error("--prior: expected one recording, and the method joint");
  if (!with_prior && !options.prior.part.empty()) return input_error("--part: expected --prior");
  const CalibrationRequest request{
      .method = options.method, .time_utc = format_utc(wall_utc_s()), .partial = options.partial || with_prior};
  CalibrationOutput output = TRY(calibrate_recordings(recordings, request));
  add_measured_utc(recordings.front().data.info, output.file);
  std::optional<StatisticsFile> statistics;  // for the fleet: from the data alone, without the prior
  if (const std::optional<UnitStatistics> found = statistics_of(recordings, output))
    statistics = StatisticsFile{output.file, *found};
  if (with_prior) {
    TRY(add_prior(options.prior, recordings.front(), request, output));
    const std::string open = undetermined_parameters(*output.fit);
    if (!open.empty() && !options.partial) return not_determined("this recording does not determine " + open);
  }
  const std::string file = folder.file(parameters_name);
  TRY(write_parameter_file(output.file, file));
  if (statistics) TRY(write_statistics(*statistics, folder.file(statistics_name)));
  const Document report = calibration_document(output.file, output.notes, truth_beside(options.recordings.front()));
  TRY(write_file_atomically(folder.file(report_name), as_page(report).html));
  folder.keep();
  if (!printed_as(options.format, TRY(format_calibration(output.file)), context.out)) {
    if (options.verbose) context.out << as_text(report) << "\nparameters  " << file << '\n';
    say_end(report, folder, context.out);
  }
  if (output.distrust.empty()) return {};
  return Error{ErrorKind::unit_failed, file + ": not trusted: " + output.distrust};
}

struct DiagnoseOptions {
  std::vector<std::string> recordings, holdouts;
  std::string out, residuals, format;
  bool verbose = false;
  std::optional<double> arw_deg_per_rt_h, vrw_ug_per_rt_hz;
  double gyro_bias_instability_degph = 0.0, accel_bias_instability_ug = 0.0;
};

Result<std::vector<LoadedRecording>> load(const std::vector<std::string>& paths, Phases& phases) {
  std::vector<LoadedRecording> all;
  for (const std::string& path : paths) {
    const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(path));
    phases.begin("reading " + path);
    all.push_back(TRY(load_recording(*source, [&](std::int64_t count) { phases.samples(count); })));
  }
  return all;
}

Result<std::optional<NoiseModel>> noise_given(const DiagnoseOptions& options, const RecordingInfo& info) {
  if (!options.arw_deg_per_rt_h && !options.vrw_ug_per_rt_hz) {
    if (options.gyro_bias_instability_degph > 0.0 || options.accel_bias_instability_ug > 0.0)
      return input_error(
          "--gyro-bias-instability and --accel-bias-instability fix the noise: expected --arw and --vrw with them");
    return std::optional<NoiseModel>{};
  }
  if (!options.arw_deg_per_rt_h || !options.vrw_ug_per_rt_hz)
    return input_error("--arw and --vrw fix the noise together: expected both or neither");
  NoiseModel noise = noise_model({.arw_deg_per_rt_h = *options.arw_deg_per_rt_h,
                                  .vrw_ug_per_rt_hz = *options.vrw_ug_per_rt_hz,
                                  .gyro_bias_instability_degph = options.gyro_bias_instability_degph,
                                  .accel_bias_instability_ug = options.accel_bias_instability_ug});
  if (info.gyro_increment == IncrementKind::pulses) noise.gyro_pulse_rad = nominal_gyro_rad(info);
  if (info.accel_increment == IncrementKind::pulses) noise.accel_pulse_mps = info.accel_pulse_mps;
  return std::optional(noise);
}

Status diagnose(const DiagnoseOptions& options, CommandContext& context) {
  const double began_s = monotonic_s();
  for (const std::vector<std::string>& sources : {options.recordings, options.holdouts})
    for (const std::string& source : sources) TRY(check_not_source(options.out, source));
  if (!options.residuals.empty()) TRY(check_ending(options.residuals, {".csv", ".npy", ".mat"}));
  Phases phases(context, !options.format.empty());
  const std::vector<LoadedRecording> fitted = TRY(load(options.recordings, phases));
  const std::vector<LoadedRecording> holdouts = TRY(load(options.holdouts, phases));
  const RecordingInfo& info = fitted.front().data.info;
  const DiagnosisRequest request{.time_utc = format_utc(wall_utc_s()),
                                 .holdouts = holdouts,
                                 .noise = TRY(noise_given(options, info)),
                                 .samples = (options.holdouts.empty() ? options.recordings : options.holdouts).front(),
                                 .phase = [&phases](const std::string& what) { phases.begin(what); }};
  OutputFolder folder = TRY(OutputFolder::prepare_results(options.out, info.unit_serial));
  const DiagnosisOutput output = TRY(diagnose_recordings(fitted, request));
  const std::string plot_problem = TRY(write_diagnosis(folder.path(), output.files));
  folder.keep();
  phases.clear();
  if (output.diagnosis.verdict != Verdict::clean) context.exit_code = exit_code(ErrorKind::unit_failed);
  if (!options.residuals.empty()) TRY(write_columns(options.residuals, residual_columns(output.diagnosis)));
  if (printed_as(options.format, output.files.conf, context.out)) return {};
  const DiagnosisFiles& files = output.files;
  if (options.verbose) {
    context.out << '\n'
                << as_text(files.report, diagnosis_lines) << "\ndiagnosis   " << folder.file(diagnosis_name) << '\n';
    if (files.parameters) context.out << "parameters  " << folder.file(parameters_name) << '\n';
    context.out << significant(monotonic_s() - began_s, 2) << " s\n";
  }
  if (!plot_problem.empty()) context.out << "report without plots: " << plot_problem << '\n';
  say_end(files.report, folder, context.out);
  return {};
}

struct RecalibrateOptions {
  std::string archive, store, against;
  std::string version = software_version();
  std::string engine = "local";
  std::string outcome;
  std::vector<std::int64_t> chunk;
  int threads = 0, chunks = 0;
  bool no_diagnosis = false;
};

// Prints one line, redrawn, on a terminal; elsewhere a line every tenth and whenever a queue has changed.
class CountPrinter {
 public:
  explicit CountPrinter(CommandContext& context) : context_(context), began_s_(monotonic_s()) {}
  ~CountPrinter() {
    if (context_.out_is_terminal && shown_ > 0) context_.out << '\n';
  }
  void show(const RecalibrationCounts& c) {
    const std::size_t step = context_.out_is_terminal ? 1 : std::max<std::size_t>(c.entries / 10, 1);
    if (c.finished() < c.entries && c.finished() < shown_ + step && c.waiting == waiting_) return;
    shown_ = c.finished();
    waiting_ = c.waiting;
    const double spent_s = monotonic_s() - began_s_;
    const double worked = double(c.done + c.failed + c.unreadable);
    const double left_s = worked > 0.0 ? spent_s / worked * double(c.entries - c.finished()) : 0.0;
    std::string line = fmt::format("{} of {}, {} already done, {} failed", c.finished(),
                                   counted(c.entries, "recording"), c.there, c.failed + c.unreadable);
    if (worked > 0.0 && left_s > 0.0)
      line += ", " + format_duration(left_s) + " left, until " + format_utc(wall_utc_s() + left_s);
    if (!c.waiting.empty()) line += "; " + c.waiting;
    if (context_.out_is_terminal)
      context_.out << '\r' << line << "\x1b[K" << std::flush;
    else
      context_.out << line << std::endl;
  }

 private:
  CommandContext& context_;
  double began_s_;
  std::size_t shown_ = 0;
  std::string waiting_;
};

Status recalibrate_archive(const RecalibrateOptions& options, CommandContext& context) {
  RecalibrationRequest request{.store = options.store,
                               .version = options.version,
                               .time_utc = format_utc(wall_utc_s()),
                               .diagnose = !options.no_diagnosis,
                               .outcome = options.outcome};
  if (options.version.empty() || options.version.front() == '.' || options.version.find('/') != std::string::npos)
    return input_error("--as-version " + turncal::quoted(options.version) +
                       ": expected the name of a folder in the store: without /, and no dot at its beginning");
  const bool on_slurm = options.engine == "slurm";
  if (on_slurm && (!options.chunk.empty() || !options.outcome.empty()))
    return input_error("--engine slurm: makes the chunks itself: expected neither --chunk nor --outcome");
  if (!on_slurm && options.chunks > 0) return input_error("--chunks: expected --engine slurm");
  if (!options.chunk.empty()) {
    if (options.chunk[1] < 1 || options.chunk[0] < 0 || options.chunk[0] >= options.chunk[1])
      return input_error("--chunk {} {}: expected K N with K from 0 to N - 1", options.chunk[0], options.chunk[1]);
    request.chunk = int(options.chunk[0]);
    request.chunks = int(options.chunk[1]);
  }
  request.threads = options.threads > 0 ? options.threads
                    : on_slurm          ? 1
                                        : int(std::max(1U, std::thread::hardware_concurrency()));
  const std::vector<ArchiveEntry> archive = TRY(read_archive(options.archive));
  Result<RecalibrationCounts> counts = RecalibrationCounts{};
  {
    CountPrinter printer(context);
    const auto show = [&](const RecalibrationCounts& c) { printer.show(c); };
    counts = on_slurm ? recalibrate_on_slurm(archive, request, {.chunks = options.chunks}, show)
                      : recalibrate(archive, request, show);
  }
  if (!counts) return counts.error();
  context.out << fmt::format("{} done, {} already done, {} cannot be calibrated, {} cannot be read: {}/{}\n",
                             counts->done, counts->there, counts->failed, counts->unreadable, options.store,
                             request.version)
              << std::flush;
  if (options.against.empty()) return {};
  context.out << as_text(changes_document(TRY(compare_versions(options.store, options.against, request.version))));
  return {};
}

struct FleetCommandOptions {
  std::string action, from, format, page;
  std::vector<std::string> by = {"station"};
};

Status diagnose(const FleetCommandOptions& options, CommandContext& context) {
  std::set<std::string> given;
  for (const std::string& factor : options.by)
    if (!given.insert(factor).second) return input_error("--by " + factor + ": is given twice");
  const FleetSource source = TRY(read_fleet(options.from, options.by));
  const auto diagnosis = diagnose_fleet(source.members, {.factors = options.by, .summary = !options.page.empty()});
  const Document document = fleet_document(diagnosis, source, options.by);
  if (!options.page.empty()) {
    TRY(check_replaceable(options.page, "<!DOCTYPE html>"));
    TRY(write_file_atomically(options.page, as_page(document).html));
  }
  if (!options.format.empty()) {
    context.out << table_of(diagnosis, source).as(options.format);
  } else {
    context.out << as_text(document);
    if (!options.page.empty()) context.out << "page  " << options.page << '\n';
  }
  if (!diagnosis.effects.empty() || !diagnosis.explained())
    return Error{ErrorKind::unit_failed,
                 options.from +
                     ": effects common to several units, a unit that stands out, or a residual that is not explained"};
  return {};
}

struct AllanOptions {
  AllanRequest from;
  std::string out, format;
};

// Writes a result; an earlier one in the folder is replaced as a whole.
Status write_result(const std::string& out, const AllanReport& report, const Document& document,
                    CommandContext& context) {
  OutputFolder folder = TRY(OutputFolder::prepare(out, {}));
  const HtmlPage page = as_page(document);
  std::vector<NamedText> files = {{folder.file("allan.html"), page.html},
                                  {folder.file("allan.csv"), format_allan_points(report.result)},
                                  {folder.file("imu.yaml"), format_imu_yaml(report.result, report.sample_s)}};
  const Figure figure = allan_figure(report.result, report.other ? &*report.other : nullptr);
  if (const Result<std::string> drawn = standalone_svg(figure)) files.push_back({folder.file("allan.svg"), *drawn});
  TRY(write_files_atomically(files));
  folder.keep();
  if (!page.plot_problem.empty()) context.warn("report without plots: " + page.plot_problem);
  return {};
}

Status allan(const AllanOptions& options, CommandContext& context) {
  if (!options.out.empty()) TRY(check_not_source(options.out, options.from.source));
  const AllanReport report = TRY(allan_report(options.from));
  const Document document = allan_document(report);
  if (!options.out.empty()) TRY(write_result(options.out, report, document, context));
  context.out << (options.format == "csv" ? format_allan_points(report.result) : as(options.format, document))
              << std::flush;
  return {};
}

struct ThermalCommandOptions {
  ThermalRequest request;
  std::string out, format;
};

Status write_thermal(const ThermalOutput& output, const std::string& out, const std::string& format,
                     std::ostream& terminal) {
  OutputFolder folder = TRY(OutputFolder::prepare_results(out, output.file.unit_serial));
  const std::string conf = format_thermal(output.report);
  const std::string parameters = TRY(format_parameter_file(output.file));
  const Document document = thermal_document(output.report);
  const HtmlPage page = as_page(document);
  TRY(write_files_atomically({{folder.file(thermal_name), conf},
                              {folder.file(thermal_page_name), page.html},
                              {folder.file(parameters_name), parameters}}));
  folder.keep();
  if (printed_as(format, conf, terminal)) return {};
  terminal << as_text(document);
  if (!page.plot_problem.empty()) terminal << "page without plots: " << page.plot_problem << '\n';
  terminal << "\nparameters  " << folder.file(parameters_name) << "\nthermal     " << folder.file(thermal_name)
           << "\npage        " << folder.file(thermal_page_name) << std::endl;
  return {};
}

Status thermal(const ThermalCommandOptions& options, CommandContext& context) {
  ThermalRequest request = options.request;
  for (const std::string& leg : request.legs) TRY(check_not_source(options.out, leg));
  Phases phases(context, !options.format.empty());
  request.time_utc = format_utc(wall_utc_s());
  request.phase = [&phases](const std::string& what) { phases.begin(what); };
  const ThermalOutput output = TRY(thermal_calibration(request));
  phases.clear();
  return write_thermal(output, options.out, options.format, context.out);
}

struct CampaignOptions {
  std::string file, out, format;
  bool plan = false;
  RunRequest request;
};

Status campaign(const CampaignOptions& options, CommandContext& context) {
  if (options.request.dry_run) context.tag = dry_run_tag;
  const Campaign campaign = TRY(read_campaign(options.file));
  if (options.plan) {
    if (options.format == "csv") return input_error("--format csv: expected json with --plan, which is no table");
    context.out << as(options.format, TRY(plan_campaign(campaign))) << std::flush;
    return {};
  }
  if (options.out.empty()) return input_error("--out is required: the folder for the legs and the results (or --plan)");
  const ThermalOutput output = TRY(run_campaign(campaign, options.request, options.out, context));
  const LinePrefix marked(context.out, context.tag);
  return write_thermal(output, options.out, options.format, context.out);
}

}  // namespace

void add_calibrate_command(CommandLine& line) {
  const auto [command, options] =
      line.command<CalibrateOptions>("calibrate", "estimate the 24 parameters from a recording", calibrate);
  command.option("recording", options.recordings, {is::required},
                 "recording: a folder (binary or text form) or a .tcr file; several of one unit");
  command.option("--out", options.out, {is::required}, "folder for parameters.conf and report.html");
  command.option("--method", options.method,
                 {is::one_of({std::begin(calibration_methods), std::end(calibration_methods)}), is::default_in_help},
                 "estimator");
  command.format(options.format, "print parameters.conf in this form instead of text");
  command.flag("--partial", options.partial, "write a result even if some parameters are not determined");
  command.flag("--verbose", options.verbose, "print all 24 parameters and what the data lack");
  command.option("--prior", options.prior.from,
                 "use earlier calibrations as a prior: a results database, a store of `turncal recalibrate`, or a "
                 "folder with runs below it");
  command.option("--part", options.prior.part, "with --prior: only units of this part number");
}

void add_diagnose_command(CommandLine& line) {
  const auto [command, options] = line.command<DiagnoseOptions>(
      "diagnose", "find effects that the 24 parameters do not model; report the error before and after", diagnose);
  command.option("recording", options.recordings, {is::required},
                 "recording: a folder (binary or text form) or a .tcr file; several of one unit");
  command.option("--holdout", options.holdouts, {is::one_word_each},
                 "recording of the same unit that is kept out of the fit; repeat it for more; default: "
                 "cross-validation over recordings, or over dwells");
  command.option("--out", options.out, {is::required}, "folder for parameters.conf, diagnosis.conf and report.html");
  command.flag("--verbose", options.verbose, "print the tables of the report, too");
  command.option("--residuals", options.residuals, "write the residuals to this file: .csv, .npy or .mat");
  command.option("--format", options.format, {is::one_of(data_formats)},
                 "print diagnosis.conf in this form instead of text");
  command.option("--arw", options.arw_deg_per_rt_h, {is::positive},
                 "angle random walk, deg/sqrt(h); with --vrw: use this noise instead of estimating it");
  command.option("--vrw", options.vrw_ug_per_rt_hz, {is::positive}, "velocity random walk, ug/sqrt(Hz)");
  command.option("--gyro-bias-instability", options.gyro_bias_instability_degph, {is::in(0.0, 1e6)},
                 "bias instability of the gyros, deg/h; with --arw and --vrw");
  command.option("--accel-bias-instability", options.accel_bias_instability_ug, {is::in(0.0, 1e6)},
                 "bias instability of the accelerometers, ug; with --arw and --vrw");
}

void add_recalibrate_command(CommandLine& line) {
  const auto [command, options] = line.command<RecalibrateOptions>(
      "recalibrate", "calibrate an archive of recordings again with this version", recalibrate_archive);
  command.option("archive", options.archive, {is::required},
                 "a folder with recordings below it, a CSV list, or a results database");
  command.option("--out", options.store, {is::required}, "folder of the store; existing results are kept");
  command.option("--against", options.against, "report what changed against this version of the store");
  command.option("--as-version", options.version, {is::default_in_help}, "name of the version in the store");
  command.option("--engine", options.engine, {is::one_of({"local", "slurm"}), is::default_in_help},
                 "where the work is done: on this machine, or as an array job of Slurm");
  command.option("--chunks", options.chunks, {is::in(1, 1000)},
                 "tasks of the array job; default: one per 100 recordings");
  command.option("--threads", options.threads, {is::in(1, 256)},
                 "recordings at a time; default: all cores, or one in a task of Slurm");
  command.option("--chunk", options.chunk, {is::words(2)}, "K N: only every N-th recording from the K-th (0 to N - 1)");
  command.option("--outcome", options.outcome,
                 "file for the outcome of each recording (CSV); default: recordings.csv in the store");
  command.flag("--no-diagnosis", options.no_diagnosis, "calibrate only");
}

void add_fleet_command(CommandLine& line) {
  const auto [command, options] = line.command<FleetCommandOptions>(
      "fleet", "find errors that many units have in common, by station, lot, part or month", diagnose);
  command.option("action", options.action, {is::required, is::one_of({"diagnose"})},
                 "diagnose, the only action; `turncal shift` reports on a line");
  command.option("from", options.from, {is::required},
                 "a results database, a store of `turncal recalibrate`, or a folder with runs below it");
  command.option("--by", options.by, {is::one_of(fleet_factors), is::one_word_each, is::default_in_help},
                 "factor by which units are grouped; repeat it for several");
  command.option("--page", options.page, "write a page (HTML) to this file");
  command.format(options.format, "print a table for other programs");
}

void add_allan_command(CommandLine& line) {
  const auto [command, options] = line.command<AllanOptions>(
      "allan", "report the noise of a unit at rest: Allan deviation and its coefficients", allan);
  command.option("source", options.from.source, {is::required},
                 "recording: a folder or a .tcr file; with --map a CSV, .npy or .mat file");
  command.option("--map", options.from.map, "file that describes the columns (docs/import.md)");
  command.option("--against", options.from.against, "second source, or a parameter file (.conf), to compare with");
  command.option("--out", options.out, "folder for allan.html, allan.svg, allan.csv, imu.yaml");
  command.format(options.format, "print the result (json) or its points (csv) instead of text");
}

void add_thermal_command(CommandLine& line) {
  const auto [command, options] = line.command<ThermalCommandOptions>(
      "thermal", "fit the parameters as functions of temperature, from calibrations at several temperatures", thermal);
  command.option(
      "leg", options.request.legs, {is::required},
      "recording, parameter file, or folder of a run or calibration; all of one unit, at two temperatures or more");
  command.option("--out", options.out, {is::required}, "folder for parameters.conf, thermal.conf and thermal.html");
  command.option("--temperature", options.request.temperatures, {is::one_word_each},
                 "LEG=VALUE, degrees C, for a leg without a thermometer; repeat it for more");
  command.option("--reference", options.request.reference_c,
                 "temperature of the 24 parameters, degrees C; default: the middle of the range");
  command.format(options.format, "print thermal.conf in this form instead of text");
}

void add_campaign_command(CommandLine& line) {
  const auto [command, options] = line.command<CampaignOptions>(
      "campaign", "calibrate a unit at several temperatures, unattended, and fit its parameters over temperature",
      campaign);
  RunRequest& request = options.request;
  command.option("file", options.file, {is::required},
                 "campaign: unit, station, temperatures, sequences (docs/thermal.md)");
  command.option("--out", options.out, "folder for the legs and the results; the same folder continues what is there");
  command.flag("--plan", options.plan, "print the legs, their times and the expected sigmas; nothing moves");
  command.flag("--dry-run", request.dry_run, "simulate table, unit and chamber, in virtual time");
  command.flag("--no-diagnosis", request.no_diagnosis, "skip the diagnosis of each leg");
  command.flag("--until-sigma", request.until_sigma,
               "end each leg, and the campaign, as soon as its sigmas are small enough (as run does)");
  add_record_options(command, request);
  add_watch_options(command, request);
  command.format(options.format, "print the plan, or thermal.conf, in this form");
}

}  // namespace turncal
