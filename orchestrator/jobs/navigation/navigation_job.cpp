#include "orchestrator/jobs/navigation/navigation_job.h"

#include <algorithm>
#include <cmath>

#include "calib/joint/linear_motion.h"
#include "calib/model/parameters.h"
#include "calib/navigation/alignment.h"
#include "calib/statistics/numerics.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/number_table.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {

namespace {

constexpr double default_free_s = 3600.0;

struct Branch {  // intervals
  std::size_t start = 0, length = 0;
};

// A branch begins at the next rest with at least `least_s` of rest within `window_s`; with a reference, which tells when the unit is at rest,
// least_s is the whole window. The last branch, which has no room to wait, may begin in a turn.
struct AlignmentNeeds {
  double window_s = 0.0, least_s = 0.0;
};
std::vector<Branch> branches_of(const std::vector<MotionInterval>& intervals, double length_s, int most,
                                const AlignmentNeeds& needs) {
  constexpr double tiny_s = 1e-6;
  std::vector<double> begin_s = {0.0}, rested_s = {0.0};
  Elapsed time;
  for (const MotionInterval& interval : intervals) {
    time.add(interval.duration_s);
    begin_s.push_back(time.now_s());
    rested_s.push_back(rested_s.back() + (interval.at_rest ? interval.duration_s : 0.0));
  }
  const auto at_time = [&](double s) {
    return std::size_t(std::ranges::upper_bound(begin_s, s + tiny_s) - begin_s.begin()) - 1;
  };
  const auto enough = [&](std::size_t at) {
    return rested_s[at_time(begin_s[at] + needs.window_s)] - rested_s[at] >= needs.least_s - tiny_s;
  };
  std::vector<Branch> found;
  const double last_s = begin_s.back() - length_s;
  for (int k = 0; k < most && last_s > -tiny_s; ++k) {
    const std::size_t last = at_time(last_s);
    std::size_t at = most > 1 ? at_time(last_s * k / (most - 1)) : 0;
    while (at < last && !(intervals[at].at_rest && enough(at))) ++at;
    if (enough(at) && (found.empty() || at > found.back().start))
      found.push_back({at, at_time(begin_s[at] + length_s) - at});
  }
  return found;
}

// Checks that the reference begins at the recording's latitude, for which its gravity holds.
Status check_reference(const ReferenceTrack& reference, const std::string& path, const RecordingInfo& info) {
  constexpr double near_deg = 0.1;
  const double latitude_deg = reference.at(reference.begins_s()).latitude_rad / rad_per_deg;
  if (std::abs(latitude_deg - info.latitude_deg) <= near_deg) return {};
  return input_error(path + ": begins at latitude " + format_number(latitude_deg) + " deg: expected the recording's, " +
                     format_number(info.latitude_deg) + " deg, within " + format_number(near_deg));
}

// Returns parameters that change nothing, for increments that are already calibrated.
Result<ParameterFile> as_it_is(const RecordingInfo& info) {
  if (info.gyro_increment == IncrementKind::pulses || info.accel_increment == IncrementKind::pulses)
    return input_error("it holds pulses: expected --parameters");
  ParameterFile file;
  describe_recording(info, file);
  file.parameters = to_vector(start_parameters(info));
  file.model = "none";
  return file;
}

std::string seconds(double s) { return std::to_string(std::llround(s)) + " s"; }

// `path`: the parameter file.
Result<NavigatedFile> navigate_file(const ParameterFile& file, const std::string& path,
                                    const std::vector<MotionInterval>& intervals, const RecordingInfo& info,
                                    double align_s, const std::vector<Branch>& branches, double from_s,
                                    const std::string& prefix, const ReferenceTrack* reference) {
  const NoiseModel noise = TRY(stored_noise(file, path));
  const StoredCovariance covariance = TRY(stored_covariance(file, path));
  FreeNavigationSetup setup;
  setup.site = {info.latitude_deg * rad_per_deg, info.gravity_mps2};
  setup.noise = noise;
  if (!covariance.covariance.isZero(0.0)) setup.counts = counts_model(from_vector(file.parameters), info);
  setup.parameter_covariance = covariance.covariance;
  setup.align_s = align_s;
  setup.reference = reference;

  NavigatedFile result;
  result.prefix = prefix;
  result.path = path;
  result.model = file.model;
  result.covariance_source = covariance.source;
  result.why_not_trusted = why_not_trusted(file);
  result.noise_assumed = !has_noise(file);
  result.felt = felt_site(intervals, noise, covariance.covariance);
  std::vector<double> rates;
  double squares = 0.0;
  for (const auto& [start, length] : branches) {
    setup.expected = reference == nullptr && start == branches.front().start;
    NavigatedBranch branch;
    branch.start_s = from_s + double(start) * intervals.front().duration_s;
    setup.start_s = branch.start_s;
    Result<FreeNavigation> navigation = navigate_freely(std::span(intervals).subspan(start, length), setup);
    if (!navigation)
      return Error{navigation.error().kind, "branch at " + seconds(branch.start_s) + ": " + navigation.error().message};
    if (setup.expected) {
      const double rms = expected_nm_per_h(navigation->end_covariance_m2, navigation->free_s);
      result.expected = drift_over_runs(std::span(&rms, 1));
    }
    rates.push_back(navigation->nm_per_h);
    squares += navigation->velocity_rms_mps * navigation->velocity_rms_mps;
    branch.navigation = std::move(*navigation);
    result.branches.push_back(std::move(branch));
  }
  result.drift = drift_over_runs(rates);
  if (!std::isfinite(result.drift.rms_nm_per_h))
    return input_error("the drift overflows: expected the increments of a unit at rest");
  result.velocity_rms_mps = std::sqrt(squares / double(branches.size()));
  return result;
}

ParameterFile file_of(const ModelWithout& model, const JointResult& extended, ParameterFile file) {
  file.parameters = model.parameters;
  for (std::size_t k = 0; k < extended.effects.size(); ++k) {
    const EffectColumn& column = extended.effects[k].column;
    if (column.entry == nullptr) continue;
    for (EffectValue& value : file.effects)
      if (value.name == column.entry->name && value.component == component_name(column)) value.value = model.effects[k];
  }
  return file;
}

// Returns the motion over each block, which does not depend on the parameters, for the longest stretch without lost samples.
std::vector<MotionInterval> intervals_of(const CompressedRecording& recording, SampleCalibration& calibration) {
  const SensorModel& model = calibration.model;
  std::vector<MotionInterval> longest, intervals;
  for (const Block& block : recording.blocks) {
    if (block.missing > most_filled_samples) {
      if (intervals.size() > longest.size()) longest = std::move(intervals);
      intervals.clear();
      continue;
    }
    const double t = block.duration_s;
    BlockMotion motion = evaluate(block, model, recording.info.sample_period_s);
    const EffectTerms::Term& term = calibration.effects.at(block.start_sample);
    take_off(t * term.rate_radps, t * term.force_mps2, motion);
    intervals.push_back({quaternion_of(motion.rotation), motion.velocity, motion.rotation,
                         model.accel_scale * block.accel - t * (model.accel_bias_mps2 + term.force_mps2), t,
                         !recording.rotates(block), block.missing});
  }
  return intervals.size() > longest.size() ? intervals : longest;
}

// Returns the rms, over the branches, of the radial rate of the distance between two tracks at the same time.
double rate_between(const NavigatedFile& one, const NavigatedFile& other) {
  std::vector<double> rates;
  for (std::size_t k = 0; k < one.branches.size(); ++k) {
    const std::vector<TrackPoint>&a = one.branches[k].navigation.track, &b = other.branches[k].navigation.track;
    RadialErrorRate rate;
    for (std::size_t i = 0; i < a.size(); ++i) rate.add(a[i].time_s, (a[i].moved_m - b[i].moved_m).norm());
    rates.push_back(rate.nm_per_h());
  }
  return drift_over_runs(rates).rms_nm_per_h;
}

}  // namespace

Result<NavigationReport> navigate_recording(const NavigationRequest& request) {
  std::unique_ptr<RecordingSource> opened = TRY(RecordingSource::open(request.recording));
  std::vector<CalibratedIntervals> files;
  if (request.parameters.empty()) {
    Result<ParameterFile> identity = as_it_is(opened->info());
    if (!identity) return Error{identity.error().kind, request.recording + ": " + identity.error().message};
    files.push_back(TRY(calibrated_intervals(std::move(*identity), "none, increments as they are", *opened)));
  }
  for (const std::string& path : {request.parameters, request.against}) {
    if (path.empty()) continue;
    ParameterFile file = TRY(read_parameter_file(path));
    files.push_back(TRY(calibrated_intervals(std::move(file), path, *opened)));
  }
  RecordingSource& source = *opened;
  if (request.to_s && *request.to_s <= request.from_s)
    return input_error("--to " + seconds(*request.to_s) + ": expected more than --from, " + seconds(request.from_s));
  const RecordingInfo info = source.info();
  if (info.sample_period_s > 1.0)
    return input_error(request.recording + ": a sample in " + seconds(info.sample_period_s) +
                       ": expected one a second and more");
  std::optional<ReferenceTrack> reference;
  if (!request.reference.empty()) {
    reference = TRY(read_reference(request.reference));
    TRY(check_reference(*reference, request.reference, info));
  }
  const Stretch stretch = reference ? Stretch{std::max(request.from_s, reference->begins_s()),
                                              std::min(request.to_s.value_or(reference->ends_s()), reference->ends_s())}
                                    : Stretch{request.from_s, request.to_s};
  const ReferenceTrack* const beside = reference ? &*reference : nullptr;
  const IntegratedSamples integrated = TRY(integrate_recording(source, stretch, files, beside));
  const std::vector<MotionInterval>& intervals = files.front().integrator.intervals();
  const double interval = info.sample_period_s * std::max(1.0, std::round(motion_interval_s / info.sample_period_s));
  const double available_s = double(intervals.size()) * interval;
  const double wanted_s = request.free_s.value_or(std::min(default_free_s, available_s - request.align_s));
  const auto length = std::size_t(std::max(0L, std::lround((request.align_s + wanted_s) / interval)));
  if (available_s <= request.align_s || length > intervals.size())
    return input_error(request.recording + ": " + seconds(available_s) + " to navigate, expected more than " +
                       seconds(request.align_s + std::max(0.0, request.free_s.value_or(0.0))));

  NavigationReport report;
  report.request = request;
  if (reference) report.reference_gap_s = reference->longest_in_motion_s();
  report.info = info;
  if (source.damage().lost_data()) report.damage = describe(source.damage());
  report.faults = integrated.faults;
  report.without_segments = source.segments().empty();
  report.recording_hash = TRY(source.content_hash());
  for (const SampleGap& gap : integrated.gaps) {
    report.filled_samples += gap.samples;
    report.filled_in_motion += gap.in_motion;
  }
  const auto samples_each = std::int64_t(files.front().integrator.samples_per_interval());
  const auto counter_of = [&](std::size_t index) {
    return integrated.first_sample + samples_each * std::int64_t(index);
  };
  std::vector<Branch> branches;
  const double window_s = interval * double(std::max(1L, std::lround(request.align_s / interval)));
  const AlignmentNeeds needs{window_s, reference ? window_s : std::min(window_s, align_min_rest_s)};
  for (Branch branch : branches_of(intervals, double(length) * interval, request.branches, needs)) {
    const std::size_t start = branch.start;
    if (const SampleGap* gap = long_gap_in(integrated.gaps, counter_of(start), counter_of(start + length))) {
      const std::int64_t before = std::max(std::int64_t{0}, gap->first - counter_of(start)) / samples_each;
      branch.length = std::size_t(before);
      const bool kept = double(before) * interval >= request.align_s + 0.5 * wanted_s;
      report.lost.push_back("branch from " + seconds(stretch.from_s + double(start) * interval) +
                            (kept ? " ends early: " : " left out: ") + gap_words(*gap));
      if (!kept) continue;
    }
    branches.push_back(branch);
  }
  if (branches.empty())
    return input_error(request.recording + ": " +
                       (report.lost.empty()
                            ? reference
                                  ? "the reference is nowhere at rest for " + seconds(request.align_s) +
                                        ", which the alignment takes: expected a longer stop, or a shorter --align"
                                  : "nowhere does the unit rest for " + seconds(align_min_rest_s) + " of " +
                                        seconds(request.align_s) + " of alignment: expected a longer --align"
                            : report.lost.front() + "; expected a branch that does not go over more than " +
                                  std::to_string(most_filled_samples) + " lost samples"));
  for (std::size_t k = 0; k < files.size(); ++k) {
    Result<NavigatedFile> file =
        navigate_file(files[k].file, files[k].path, files[k].integrator.intervals(), info, request.align_s, branches,
                      stretch.from_s, k == 0 ? "" : "against.", beside);
    if (!file) return Error{file.error().kind, request.recording + ": " + file.error().message};
    report.files.push_back(std::move(*file));
  }
  return report;
}

Result<ReferenceTrack> read_reference(const std::string& path) {
  TRY(expect_file(path, FileKind::csv));
  const std::string content = TRY(read_whole_file(path));
  const NumberTable table = TRY(read_number_table(content, path,
                                                  {{"time_s"},
                                                   {"latitude_deg"},
                                                   {"longitude_deg"},
                                                   {.name = "height_m", .may_be_missing = true},
                                                   {.name = "velocity_north_mps", .may_be_missing = true},
                                                   {.name = "velocity_east_mps", .may_be_missing = true}},
                                                  TableFormat{.whole_rows = true}));
  if (table.rows() < 2) return input_error(path + ": " + counted(table.rows(), "row") + ": expected at least two");
  const auto& c = table.columns;
  const bool with_velocity = !c[4].empty() && !c[5].empty();
  if (c[4].empty() != c[5].empty())
    return input_error(path + ": one of velocity_north_mps and velocity_east_mps: expected both or neither");
  std::vector<ReferencePoint> points;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const auto refuse = [&](const char* name, double value, const std::string& expected) {
      return input_error(path + ":" + std::to_string(table.line[row]) + ": " + name + " = '" + format_number(value) +
                         "': expected " + expected);
    };
    if (!points.empty() && !(c[0][row] > points.back().time_s))
      return refuse("time_s", c[0][row], "more than in the row before");
    if (std::abs(c[1][row]) > max_navigation_latitude_deg)
      return refuse(
          "latitude_deg", c[1][row],
          "-" + format_number(max_navigation_latitude_deg) + " to " + format_number(max_navigation_latitude_deg));
    if (std::abs(c[2][row]) > 360.0) return refuse("longitude_deg", c[2][row], "-360 to 360");
    ReferencePoint point{c[0][row], c[1][row] * rad_per_deg, c[2][row] * rad_per_deg};
    if (!c[3].empty()) point.height_m = c[3][row];
    if (with_velocity) point.velocity_mps = {c[4][row], c[5][row]};
    points.push_back(point);
  }
  return ReferenceTrack(std::move(points), with_velocity);
}

ModelWithout model_without(const JointResult& extended, const Eigen::MatrixXd& P, const std::string& name) {
  ModelWithout model{to_vector(extended.parameters), {}};
  std::vector<Eigen::Index> rows;  // rows of the covariance held at zero
  for (const EstimatedEffect& effect : extended.effects) model.effects.push_back(effect.value);
  for (std::size_t i = 0; i < extended.free.size(); ++i) {
    const int key = extended.free[i] - parameter_count;
    if (key < 0) continue;
    const EffectEntry* entry = extended.effects[std::size_t(key)].column.entry;
    if (entry != nullptr && entry->name == name) rows.push_back(Eigen::Index(i));
  }
  const auto held = Eigen::Index(rows.size());
  Eigen::VectorXd values(held);
  for (Eigen::Index k = 0; k < held; ++k)
    values[k] = model.effects[std::size_t(extended.free[std::size_t(rows[k])] - parameter_count)];
  const Eigen::VectorXd change = P(Eigen::all, rows) * solve_symmetric(P(rows, rows), values);
  for (std::size_t i = 0; i < extended.free.size(); ++i) {
    const int key = extended.free[i];
    const double by = change[Eigen::Index(i)];
    if (key < parameter_count)
      model.parameters[key] -= by;
    else
      model.effects[std::size_t(key - parameter_count)] -= by;
  }
  for (const Eigen::Index row : rows)  // exactly zero
    model.effects[std::size_t(extended.free[std::size_t(row)] - parameter_count)] = 0.0;
  return model;
}

Result<NavigationWorth> worth_of_effects(const Diagnosis& diagnosis, const DiagnosisContext& context,
                                         const std::string& recording, const CompressedRecording& blocks) {
  const ParameterFile after = diagnosis_parameters(diagnosis, context);
  ParameterFile before = after;
  before.parameters = to_vector(diagnosis.base.parameters);
  before.effects.clear();
  std::vector<ParameterFile> models = {after, std::move(before)};
  for (const std::string& effect : diagnosis.effect_names)
    models.push_back(
        file_of(model_without(diagnosis.extended, diagnosis.fitted_covariance, effect), diagnosis.extended, after));

  const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(recording));
  const double align_s = NavigationRequest{}.align_s;
  std::vector<Branch> branches;
  std::vector<NavigatedFile> files;
  for (const ParameterFile& model : models) {
    SampleCalibration calibration = TRY(SampleCalibration::make(model, recording, *source, &blocks));
    const std::vector<MotionInterval> intervals = intervals_of(blocks, calibration);
    Elapsed all;
    for (const MotionInterval& interval : intervals) all.add(interval.duration_s);
    const double free_s = std::min(default_free_s, all.now_s() - align_s);
    if (files.empty() && free_s > 0.0)
      branches = branches_of(intervals, align_s + free_s, default_branches, {align_s, align_min_rest_s});
    if (branches.empty())
      return input_error(recording + ": expected more than " + seconds(align_s) +
                         " without lost samples, at rest first");
    files.push_back(TRY(navigate_file(model, recording, intervals, blocks.info, align_s, branches, 0.0, "", nullptr)));
  }
  const NavigatedFile& with_all = files[0];
  NavigationWorth worth;
  worth.branches = with_all.branches.size();
  worth.free_s = with_all.branches.front().navigation.free_s;
  worth.before = files[1].drift.rms_nm_per_h;
  worth.after = with_all.drift.rms_nm_per_h;
  worth.noise = with_all.expected ? with_all.expected->rms_nm_per_h : 0.0;
  for (std::size_t k = 0; k < diagnosis.effect_names.size(); ++k)
    worth.effects.emplace_back(diagnosis.effect_names[k], rate_between(with_all, files[k + 2]));
  return worth;
}

}  // namespace turncal
