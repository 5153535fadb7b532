// Data in and out: `segment`, `import`, `export`, `apply`, `convert`, `navigate`. import and export overwrite nothing, and a failure
// leaves nothing behind. apply refuses a wrong checksum, a missing key, parameters of another unit, and simulated ones on a real unit's
// recording.
#include <fmt/format.h>
#include <algorithm>

#include <cctype>
#include <filesystem>
#include <optional>

#include "calib/statistics/segmentation.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/frames/frame_decoder.h"
#include "imu_io/recordings/csv_map_import.h"
#include "imu_io/recordings/map_proposal.h"
#include "imu_io/recordings/number_table.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "imu_io/recordings/ros_bag.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/import_job.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/jobs/navigation/foreign_forms.h"
#include "orchestrator/jobs/navigation/navigation_job.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct TextOptions {
  std::string source, out;
  // For foreign data: a table, a bag, raw bytes.
  std::string map, map_out, frame, topic;
  std::string accel;  // the accelerometers' file, if they have their own
  bool skip_bad_rows = false;
  std::optional<double> gravity_mps2, latitude_deg, rate_hz;
  std::string unit;
  bool is_foreign() const {
    return !map.empty() || !map_out.empty() || !topic.empty() || skip_bad_rows || is_table(recognise_file(source));
  }
};

struct SegmentOptions {
  std::string source, out;
  SegmentationOptions how;
};

void print_segmentation(const Segmentation& found, const RecordingInfo& info, std::int64_t first, std::ostream& out) {
  const double period = info.sample_period_s;
  const bool physical = info.gyro_increment == IncrementKind::physical;
  const double per = physical ? period : 1.0;
  out << fmt::format(
      "threshold {:.3g} on the ratio of variance to quiet variance: {}\n"
      "quiet level: gyros {:.3g}{}, accelerometers {:.3g} {} a sample\n",
      found.threshold, found.reason, found.quiet_gyro / per, physical ? " rad/s" : "", found.quiet_accel / per,
      physical ? "m/s^2" : "pulses");
  if (found.slow_turns > 0)
    out << found.slow_turns << " quiet stretches excluded: their mean rate is that of a slow turn\n";
  if (found.cut > 0) out << counted(found.cut, "rest") << " cut to where the unit stands still\n";
  if (found.moving > 0)
    out << counted(found.moving, "rest") << " excluded: the unit stands still in too little of each\n";
  int number = 0;
  out << "rest      from s        to s    length s\n";
  for (const Segment& s : found.segments) {
    if (s.kind != SegmentKind::still) continue;
    const double from_s = double(s.start_sample - first) * period;
    const double to_s = double(s.end_sample - first) * period;
    out << fmt::format("{:4}  {:10.2f}  {:10.2f}  {:10.2f}\n", ++number, from_s, to_s,
                       double(s.end_sample - s.start_sample) * period);
  }
}

Status segment_recording(const SegmentOptions& options, CommandContext& context) {
  std::unique_ptr<RecordingSource> opened = TRY(RecordingSource::open(options.source));
  RecordingSource& source = *opened;
  TRY(check_not_source(options.out, options.source));
  OutputFolder folder = TRY(OutputFolder::prepare(options.out, {binary_recording_name}));
  const Segmentation found = TRY(find_rests(source, options.how));
  print_segmentation(found, source.info(), found.segments.front().start_sample, context.out);
  TRY(import_binary(source, found.segments, folder.file(binary_recording_name)));
  folder.keep();
  if (const std::string wrong = wrong_units_of(source, found.segments); !wrong.empty())
    context.out << "units: " << wrong << std::endl;
  context.out << "written to " << folder.path() << ": " << counted(std::ssize(found.segments), "segment") << std::endl;
  return {};
}

// Writes an imported recording. `where`: what defines the units of measure.
Status write_imported(const CsvImport& content, const std::string& out, const std::string& line, const char* where,
                      CommandContext& context) {
  OutputFolder folder = TRY(OutputFolder::prepare(out, {binary_recording_name}));
  RecordingWriter writer = TRY(RecordingWriter::create(folder.file(binary_recording_name), content.info));
  TRY(writer.add(content.samples));
  TRY(writer.finish());
  const std::vector<std::string> notes = TRY(check_import(content, folder.file(binary_recording_name), where));
  folder.keep();
  context.out << "imported into " << folder.path() << ": " << line << std::endl;
  for (const std::string& note : notes) context.out << note << std::endl;
  return {};
}

ImportSite site_of(const TextOptions& from) {
  ImportSite site;
  site.gravity_mps2 = from.gravity_mps2.value_or(site.gravity_mps2);
  site.latitude_deg = from.latitude_deg.value_or(site.latitude_deg);
  site.rate_hz = from.rate_hz.value_or(site.rate_hz);
  site.unit_serial = from.unit.empty() ? std::filesystem::path(from.source).stem().string() : from.unit;
  return site;
}

// Lists what is assumed about the site because no option gives it; a map gives it.
std::string assumed_of(const TextOptions& from) {
  const ImportSite site = site_of(from);
  std::string text;
  if (!from.gravity_mps2) text += fmt::format("; gravity {} m/s^2 is assumed (--gravity)", site.gravity_mps2);
  if (!from.latitude_deg) text += fmt::format("; latitude {} deg is assumed (--latitude)", site.latitude_deg);
  return from.map.empty() ? text : "";
}

Status import_frames(const TextOptions& from, CommandContext& context) {
  const FrameDescription frame = TRY(find_frame(from.frame));
  FrameLog log = TRY(read_frame_log(from.source, frame));
  CsvImport content;
  frame.describe(content.info);
  const ImportSite site = site_of(from);
  content.info.gravity_mps2 = site.gravity_mps2;
  content.info.latitude_deg = site.latitude_deg;
  content.info.unit_serial = site.unit_serial;
  content.samples = std::move(log.samples);
  const std::string line = counted(std::ssize(content.samples), "sample") + "; " + log.summary + assumed_of(from);
  return write_imported(content, from.out, line, "the frame description", context);
}

// Returns the proposed map; when it is doubtful, an error after it was printed and written.
Result<CsvMap> propose(const TextOptions& from, const ColumnSource& source, CommandContext& context) {
  TRY(check_serial(site_of(from).unit_serial, "--unit"));
  const MapProposal proposal = TRY(propose_map(source, site_of(from)));
  context.out << proposal.text << std::flush;
  if (!from.map_out.empty()) {
    TRY(check_replaceable(from.map_out, proposed_beginning));
    TRY(write_file_atomically(from.map_out, proposal.text));
  }
  if (!proposal.doubts.empty())
    return input_error("{}: in doubt: {}: expected a --map that says which ({}, to be edited)", from.source,
                       fmt::join(proposal.doubts, "; "),
                       from.map_out.empty() ? "--map-out FILE writes this one" : "this one is in " + from.map_out);
  return parse_csv_map(proposal.text, "proposed map");
}

Status import_table(const TextOptions& from, CommandContext& context) {
  CsvMap map;
  if (!from.map.empty()) map = TRY(read_csv_map(from.map));
  if (!from.topic.empty()) map.topic = from.topic;
  const ColumnSource source = TRY(open_columns(from.source, map.topic, from.skip_bad_rows));
  if (from.map.empty()) map = TRY(propose(from, source, context));
  map.format.skip_bad_rows = from.skip_bad_rows;
  map.gravity_mps2 = from.gravity_mps2.value_or(map.gravity_mps2);
  map.latitude_deg = from.latitude_deg.value_or(map.latitude_deg);
  map.rate_hz = from.rate_hz.value_or(map.rate_hz);
  if (from.rate_hz) map.clocks.clear();
  if (!from.unit.empty()) map.unit_serial = from.unit;
  ColumnSource accel;
  if (!from.accel.empty()) accel = TRY(open_columns(from.accel, {}, from.skip_bad_rows));
  const CsvImport content = TRY(import_columns(map, source, from.accel.empty() ? nullptr : &accel));
  const std::string line = words_of(content, from.accel) + (from.rate_hz ? "; --rate in place of times" : "");
  return write_imported(content, from.out, line + assumed_of(from), "the map", context);
}

Status say(RecordingSource& source, const char* what, const std::string& out, CommandContext& context) {
  const std::string hash = TRY(source.content_hash());
  if (const std::string damage = describe(source.damage()); !damage.empty()) context.out << damage << '\n';
  context.out << what << ' ' << out << ": " << counted(std::ssize(source.segments()), "segment") << ", content " << hash
              << std::endl;
  return {};
}

Status finish(RecordingSource& source, OutputFolder& folder, const char* what, CommandContext& context) {
  TRY(say(source, what, folder.path(), context));
  folder.keep();
  return {};
}

Status import_text(const TextOptions& options, CommandContext& context) {
  if (!options.frame.empty() &&
      (!(options.map + options.map_out + options.topic).empty() || options.skip_bad_rows || options.rate_hz))
    return input_error("--frame: raw bytes: expected no --map, --map-out, --topic, --accel, --rate or --skip-bad-rows");
  if (!options.frame.empty()) return import_frames(options, context);
  if (options.is_foreign()) return import_table(options, context);
  if (!std::filesystem::is_directory(options.source)) {
    TRY(expect_file(options.source, FileKind::csv));
    const TableBytes bytes = TRY(bytes_of_file(options.source));
    const std::string_view head = TRY(bytes.at(0, 1));
    if (head.empty()) return input_error(options.source + ": empty file: expected a table or a recording");
    TRY(check_text(head, options.source));
  }
  if (!path_exists(options.source + "/recording.conf"))
    return input_error(options.source +
                       (path_exists(options.source + "/" + binary_recording_name)
                            ? ": this is a recording already: turncal export writes its text form"
                            : ": unknown kind of file: expected a table (CSV, .npy, .mat, HDF5), a ROS bag, a "
                              "folder with a recording in text form, or raw bytes and --frame"));
  std::unique_ptr<RecordingSource> source = TRY(open_text_recording(options.source));
  TRY(check_not_source(options.out, options.source));
  OutputFolder folder = TRY(OutputFolder::prepare(options.out, {binary_recording_name}));
  TRY(import_binary(*source, folder.file(binary_recording_name)));
  TRY(finish(*source, folder, "imported into", context));
  source = TRY(RecordingSource::open(folder.file(binary_recording_name)));
  for (const std::string& defect : TRY(defects_of(*source, source->segments()))) context.out << defect << std::endl;
  return {};
}

Status export_recording(const TextOptions& options, CommandContext& context) {
  std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(options.source));
  TRY(check_not_source(options.out, options.source));
  // A folder has no extension that means "file".
  if (const std::string ending = std::filesystem::path(options.out).extension().string();
      !names_matrix(options.out) && ending.size() > 1 && std::isalpha(static_cast<unsigned char>(ending[1])) != 0)
    return input_error(options.out + ": expected a folder (its text form), or a file that ends in .npy or .mat");
  if (names_matrix(options.out)) {
    TRY(write_recording_columns(*source, options.out));
    return say(*source, "exported to", options.out, context);
  }
  OutputFolder folder = TRY(OutputFolder::prepare(options.out, {"recording.conf", "imu.csv", "segments.csv"}));
  TRY(export_text(*source, folder.path()));
  return finish(*source, folder, "exported to", context);
}

struct ApplyOptions {
  std::string recording, parameters, out;
  std::string as;  // empty: increments by the unit's counter
};

// Returns the unit's counter and increments; or time, temperature if any, and increments, or the mean rates over the sample that ends then.
SampleColumns calibrated_columns(const RecordingInfo& info, const std::string& as) {
  const bool rates = as == "rates", timed = !as.empty(), warm = timed && info.has_temperature;
  SampleColumns columns{{timed ? "time_s" : "sample"}, {}};
  for (const char* name :
       rates ? std::array{"rate_{}_radps", "force_{}_mps2"} : std::array{"dtheta_{}_rad", "dv_{}_mps"})
    for (const char axis : {'x', 'y', 'z'}) columns.names.push_back(fmt::format(fmt::runtime(name), axis));
  if (warm) columns.names.emplace_back("temperature_c");
  columns.fill = [=, period_s = info.sample_period_s, first = std::optional<std::int64_t>()](
                     const ImuSample& sample, std::span<double> row) mutable {
    first = std::min(first.value_or(sample.counter), sample.counter);
    row[0] = timed ? double(sample.counter - *first) * period_s : double(sample.counter);
    for (std::size_t k = 0; k < 6; ++k) row[k + 1] = channel_of(sample, k) / (rates ? period_s : 1.0);
    if (warm) row[7] = double(sample.temperature_c);
  };
  return columns;
}

// Writes by the name of the file: a recording, a matrix in the form of export, or columns.
Status write_calibrated(RecordingSource& source, const ApplyOptions& options) {
  if (options.out.ends_with(".tcr")) {
    TRY(check_replaceable(options.out, recording_beginning));
    return import_binary(source, options.out);
  }
  if (options.as.empty() && names_matrix(options.out)) return write_recording_columns(source, options.out);
  const SampleColumns columns = calibrated_columns(source.info(), options.as);
  return options.out.ends_with(".mcap") ? write_imu_mcap(source, columns, options.out)
                                        : write_sample_columns(source, columns, options.out);
}

Status apply(const ApplyOptions& options, CommandContext& context) {
  TRY(check_ending(options.out, {".csv", ".npy", ".mat", ".mcap", ".tcr"}));
  if (options.as != "rates" && options.out.ends_with(".mcap"))
    return input_error(options.out + ": a sensor_msgs/Imu has rates, no increments: expected --as rates");
  if (!options.as.empty() && options.out.ends_with(".tcr"))
    return input_error(options.out +
                       ": a recording has increments and a counter: expected .csv, .npy, .mat or .mcap with --as");
  const ParameterFile parameters = TRY(read_parameter_file(options.parameters));
  std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(options.recording));
  SampleCalibration calibration = TRY(SampleCalibration::make(parameters, options.parameters, *source));
  const std::optional<TemperatureCourse> temperature = calibration.temperature;
  CalibratedSource calibrated(*source, std::move(calibration));
  TRY(check_apart({{"the source", options.recording},
                   {"the source", options.recording + "/" + binary_recording_name},
                   {"the source", options.recording + "/imu.csv"},
                   {"the source", options.parameters},
                   {"--out", options.out}}));
  TRY(write_calibrated(calibrated, options));
  if (!is_trusted(parameters)) context.err << context.tag << distrust_of(parameters, options.parameters) << std::endl;
  if (temperature) context.out << describe(*temperature) << '\n';
  context.out << "calibrated " << (options.as == "rates" ? "rates" : "increments") << "  " << options.out << std::endl;
  return {};
}

struct ConvertOptions {
  std::string parameters, header, binary, yaml;
  std::string form, out;
};

Status convert(const ConvertOptions& options, CommandContext& context) {
  if (options.header.empty() && options.binary.empty() && options.yaml.empty() && options.form.empty())
    return input_error("expected --header, --binary or --yaml, or several of them, or --form");
  TRY(check_apart({{"the parameter file", options.parameters},
                   {"--header", options.header},
                   {"--binary", options.binary},
                   {"--yaml", options.yaml},
                   {"--out", options.out}}));
  const ParameterFile file = TRY(read_parameter_file(options.parameters));
  // An existing file is replaced only if it begins alike.
  constexpr std::size_t alike = 30, of_block = 4;
  std::vector<NamedText> forms;
  if (!options.header.empty()) forms.push_back({options.header, format_parameter_header(file)});
  if (!options.yaml.empty()) forms.push_back({options.yaml, format_parameter_yaml(file)});
  if (!options.binary.empty()) forms.push_back({options.binary, format_parameter_block(file)});
  if (!options.form.empty())
    forms.push_back({options.out, TRY(write_foreign_form(file, options.parameters, options.form))});
  for (const NamedText& form : forms) {
    const std::size_t same = form.path == options.binary ? of_block : alike;
    TRY(check_replaceable(form.path, std::string_view(form.content).substr(0, same)));
  }
  TRY(write_files_atomically(forms));
  for (const NamedText& form : forms) context.out << "written  " << form.path << '\n';
  if (file.temperature && !options.binary.empty())
    context.out << "the binary block holds the parameters at " << format_number(file.temperature->reference_c)
                << " C alone, not their temperature.* coefficients\n";
  return {};
}

constexpr double longest_recording_s = 1e7;

struct NavigateOptions {
  NavigationRequest request;
  std::string out, format;
};

Status navigate(const NavigateOptions& options, CommandContext& context) {
  TRY(check_not_source(options.out, options.request.recording));
  // An earlier result in the folder is replaced as a whole.
  OutputFolder folder = TRY(OutputFolder::prepare(options.out, {}));
  const NavigationReport report = TRY(navigate_recording(options.request));
  std::vector<NamedText> files = {{folder.file("navigation.conf"), format_navigation(report)}};
  const Document document = navigation_document(report);
  const HtmlPage page = as_page(document);
  files.push_back({folder.file("navigation.html"), page.html});
  for (const NavigatedFile& file : report.files) {
    const std::string name = file.prefix.empty() ? "track.csv" : "track_against.csv";
    files.push_back({folder.file(name), format_track(report, file)});
  }
  TRY(write_files_atomically(files));
  std::error_code none;
  if (report.files.size() == 1) std::filesystem::remove(folder.file("track_against.csv"), none);
  folder.keep();
  if (printed_as(options.format, files.front().content, context.out)) return {};
  context.out << as_text(document);
  if (!page.plot_problem.empty()) context.out << page.plot_problem << '\n';
  context.out << "navigation  " << folder.file("navigation.html") << std::endl;
  return {};
}

}  // namespace

void add_segment_command(CommandLine& line) {
  const auto [command, options] = line.command<SegmentOptions>(
      "segment", "find the rests in a recording and write a copy that is divided into segments", segment_recording);
  command.option("source", options.source, {is::required}, "recording: a folder or a .tcr file");
  command.option("--out", options.out, {is::required}, "folder to write to; must not contain a recording yet");
  command.option("--threshold", options.how.threshold, {is::in(1.0, 1e12)},
                 "variance, relative to that at rest, above which a rest ends; default: chosen from the data");
  command.option("--min-rest", options.how.min_rest_s, {is::time(0.1, 3600.0), is::default_in_help}, "shortest rest");
}

void add_import_command(CommandLine& line) {
  const auto [command, options] = line.command<TextOptions>(
      "import", "make a recording from a table of numbers, a ROS bag, raw bytes or the text form of a recording",
      import_text);
  command.option("source", options.source, {is::required},
                 "CSV, .npy, .mat, HDF5, MCAP, .db3 or .bag file; with --frame a log of raw bytes; or a folder with "
                 "recording.conf");
  command.option("--out", options.out, {is::required}, "folder to write to; must not contain a recording yet");
  CLI::Option* const map =
      command.option("--map", options.map, "file that describes the columns (docs/import.md); default: a proposed one");
  command.option("--map-out", options.map_out, "write the proposed map to this file");
  command.option("--frame", options.frame, "frame description of raw bytes: a name, or a file (docs/imu-frames.md)");
  command.option("--topic", options.topic, "sensor_msgs/Imu topic of a bag that has several");
  needs(command.option("--accel", options.accel, "file of the accelerometers, if it is a separate one"), map);
  command.flag("--skip-bad-rows", options.skip_bad_rows, "skip defective rows, and report their number");
  command.option("--gravity", options.gravity_mps2, {is::in(recorded_gravity_mps2.min, recorded_gravity_mps2.max)},
                 "gravity of the site, m/s^2; default: the map's, or 9.80665");
  command.option("--latitude", options.latitude_deg, {is::in(-90.0, 90.0)},
                 "latitude of the site, degrees; default: the map's, or 0");
  command.option("--rate", options.rate_hz, {is::in(sample_rate_hz.min, sample_rate_hz.max)},
                 "samples per second, in place of a time column");
  command.option("--unit", options.unit, "serial number; default: the map's, or the name of the file");
}

void add_export_command(CommandLine& line) {
  const auto [command, options] = line.command<TextOptions>(
      "export", "write a recording in text form, or its samples as .npy or .mat", export_recording);
  command.option("source", options.source, {is::required}, "recording: a folder or a .tcr file");
  command.option("--out", options.out, {is::required},
                 "folder to write to, which must not contain a recording yet, or a .npy or .mat file");
}

void add_apply_command(CommandLine& line) {
  const auto [command, options] =
      line.command<ApplyOptions>("apply", "write the calibrated increments or rates of a recording", apply);
  command.option("recording", options.recording, {is::required}, "a folder (binary or text form) or a .tcr file");
  command.option("--parameters", options.parameters, {is::required}, "parameter file");
  command.option("--out", options.out, {is::required},
                 "file to write: .csv, .npy, .mat, .mcap (rates) or .tcr (a recording); an existing file is replaced");
  command.option("--as", options.as, {is::one_of({"rates", "increments"})},
                 "write increments or rates (rad/s, m/s^2) with the time of each sample; not for .tcr");
}

void add_convert_command(CommandLine& line) {
  const auto [command, options] = line.command<ConvertOptions>(
      "convert", "convert a parameter file to a C header, a binary block, YAML or another program's form", convert);
  command.option("parameters", options.parameters, {is::required}, "parameter file");
  command.option("--header", options.header, "C header to write");
  command.option("--binary", options.binary, "binary block (with a checksum) to write");
  command.option("--yaml", options.yaml, "YAML file to write");
  std::vector<std::string> names;
  for (const ForeignForm& form : foreign_forms) names.emplace_back(form.name);
  CLI::Option* const out = command.option("--out", options.out, "file to write in the form that --form names");
  CLI::Option* const form =
      command.option("--form", options.form, {is::one_of(names)}, "form of another program (docs/files.md)");
  needs(form, out);
  needs(out, form);
}

void add_navigate_command(CommandLine& line) {
  const auto [command, options] = line.command<NavigateOptions>(
      "navigate", "run free inertial navigation on a recording and report its drift", navigate);
  NavigationRequest& request = options.request;
  command.option("recording", request.recording, {is::required}, "a folder (binary or text form) or a .tcr file");
  command.option("--parameters", request.parameters, "parameter file; omit it if `turncal apply` made the recording");
  command.option("--against", request.against, "second parameter file to compare with");
  command.option("--reference", request.reference,
                 "true track: a table of time_s, latitude_deg, longitude_deg (docs/verification.md)");
  command.option("--out", options.out, {is::required}, "folder for navigation.html, navigation.conf, track.csv");
  command.option("--align", request.align_s, {is::time(20.0, 86400.0), is::default_in_help}, "length of the alignment");
  command.option("--from", request.from_s, {is::time(0.0, longest_recording_s), is::default_in_help},
                 "start, from the first sample");
  command.option("--to", request.to_s, {is::time(0.0, longest_recording_s)}, "end; default: the end of the recording");
  command.option("--for", request.free_s, {is::time(1.0, longest_recording_s)},
                 "length of each free navigation; default: an hour, or what there is");
  command.option("--branches", request.branches, {is::in(1, 1000), is::default_in_help},
                 "number of navigations, started at times spread over the recording");
  command.format(options.format, "print navigation.conf in this form instead of text");
}

}  // namespace turncal
