#include "orchestrator/jobs/calibration_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include "calib/closed_form/closed_form.h"
#include "calib/evidence/evidence.h"
#include "calib/evidence/felt_latitude.h"
#include "calib/evidence/rest_diagnosis.h"
#include "calib/joint/several_recordings.h"
#include "calib/rests/rest_data.h"
#include "calib/rests/rest_model.h"
#include "calib/rests/rest_units.h"
#include "calib/rests/single_pose.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/data_screen.h"
#include "calib/statistics/unit_slip.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/jobs/navigation/navigation_job.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/station/station_config.h"
#include "orchestrator/station/version.h"

namespace turncal {

std::string distrust_of(const CompressedRecording& recording, const JointResult& result, bool test_fit) {
  if (result.whiteness.level == 0.0) return "";  // too few seconds at rest
  // When the unit is quieter than the noise model, correlated or not, the sigmas are too large, if anything.
  if (!result.whiteness.white && result.whiteness.level > 1.0) return result.whiteness.message;
  if (!test_fit) return "";
  if (std::string latitude = wrong_latitude(recording, result); !latitude.empty()) return latitude;
  return what_speaks_against(recording, result);
}

namespace {

// Gives ChannelLife the table's turns, segment by segment.
class TableLife {
 public:
  TableLife(const RecordingInfo& info, const Segments& segments) : life_(info), segments_(segments) {}
  void add(std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      while (index_ < segments_.size() && sample.counter >= segments_[index_].end_sample) end_segment();
      life_.add(sample);
    }
  }
  std::string finish() {
    while (index_ < segments_.size()) end_segment();
    return without_table_angles(segments_) && segments_.size() > 1 ? life_.without_change() : life_.defect();
  }

 private:
  void end_segment() {
    if (index_ > 0) {
      const Segment &from = segments_[index_ - 1], &to = segments_[index_];
      life_.turned(std::abs(to.heading_deg - from.heading_deg) + std::abs(to.pitch_deg - from.pitch_deg) +
                   std::abs(to.roll_deg - from.roll_deg));
    }
    ++index_;
  }
  ChannelLife life_;
  const Segments& segments_;
  std::size_t index_ = 0;
};

// Returns whether `later` begins before `earlier` has ended.
bool overlap(const LoadedRecording& earlier, const LoadedRecording& later) {
  const auto &from = earlier.data.info.started_utc_s, &at = later.data.info.started_utc_s;
  constexpr double whole_seconds = 2.0;  // both times are in whole seconds
  return from && at && *from <= *at && double(*at - *from) < earlier.recorded_s - whole_seconds;
}

using Recordings = std::span<const LoadedRecording>;

// Returns an error when two recordings are the same, or they differ in unit, kind of increments or in having table angles.
Status check_same_unit(Recordings some, Recordings further = {}) {
  std::vector<const LoadedRecording*> recordings;
  for (const Recordings& these : {some, further})
    for (const LoadedRecording& one : these) recordings.push_back(&one);
  const LoadedRecording& first = some.front();
  const auto kind = [](IncrementKind k) { return std::string(k == IncrementKind::pulses ? "pulses" : "rad or mps"); };
  for (const LoadedRecording* one : recordings) {
    const RecordingInfo &info = one->data.info, &expected = first.data.info;
    const auto keys = [&](const RecordingInfo& of) -> std::vector<std::pair<std::string, std::string>> {
      const bool pulses = expected.accel_increment == IncrementKind::pulses;
      return {{"unit_serial", of.unit_serial},
              {"gyro_increment", kind(of.gyro_increment)},
              {"accel_increment", kind(of.accel_increment)},
              {"accel_pulse_mps", pulses ? format_number(of.accel_pulse_mps) : ""},
              {"simulated", of.simulated ? "true" : "false"}};
    };
    const auto found = keys(info), wanted = keys(expected);
    if (const auto [is, instead] = std::ranges::mismatch(found, wanted); is != found.end())
      return input_error("{}: {} = '{}': expected '{}', as in {}", one->path, is->first, is->second, instead->second,
                         first.path);
    if (one->by_hand != first.by_hand)
      return input_error("{}: expected a recording {} table angles, as {}", one->path,
                         first.by_hand ? "without" : "with", first.path);
    // The rig's clock starts every dry run at the same time.
    const auto meanwhile = std::ranges::find_if(recordings, [&](const LoadedRecording* other) {
      return other != one && !info.simulated && overlap(*other, *one);
    });
    if (meanwhile != recordings.end())
      return input_error(one->path + ": started_utc = " + format_utc(double(*info.started_utc_s)) + ", while " +
                         (*meanwhile)->path + " was being recorded: expected one unit, at one time");
    const auto same = [&](const LoadedRecording* other) { return other != one && other->hash == one->hash; };
    if (std::ranges::any_of(recordings, same))
      return input_error(one->path + ": is given twice: expected recordings that differ");
  }
  return {};
}

void note_data(const LoadedRecording& recording, std::vector<std::string>& notes) {
  if (const std::string damage = describe(recording.damage); !damage.empty()) notes.push_back(damage);
  if (!recording.segmented.empty()) notes.push_back(recording.segmented);
  notes.insert(notes.end(), recording.stuck.begin(), recording.stuck.end());
  std::map<DataEvent::Kind, std::int64_t> counts;
  for (const DataEvent& event : recording.data.events)
    if (event.axis != set_aside_axis) counts[event.kind] += event.count;
  for (const auto& [kind, count] : counts) notes.push_back(fmt::format("data: {}: {}", to_string(kind), count));
}

Status closed_form(const CompressedRecording& recording, CalibrationOutput& output) {
  const ClosedFormResult result = TRY(closed_form_calibrate(recording, start_parameters(recording.info)));
  if (!result.converged) return Error{ErrorKind::unit_failed, "the calibration does not converge: " + result.message};
  output.file.parameters = to_vector(result.parameters);
  output.file.model = "base";
  output.notes.push_back(fmt::format("closed form: converged after {} over {} samples", counted(result.passes, "pass"),
                                     recording.samples));
  return {};
}

// Notes a mounting that differs from the table's axes.
void note_mounting(const JointResult& result, std::vector<std::string>& notes) {
  if (!result.start.mounting_text.empty())
    notes.push_back("the unit is mounted " + result.start.mounting_text + " against the table's axes");
}

void note_joint(const JointResult& result, double sample_period_s, std::vector<std::string>& notes) {
  notes.push_back(
      fmt::format("joint estimate: converged after {}; normalised residual {:.4f}{}",
                  counted(result.iterations, "iteration"), result.normalised_rms,
                  result.whiteness.white ? "" : ", NOT WHITE: the noise model does not explain the residual"));
  note_mounting(result, notes);
  for (const Fault& fault : result.faults)
    notes.push_back(fmt::format("fault: {} at sample {} ({:.3f} s): {}", fault.what, fault.first_sample,
                                double(fault.first_sample) * sample_period_s, fault.action));
  for (const Undetermined& direction : result.undetermined) {
    if (direction.combination.empty()) continue;
    std::string line = "not determined by this recording:";
    for (const auto& [key, weight] : direction.combination) line += " " + key;
    notes.push_back(line);
  }
}

// Returns "gyro x clipped at 8 deg/s in 14 turns"; empty when none did.
std::string clipped_gyros(const CompressedRecording& recording) {
  std::map<std::string, int> turns;
  for (const DataEvent& event : clipped_turns(recording)) ++turns[clipped_text(recording.info, event.axis, event.size)];
  std::string all;
  for (const auto& [text, count] : turns) all += (all.empty() ? "" : ", ") + text + " in " + counted(count, "turn");
  return all;
}

constexpr std::string_view too_little_data = "too little data to test the fit";

// Returns why a recording leaves parameters undetermined, as "expected slower turns, ...". Data that the model does not fit raise the estimated
// noise until it hides the rest.
std::string why_open(const CompressedRecording& recording, const JointResult& result, const Diagnosis* found) {
  if (const std::string clipped = clipped_gyros(recording); !clipped.empty())
    return "expected slower turns, " + clipped;
  if (const std::string wrong = wrong_latitude(recording, result); !wrong.empty())
    return "expected the site's latitude, " + wrong;
  std::optional<Diagnosis> made;
  if (found == nullptr && result.whiteness.level > 0.0)  // enough seconds at rest
    found = &made.emplace(diagnose(recording, {.estimate = {}, .base = &result}));
  return found == nullptr || found->verdict == Verdict::not_tested ? "expected the steps that do"
                                                                   : "the model does not fit: " + found->reason;
}

Status joint(const LoadedRecording& loaded, const CalibrationRequest& request, CalibrationOutput& output) {
  const CompressedRecording& recording = loaded.data;
  JointOptions options;
  options.candidates = latitude_columns();
  JointResult result = request.known ? estimate_beside(recording, *request.known) : joint_estimate(recording, options);
  if (!result.converged) {
    const std::string wrong = wrong_latitude(recording, result);
    return Error{ErrorKind::unit_failed,
                 "the calibration does not converge: " +
                     (wrong.empty() ? result.message : "expected the site's latitude, " + wrong)};
  }
  const std::string open = request.partial ? "" : what_is_open({&loaded, 1}, result);
  if (!open.empty()) return not_determined(open);
  describe_estimate(result, recording, false, output.file);
  output.distrust = distrust_of(recording, result, request.test_fit);
  describe_trust(result.whiteness.level > 0.0 ? output.distrust : std::string(too_little_data), output.file);
  note_joint(result, recording.info.sample_period_s, output.notes);

  output.fit = std::move(result);
  return {};
}

Status rests_by_hand(const CompressedRecording& recording, const CalibrationRequest& request,
                     CalibrationOutput& output) {
  const RestData data = make_rest_data(recording);
  output.notes.insert(output.notes.end(), data.notes.begin(), data.notes.end());
  if (const std::string wrong = wrong_units(data); !wrong.empty()) return Error{ErrorKind::unit_failed, wrong};
  RestDiagnosis judged;
  if (request.test_fit)
    judged = TRY(diagnose_rests(data));
  else
    judged.base = TRY(fit_rests(data, EffectModel{}));
  const RestFit& fit = judged.base;
  if (!fit.converged) return Error{ErrorKind::unit_failed, "the calibration does not converge: " + fit.message};
  if (!fit.undetermined.empty() && !request.partial)
    return not_determined(
        fmt::format("these rests and rotations do not determine {}: expected more of them, about other axes",
                    fmt::join(fit.undetermined, " ")));
  const std::string unjudged = why_not_tested(data, fit);
  if (!unjudged.empty() && !request.partial)
    return not_determined("not tested: the data determine nothing to be judged: " + unjudged);
  describe_rest_fit(fit, as_joint(fit, {}, data), data, output.file);
  if (!unjudged.empty())
    output.distrust = "not tested: " + unjudged;
  else if (request.test_fit)
    output.distrust = judged.diagnosis.why_base_not_trusted();

  describe_trust(output.distrust, output.file);
  output.notes.push_back(fmt::format("{}: {} rests and {} rotations by hand, converged after {} iterations",
                                     no_table_angles, data.rests.size(), data.legs.size(), fit.iterations));
  output.notes.push_back("errors: " + plain(error_text(fit.errors)));
  output.notes.push_back("cross-validation: " + plain(error_text(fit.left_out)));
  std::vector<std::string> set_aside;
  for (std::size_t k = 0; k < data.legs.size(); ++k)
    if (!data.legs[k].fault.empty()) set_aside.push_back(fmt::format("{} ({})", k + 1, data.legs[k].fault));
  if (!set_aside.empty()) output.notes.push_back("rotations set aside: " + join(set_aside));
  if (!fit.undetermined.empty()) output.notes.push_back("not determined by this recording: " + join(fit.undetermined));
  return {};
}

// Calibrates each recording. One that leaves directions undetermined, or does not converge, is calibrated again with the parameters of one that does.
Result<std::vector<CalibrationOutput>> calibrate_each(const std::vector<LoadedRecording>& recordings,
                                                      CalibrationRequest request) {
  request.partial = true;
  std::vector<Result<CalibrationOutput>> each;
  for (const LoadedRecording& recording : recordings) each.push_back(calibrate_recording(recording, request));
  const auto whole = [](const Result<CalibrationOutput>& one) { return one.ok() && one->fit->undetermined.empty(); };
  const auto known = std::ranges::find_if(each, whole);
  if (known != each.end()) request.known = (*known)->fit->parameters;
  std::vector<CalibrationOutput> outputs;
  for (std::size_t k = 0; k < each.size(); ++k) {
    if (request.known && !whole(each[k])) {
      each[k] = calibrate_recording(recordings[k], request);
      if (each[k])
        each[k]->notes.push_back("determines too little by itself: its biases are estimated with the parameters of " +
                                 recordings[std::size_t(known - each.begin())].path);
    }
    if (!each[k]) return each[k].error();
    outputs.push_back(std::move(*each[k]));
  }
  return outputs;
}

// Checks that all are of one unit, and that those fitted together have one site and one sample rate.
Status check_together(Recordings fitted, Recordings holdouts) {
  TRY(check_same_unit(fitted, holdouts));
  const LoadedRecording& first = fitted.front();
  if ((fitted.size() > 1 || holdouts.size() > 1) && first.by_hand)
    return input_error(first.path + ": " + no_table_angles + ": expected one recording, and one holdout at most");
  for (const LoadedRecording& one : fitted) {
    const auto same = [&](const char* key, double RecordingInfo::*value) -> Status {
      const double is = one.data.info.*value, expected = first.data.info.*value;
      if (value == &RecordingInfo::sample_period_s ? same_sample_period(is, expected) : is == expected) return {};
      return input_error("{}: {} = {}: expected {}, as in {}", one.path, key, format_number(is),
                         format_number(expected), first.path);
    };
    TRY(same("sample_period_s", &RecordingInfo::sample_period_s));
    TRY(same("latitude_deg", &RecordingInfo::latitude_deg));
    TRY(same("gravity_mps2", &RecordingInfo::gravity_mps2));
  }
  for (const Recordings& these : {fitted, holdouts})
    for (const LoadedRecording& one : these) TRY(check_data(one));
  return {};
}

// Navigates to tell what the effects are worth in miles; adds a note where that is not possible.
void navigate_effects(const LoadedRecording& recording, const Diagnosis& diagnosis, const DiagnosisRequest& request,
                      DiagnosisContext& context) {
  request.phase("navigating with and without the added effects");
  const LoadedRecording& navigated = request.holdouts.empty() ? recording : request.holdouts.front();
  Result<NavigationWorth> worth = worth_of_effects(diagnosis, context, request.samples, navigated.data);
  if (!worth) {
    context.notes.push_back("not navigated: " + worth.error().message);
    return;
  }
  context.worth = std::move(*worth);
  context.worth->source = request.holdouts.empty() ? "fitted recording" : "second recording";
}

Result<DiagnosisOutput> of_table(Recordings recordings, const JoinedRecordings& joined, const DiagnosisRequest& request,
                                 DiagnosisContext& context) {
  const LoadedRecording& recording = recordings.front();
  DiagnosisOptions settings;
  settings.estimate.noise = request.noise;
  settings.base = request.noise ? nullptr : request.base;
  for (const LoadedRecording& holdout : request.holdouts) settings.holdouts.push_back(&holdout.data);
  request.phase("diagnosing: fit, missing effects, held-out data");
  Diagnosis diagnosis = diagnose(joined, settings);
  if (diagnosis.verdict == Verdict::not_tested) {
    const std::string open =
        diagnosis.extended.converged ? what_is_open(recordings, diagnosis.extended, &diagnosis) : "";
    return Error{ErrorKind::unit_failed, recording.path + ": " + (open.empty() ? diagnosis.reason : open)};
  }
  note_mounting(diagnosis.base, context.notes);
  if (recordings.size() > 1)
    for (std::string& line : turn_on_words(diagnosis.each.turn_ons)) context.notes.push_back(std::move(line));
  context.noise_given = request.noise.has_value();
  if (has_after(diagnosis) && !request.samples.empty()) navigate_effects(recording, diagnosis, request, context);
  request.phase("writing the report");
  DiagnosisFiles files = diagnosis_files(diagnosis, context);
  return DiagnosisOutput{std::move(diagnosis), std::move(files)};
}

// Reports what a unit at rest in one pose tells.
Result<DiagnosisOutput> of_single_pose(const LoadedRecording& recording, const DiagnosisContext& context) {
  const LoadedRecording in_seconds = TRY(load_recording(recording.path, {}, CompressionOptions{}));
  const Result<SinglePose> pose = analyse_single_pose(in_seconds.data);
  if (!pose) return input_error(recording.path + ": " + pose.error().message);
  DiagnosisOutput output;
  output.diagnosis.verdict = Verdict::not_tested;
  output.diagnosis.why_not_trusted = output.diagnosis.reason =
      fmt::format("one pose of {} s determines no scale factor and no bias; it gives noise and slow changes",
                  significant(pose->duration_s, 4));
  Document& report = output.files.report =
      begin_document(output.diagnosis, context, verdict_sentence(output.diagnosis));
  report.add(pose_facts(*pose));
  report.figure(allan_figure(pose->noise));
  output.files.conf = format_pose(*pose, output.diagnosis.why_not_trusted);
  return output;
}

Result<DiagnosisOutput> of_hand_turned(const LoadedRecording& recording, const DiagnosisRequest& request,
                                       DiagnosisContext& context) {
  if (request.noise)
    return input_error(recording.path + ": " + no_table_angles +
                       ": expected no --arw, --vrw or bias instability, the noise is measured in the rests");
  const RestData data = make_rest_data(recording.data);
  if (data.rests.size() == 1) return of_single_pose(recording, context);
  std::optional<RestData> other;
  if (!request.holdouts.empty()) {
    other = make_rest_data(request.holdouts.front().data);
    if (other->legs.empty())
      return input_error(request.holdouts.front().path + ": holds no rotation between two rests");
  }
  request.phase("diagnosing: fit, missing effects, cross-validation");
  Result<RestDiagnosis> result = diagnose_rests(data, other ? &*other : nullptr);
  if (!result) return Error{result.error().kind, recording.path + ": " + result.error().message};
  context.notes.insert(context.notes.end(), data.notes.begin(), data.notes.end());
  context.method = rest_method;
  context.hand_turned = true;
  request.phase("writing the report");
  DiagnosisFiles files = rest_diagnosis_files(*result, data, context);
  return DiagnosisOutput{std::move(result->diagnosis), std::move(files)};
}

}  // namespace

Result<Segmentation> find_rests(RecordingSource& source, const SegmentationOptions& options) {
  RestFinder finder(source.info(), options);
  TRY(source.read_to_use([&](std::span<const ImuSample> samples) {
    finder.add(samples);
    return Status();
  }));
  Segmentation found = finder.finish();
  if (!found.segments.empty()) return found;
  return input_error(source.path() + ": no rest found: " +
                     (options.threshold ? "no stretch of " + format_number(options.min_rest_s) +
                                              " s stays below the threshold " + format_number(*options.threshold)
                                        : found.reason));
}

// Of a complete run, the first step of its north seeking, whose rests are no part of its calibration; 0: there is none.
int north_seeking_step(const std::string& path) {
  const Result<JournalContents> journal = read_journal(folder_of(path) + "/" + journal_name);
  if (!journal || !journal->seal_utc_s || journal->begin_value("verify") != "true") return 0;
  const Result<Sequence> seeking = parse_sequence(std::string(builtin_verify_text), builtin_verify_name);
  const std::optional<int> last = parse_integer<int>(value_of(journal->transition, "step"));
  const int first = seeking && last ? *last + 1 - int(seeking->steps.size()) : 0;
  return first > 1 ? first : 0;
}

Result<LoadedRecording> load_recording(RecordingSource& source, const std::function<void(std::int64_t)>& progress,
                                       const std::optional<CompressionOptions>& blocks, int before_step) {
  LoadedRecording loaded;
  Segments segments = source.segments();
  if (segments.empty()) {
    segments = TRY(find_rests(source)).segments;
    loaded.segmented = fmt::format("the recording came without segments: {} found (turncal segment lists them)",
                                   counted(std::ranges::count(segments, SegmentKind::still, &Segment::kind), "rest"));
  }
  loaded.path = source.path();
  if (before_step == 0) before_step = north_seeking_step(source.path());
  loaded.damage = source.damage();
  loaded.by_hand = without_table_angles(segments);
  Compressor compressor(source.info(),
                        blocks.value_or(loaded.by_hand ? rest_compression_options() : CompressionOptions{}));
  std::optional<ClippingFinder> clipping;
  if (loaded.by_hand) clipping.emplace();
  loaded.recorded_s = double(segments.back().end_sample) * source.info().sample_period_s;
  if (before_step > 0)
    segments.erase(std::ranges::find_if(segments, [&](const Segment& segment) { return segment.step >= before_step; }),
                   segments.end());
  if (segments.empty())
    return input_error(source.path() + ": nothing was recorded before step " + std::to_string(before_step));
  SegmentedFeed feed(compressor, segments);
  TableLife life(source.info(), segments);
  StuckChannels stuck(source.info().sample_period_s);
  RestOf rest(segments);
  std::vector<ImuSample> known;  // of which channels stick
  std::int64_t count = 0;
  TRY(source.read_to_use([&](std::span<const ImuSample> samples) {
    while (before_step > 0 && !samples.empty() && samples.back().counter >= segments.back().end_sample)
      samples = samples.first(samples.size() - 1);
    if (samples.empty()) return Status{};
    known.clear();
    for (const ImuSample& sample : samples) stuck.add(sample, rest.at(sample.counter), known);
    feed.add(known);
    life.add(samples);
    if (clipping)
      for (const ImuSample& sample : samples) clipping->add(sample);
    count += std::int64_t(samples.size());
    if (progress) progress(count);
    return Status{};
  }));
  known.clear();
  stuck.finish(known);
  feed.add(known);
  feed.finish();
  loaded.data = compressor.take();
  if (clipping) clipping->note(loaded.data.events);
  loaded.stuck = stuck.found();
  loaded.dead_channel = life.finish();
  if (loaded.dead_channel.empty()) loaded.dead_channel = fmt::format("{}", fmt::join(stuck.found(true), "; "));
  loaded.hash = TRY(source.content_hash());  // a by-product of read()
  return loaded;
}

Result<LoadedRecording> load_recording(const std::string& path, const std::function<void(std::int64_t)>& progress,
                                       const std::optional<CompressionOptions>& blocks, int before_step) {
  const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(path));
  return load_recording(*source, progress, blocks, before_step);
}

Status check_data(const LoadedRecording& loaded) {
  std::string wrong = loaded.dead_channel;
  if (wrong.empty() && !loaded.by_hand) wrong = wrong_table_units(loaded.data);
  if (!wrong.empty()) return Error{ErrorKind::unit_failed, loaded.path + ": " + wrong};
  if (std::ranges::any_of(loaded.data.blocks, [](const Block& block) { return block.whole_second; })) return {};
  return input_error(loaded.path + ": not one whole second at rest: expected dwells to calibrate from");
}

void add_measured_utc(const RecordingInfo& info, ParameterFile& file) {
  const std::string key = "record.measured_utc";
  if (info.started_utc_s && !find_further(file, key)) file.add_further(key, format_utc(double(*info.started_utc_s)));
}

std::string what_is_open(Recordings recordings, const JointResult& result, const Diagnosis* found) {
  const std::string open = undetermined_parameters(result);
  if (open.empty()) return "";
  if (recordings.size() > 1) return "these recordings do not determine " + open + ": expected the steps that do";
  return "this recording does not determine " + open + ": " + why_open(recordings.front().data, result, found);
}

Error not_determined(const std::string& what) {
  return {ErrorKind::unit_failed, what + " (--partial writes what there is)"};
}

Result<CalibrationOutput> calibrate_recording(const LoadedRecording& loaded, const CalibrationRequest& request) {
  const CompressedRecording& recording = loaded.data;
  CalibrationOutput output;
  if (std::isfinite(recording.mean_temperature_c)) output.mean_temperature_c = recording.mean_temperature_c;
  for (const Block& block : recording.blocks) {
    if (!std::isfinite(block.temperature_c)) continue;
    const double temperature_c = block.temperature_c;
    output.min_temperature_c = std::min(output.min_temperature_c.value_or(temperature_c), temperature_c);
    output.max_temperature_c = std::max(output.max_temperature_c.value_or(temperature_c), temperature_c);
  }
  note_data(loaded, output.notes);
  TRY(check_data(loaded));
  const bool closed = request.method == "closed-form";
  const bool by_hand = loaded.by_hand;
  if (closed && by_hand)
    return input_error(loaded.path + ": " + no_table_angles + ": expected the fourteen steps for --method closed-form");
  if (Status status = by_hand  ? rests_by_hand(recording, request, output)
                      : closed ? closed_form(recording, output)
                               : joint(loaded, request, output);
      !status)
    return Error{status.error().kind, loaded.path + ": " + status.error().message};
  describe_recording(recording.info, output.file);
  output.file.recording_hash = loaded.hash;
  output.file.method = by_hand ? rest_method : request.method;
  output.file.software_version = software_version();
  output.file.time_utc = request.time_utc;
  return output;
}

Result<CalibrationOutput> calibrate_recordings(const std::vector<LoadedRecording>& recordings,
                                               const CalibrationRequest& request) {
  if (recordings.size() == 1) return calibrate_recording(recordings.front(), request);
  if (request.method != calibration_methods[0])
    return input_error("--method " + request.method + ": expected joint where there are several recordings");
  std::vector<SwitchOn> switched_on;
  for (const LoadedRecording& recording : recordings) {
    if (recording.by_hand)
      return input_error(recording.path + ": " + no_table_angles + ": expected several recordings to be from a table");
    switched_on.push_back({recording.hash, recording.data.info.started_utc_s});
  }
  TRY(check_same_unit(recordings));
  CalibrationOutput output;
  std::vector<CalibrationOutput> each = TRY(calibrate_each(recordings, request));
  std::vector<JointResult> estimates;
  bool judged = true;
  for (std::size_t k = 0; k < recordings.size(); ++k) {
    CalibrationOutput& one = each[k];
    output.notes.push_back(recordings[k].path + ":");
    for (const std::string& note : one.notes) output.notes.push_back("  " + note);
    judged = judged && one.fit->whiteness.level > 0.0;
    if (!one.distrust.empty()) output.distrust = recordings[k].path + ": " + one.distrust;
    estimates.push_back(std::move(*one.fit));
  }
  const SeveralRecordings several = combine_recordings(estimates);
  const std::string open = request.partial ? "" : what_is_open(recordings, several.unit);
  if (!open.empty()) return not_determined(open);
  ParameterFile file = std::move(each.front().file);
  file.further.clear();
  file.sigma = {};
  describe_estimate(several.unit, recordings.front().data, false, file);
  if (!several.agree) output.distrust = "the recordings contradict each other";
  describe_trust(judged ? output.distrust : std::string(too_little_data), file);
  describe_turn_ons(several.turn_ons, switched_on, file);
  file.add_further("quality.recordings_agree", std::string(several.agree ? "true" : "false"));
  file.add_further("quality.recordings_p_value", several.p_value);
  output.file = std::move(file);
  output.notes.push_back(
      fmt::format("{} recordings of one unit differ by chi-square {:.1f} of {}, p {:.2g}{}", recordings.size(),
                  several.disagreement, several.degrees, several.p_value,
                  several.agree ? "" : ": THEY CONTRADICT EACH OTHER; every sigma is widened until they do not"));
  const std::vector<std::string> words = turn_on_words(several.turn_ons);
  output.notes.insert(output.notes.end(), words.begin(), words.end());
  output.fit = several.unit;
  return output;
}

std::optional<UnitStatistics> statistics_of(const std::vector<LoadedRecording>& recordings,
                                            const CalibrationOutput& output) {
  if (!output.fit) return std::nullopt;
  if (recordings.size() == 1) return unit_statistics(recordings.front().data, *output.fit);
  std::vector<const CompressedRecording*> all;
  for (const LoadedRecording& recording : recordings) all.push_back(&recording.data);
  return unit_statistics(all);
}

Result<DiagnosisOutput> diagnose_recordings(Recordings recordings, const DiagnosisRequest& request) {
  TRY(check_together(recordings, request.holdouts));
  const LoadedRecording& first = recordings.front();
  std::vector<const CompressedRecording*> parts;
  for (const LoadedRecording& recording : recordings) parts.push_back(&recording.data);
  const JoinedRecordings joined = join_recordings(parts);
  DiagnosisContext context(joined.data);
  context.recording_hash = first.hash;
  context.time_utc = request.time_utc;
  context.of_run = request.of_run;
  for (const LoadedRecording& recording : recordings) {
    context.recording_path += (context.recording_path.empty() ? "" : ", ") + recording.path;
    context.switched_on.push_back({recording.hash, recording.data.info.started_utc_s});
  }
  for (const LoadedRecording& holdout : request.holdouts)
    context.holdout_path += (context.holdout_path.empty() ? "" : ", ") + holdout.path;
  for (const Recordings& these : {recordings, request.holdouts})
    for (const LoadedRecording& loaded : these) {
      const std::string damage = describe(loaded.damage);
      if (!damage.empty()) context.notes.push_back(loaded.path + ": " + damage);
      if (!loaded.segmented.empty()) context.notes.push_back(loaded.path + ": " + loaded.segmented);
    }
  return first.by_hand ? of_hand_turned(first, request, context) : of_table(recordings, joined, request, context);
}

}  // namespace turncal
