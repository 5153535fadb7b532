// libturncal: recordings in memory. Every function calls the job that the command calls.
#include <turncal/allan.h>
#include <turncal/calibrate.h>
#include <turncal/diagnose.h>
#include <turncal/predict.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <mutex>
#include <span>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/csv_map_import.h"
#include "orchestrator/jobs/allan_job.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/import_job.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/jobs/prediction_job.h"

namespace turncal::v0 {
Error::~Error() = default;
struct Report::Content {
  Document document;
};

struct Recording::Content {
  std::string name;  // as given by the caller
  std::string path;  // as in messages (RecordingSource::path)
  bool is_file = false;
  turncal::RecordingInfo info;
  std::vector<Sample> samples;
  std::vector<Segment> segments;
  turncal::RecordingDamage damage;
  std::vector<std::string> notes;
};

struct Parameters::Content {
  ParameterFile file;
  std::string name;  // name of the file, for messages
};

namespace {
[[noreturn]] void raise(const turncal::Error& error) {
  throw Error(static_cast<ErrorKind>(exit_code(error.kind)), one_line(error.message));
}
void check(const Status& status) {
  if (!status) raise(status.error());
}
template <class T>
T value(Result<T> result) {
  if (!result) raise(result.error());
  return std::move(*result);
}

// Samples and segments have the memory layout of the program's own.
static_assert(sizeof(Sample) == sizeof(ImuSample) && sizeof(Segment) == sizeof(turncal::Segment));

template <class To, class From>
std::vector<To> each_as(const From& from) {
  std::vector<To> all;
  all.reserve(from.size());
  for (const auto& one : from) all.push_back(std::bit_cast<To>(one));
  return all;
}

RecordingInfo face(const turncal::RecordingInfo& from) {
  return {.sample_period_s = from.sample_period_s,
          .latitude_deg = from.latitude_deg,
          .gravity_mps2 = from.gravity_mps2,
          .unit_serial = from.unit_serial,
          .gyro_increment = static_cast<IncrementKind>(from.gyro_increment),
          .accel_increment = static_cast<IncrementKind>(from.accel_increment),
          .accel_pulse_mps = from.accel_pulse_mps,
          .has_temperature = from.has_temperature,
          .started_utc_s = from.started_utc_s,
          .simulated = from.simulated};
}

// A recording in memory, as a source for the jobs. `recording` must outlive it.
class MemorySource : public RecordingSource {
 public:
  explicit MemorySource(const Recording& recording)
      : RecordingSource(recording.content().path), content_(recording.content()) {
    info_ = content_.info;
    segments_ = each_as<turncal::Segment>(content_.segments);
    damage_ = content_.damage;
  }

 protected:
  Status stream(const Sink& sink) override {
    constexpr std::size_t block = 1024;
    const std::span<const Sample> all = content_.samples;
    for (std::size_t k = 0; k < all.size(); k += block)
      TRY(sink(each_as<ImuSample>(all.subspan(k, std::min(block, all.size() - k)))));
    return {};
  }

 private:
  const Recording::Content& content_;
};

// Reads a source into memory. `name`: as given by the caller; is_file: it can be opened again by that name.
Recording read_all(RecordingSource& source, const std::string& name, bool is_file,
                   std::vector<std::string> notes = {}) {
  auto content = std::make_shared<Recording::Content>();
  check(source.read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) content->samples.push_back(std::bit_cast<Sample>(sample));
    return Status();
  }));
  *content = {name,
              source.path(),
              is_file,
              source.info(),
              std::move(content->samples),
              each_as<Segment>(source.segments()),
              source.damage(),
              std::move(notes)};
  return Recording(std::move(content));
}

std::vector<LoadedRecording> load_all(std::span<const Recording> recordings) {
  std::vector<LoadedRecording> all;
  for (const Recording& recording : recordings) {
    MemorySource source(recording);
    all.push_back(value(load_recording(source)));
  }
  return all;
}

Parameters parameters_of(ParameterFile file, std::string name = "parameters") {
  return Parameters(std::make_shared<const Parameters::Content>(std::move(file), std::move(name)));
}

// Returns `key = value` of every line except comments and the checksum.
std::vector<std::pair<std::string, std::string>> items_of(std::string_view lines) {
  std::vector<std::pair<std::string, std::string>> items;
  while (!lines.empty()) {
    const std::string_view line = next_line(lines);
    const std::size_t equals = line.find('=');
    if (line.starts_with('#') || equals == std::string_view::npos) continue;
    const std::string_view key = trimmed(line.substr(0, equals));
    if (key != "checksum") items.emplace_back(key, trimmed(line.substr(equals + 1)));
  }
  return items;
}

Report report_of(Document document) {
  if (document.title.empty()) document.title = document.heading;
  return Report(std::make_shared<const Report::Content>(std::move(document)));
}

std::string time_or_now(const std::string& time_utc) {
  if (!time_utc.empty() && !parse_utc(time_utc))
    raise(input_error("time_utc = '" + time_utc + "': expected a time as 2026-01-31T12:00:00Z"));
  return time_utc.empty() ? format_utc(wall_utc_s()) : time_utc;
}

}  // namespace

Recording Recording::load(const std::string& path) { return read_all(*value(RecordingSource::open(path)), path, true); }

Recording Recording::import_table(const std::string& path, const std::string& map) {
  static std::mutex one_at_a_time;  // Debian's libhdf5 is not thread-safe
  const std::lock_guard<std::mutex> now(one_at_a_time);
  const CsvImport table = value(import_csv(value(read_csv_map(map)), path));
  std::vector<std::string> notes = value(check_import(table, path, "the map"));
  notes.insert(notes.begin(), words_of(table));
  return Recording(std::make_shared<Content>(
      Content{path, path, false, table.info, each_as<Sample>(table.samples), {}, {}, std::move(notes)}));
}

Recording Recording::with_rests(double min_rest_s) const {
  if (!(min_rest_s >= 0.1 && min_rest_s <= 3600.0))
    raise(input_error("min_rest_s = " + format_number(min_rest_s) + ": expected a number from 0.1 to 3600"));
  MemorySource source(*this);
  auto content = std::make_shared<Content>(*content_);
  content->segments = each_as<Segment>(value(find_rests(source, {.min_rest_s = min_rest_s})).segments);
  content->is_file = false;
  return Recording(std::move(content));
}

const std::string& Recording::path() const { return content_->path; }
RecordingInfo Recording::info() const { return face(content_->info); }
std::span<const Sample> Recording::samples() const { return content_->samples; }
std::span<const Segment> Recording::segments() const { return content_->segments; }
std::string Recording::damage() const { return describe(content_->damage); }
std::vector<std::string> Recording::notes() const { return content_->notes; }
std::string Recording::hash() const {
  MemorySource source(*this);
  return value(source.content_hash());
}

std::span<const std::string_view, 24> parameter_keys() { return turncal::parameter_keys; }
Parameters Parameters::read(const std::string& path) { return parameters_of(value(read_parameter_file(path)), path); }
Parameters Parameters::parse(const std::string& text, const std::string& name) {
  return parameters_of(value(parse_parameter_file(text, name)), name);
}
std::string Parameters::text() const { return value(format_parameter_file(content_->file)); }
void Parameters::write(const std::string& path) const { check(write_parameter_file(content_->file, path)); }

std::array<double, 24> Parameters::values() const {
  std::array<double, 24> all{};
  std::ranges::copy(content_->file.parameters, all.begin());
  return all;
}
std::array<double, 24> Parameters::sigmas() const {
  std::array<double, 24> all{};
  std::ranges::transform(content_->file.sigma, all.begin(), [](const std::optional<double>& sigma) {
    return sigma.value_or(std::numeric_limits<double>::quiet_NaN());
  });
  return all;
}
bool Parameters::trusted() const { return is_trusted(content_->file); }
std::vector<std::pair<std::string, std::string>> Parameters::items() const { return items_of(text()); }
std::optional<double> number_of(const std::pair<std::string, std::string>& item) {
  return DataCell::of_item(item.first, item.second).json == item.second ? parse_number(item.second) : std::nullopt;
}

Recording apply(const Recording& recording, const Parameters& parameters) {
  const Parameters::Content& given = parameters.content();
  MemorySource source(recording);
  SampleCalibration calibration = value(SampleCalibration::make(given.file, given.name, source));
  std::vector<std::string> notes;
  if (!is_trusted(given.file)) notes.push_back(distrust_of(given.file, given.name));
  if (calibration.temperature) notes.push_back(describe(*calibration.temperature));
  CalibratedSource calibrated(source, std::move(calibration));
  return read_all(calibrated, recording.content().name, false, std::move(notes));
}

std::string Report::text() const { return as_text(content_->document); }
std::string Report::json() const { return as_json(content_->document); }
std::string Report::html() const { return as_page(content_->document).html; }

Calibration calibrate(std::span<const Recording> recordings, const CalibrateOptions& options) {
  if (recordings.empty()) raise(input_error("recordings: expected at least one"));
  if (std::ranges::find(calibration_methods, options.method) == std::end(calibration_methods))
    raise(input_error("method '" + options.method + "': expected " +
                      one_of(options.method, {std::begin(calibration_methods), std::end(calibration_methods)})));
  const std::vector<LoadedRecording> loaded = load_all(recordings);
  CalibrationOutput output = value(calibrate_recordings(
      loaded, {.method = options.method, .time_utc = time_or_now(options.time_utc), .partial = options.partial}));
  add_measured_utc(loaded.front().data.info, output.file);
  Document report = calibration_document(output.file, output.notes, {});
  return {parameters_of(std::move(output.file)), std::move(output.notes), std::move(output.distrust),
          report_of(std::move(report))};
}

Diagnosis diagnose(std::span<const Recording> recordings, const DiagnoseOptions& options) {
  if (recordings.empty()) raise(input_error("recordings: expected at least one"));
  const std::vector<LoadedRecording> fitted = load_all(recordings), holdouts = load_all(options.holdouts);
  DiagnosisRequest request{.time_utc = time_or_now(options.time_utc), .holdouts = holdouts};
  const Recording& navigated = options.holdouts.empty() ? recordings.front() : options.holdouts.front();
  if (navigated.content().is_file) request.samples = navigated.content().name;
  DiagnosisOutput output = value(diagnose_recordings(fitted, request));
  Diagnosis result{.verdict = to_string(output.diagnosis.verdict),
                   .effects = std::move(output.diagnosis.effect_names),
                   .parameters = {},
                   .items = items_of(output.files.conf),
                   .text = output.files.conf,
                   .report = report_of(std::move(output.files.report))};
  if (output.files.parameters) result.parameters = parameters_of(std::move(*output.files.parameters));
  return result;
}

Allan allan(const Recording& recording) {
  MemorySource source(recording);
  const turncal::AllanReport report = value(allan_report(source, recording.content().name));
  std::array<AllanAxis, 6> axes;
  for (std::size_t k = 0; k < axes.size(); ++k) {
    const turncal::AllanAxis& from = report.result.axes[k];
    for (const turncal::AllanPoint& p : from.points)
      axes[k].points.push_back({p.tau_s, p.deviation, p.low, p.high, p.degrees});
    std::ranges::transform(from.fit.terms, axes[k].coefficients.begin(), [](const auto& c) {
      return AllanCoefficient{c.value, c.sigma, c.limit};
    });
  }
  return {std::move(axes), report.result.total_s, format_allan_points(report.result),
          format_imu_yaml(report.result, report.sample_s), report_of(allan_document(report))};
}

Prediction predict(const std::vector<std::string>& sequence_files, const PredictOptions& options) {
  if (sequence_files.empty()) raise(input_error("sequences: expected at least one"));
  PredictRequest request{.sequences = sequence_files,
                         .site = {.station = options.station,
                                  .latitude_deg = options.latitude_deg,
                                  .gravity_mps2 = options.gravity_mps2,
                                  .arw_deg_per_rt_h = options.arw_deg_per_rt_h,
                                  .vrw_ug_per_rt_hz = options.vrw_ug_per_rt_hz,
                                  .gyro_bias_instability_degph = options.gyro_bias_instability_degph,
                                  .accel_bias_instability_ug = options.accel_bias_instability_ug},
                         .effects = options.effects};
  Predictions found = value(predict_sequences(request));
  std::vector<SequencePrediction> sequences;
  for (std::size_t c = 0; c < found.columns.size(); ++c) {
    const NamedPrediction& column = found.columns[c];
    SequencePrediction one{column.name, column.station_s, column.prediction.static_s, {}, found.refused[c]};
    for (std::size_t k = 0; k < one.sigma.size(); ++k)
      one.sigma[k] = column.prediction.determined[k] ? column.prediction.sigma[Eigen::Index(k)]
                                                     : std::numeric_limits<double>::quiet_NaN();
    sequences.push_back(std::move(one));
  }
  return {std::move(sequences), report_of(std::move(found.document))};
}

}  // namespace turncal::v0
