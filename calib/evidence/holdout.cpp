#include "calib/evidence/holdout.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "calib/joint/joint_estimate.h"
#include "calib/joint/noise_fit.h"
#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

constexpr int fold_count = 4;
constexpr double near_enough = 10.0;  // fall of chi2 below which the passes have converged

struct Sums {
  HoldoutError error;
  double velocity_square = 0.0;
  double velocity_count = 0.0;
};
// `says_nothing`: the model leaves parameters open there, so its innovations are not counted.
void add(const CompressedRecording& recording, const std::vector<Innovation>& innovations, bool says_nothing,
         Sums& sums) {
  std::vector<Eigen::Vector3d>& normalised = sums.error.normalised;
  if (says_nothing) return normalised.resize(normalised.size() + innovations.size(), Eigen::Vector3d::Constant(NAN));
  std::size_t second = 0, previous = 0;
  for (const Innovation& i : innovations) {
    sums.error.chi_square += i.normalised.squaredNorm();
    normalised.push_back(i.normalised);
    sums.error.observations += 3;
    second = i.block > 0 && previous + 1 == i.block && recording.blocks[i.block - 1].whole_second ? second + 1 : 0;
    previous = i.block;
    if (second < velocity_seconds) {
      sums.velocity_square += i.free_velocity_mps.squaredNorm();
      sums.velocity_count += 1.0;
    }
  }
}

// Returns the columns that a recording has for itself: its biases, and effects of one run.
std::vector<int> own_columns(const JointResult& result) {
  std::vector<int> own = {0, 1, 2, 3, 4, 5};
  for (std::size_t k = 0; k < result.effects.size(); ++k)
    if (result.effects[k].column.entry->of_one_run) own.push_back(parameter_count + int(k));
  return own;
}

// Returns how many directions may stay open in a fit of the other recordings: those of this one alone.
std::size_t open_without(int recording, const JointResult& result) {
  const auto own = std::ranges::count_if(result.effects, [&](const EstimatedEffect& e) {
    return !is_turn_on(e.column) && e.column.recording == recording;
  });
  return 6 + std::size_t(own);
}

}  // namespace

HoldoutGain holdout_gain(const HoldoutError& without, const HoldoutError& with) {
  HoldoutGain result;
  for (std::size_t k = 0; k < std::min(without.normalised.size(), with.normalised.size()); ++k) {
    const Eigen::Vector3d &one = without.normalised[k], &other = with.normalised[k];
    if (one.hasNaN() || other.hasNaN()) continue;
    result.gain += one.squaredNorm() - other.squaredNorm();
    result.expected += (one - other).squaredNorm();
  }
  result.standard_error = 2.0 * std::sqrt(result.expected);
  return result;
}

EffectModel effect_model_of(const JointResult& result, double latitude_deg, const std::vector<EffectColumn>& more) {
  std::vector<EffectColumn> columns;
  for (const EstimatedEffect& e : result.effects) columns.push_back(e.column);
  columns.insert(columns.end(), more.begin(), more.end());
  EffectModel model = make_effect_model(columns, {latitude_deg}, result.reference_temperature_c);
  for (std::size_t k = 0; k < result.effects.size(); ++k) model.values[Eigen::Index(k)] = result.effects[k].value;
  return model;
}

Eigen::Vector2d own_noise_of(const CompressedRecording& holdout, const JointResult& fit) {
  const NoiseModel of_fit = start_noise(holdout, fit.allan, fit.parameters);
  const NoiseModel own = start_noise(holdout, allan_deviation(holdout, fit.parameters), fit.parameters);
  const auto raised = [](double ratio) { return ratio > GateLimits{}.highest_error ? ratio : 1.0; };
  return {raised(own.angle_random_walk.x() / of_fit.angle_random_walk.x()),
          raised(own.velocity_random_walk.x() / of_fit.velocity_random_walk.x())};
}

JointResult model_on_holdout(const CompressedRecording& holdout, const JointResult& result, const NoiseModel& noise) {
  JointResult model = result;
  model.start = joint_start(holdout, result.parameters);
  model.setup = {};
  FilterSetup& setup = model.setup;
  setup.noise = noise;
  const Eigen::Vector2d raised = own_noise_of(holdout, result);
  setup.noise.angle_random_walk *= raised[0];
  setup.noise.velocity_random_walk *= raised[1];
  setup.mounting = model.start.mounting;
  setup.headings_rad = {model.start.heading_rad};
  faults_from_events(holdout, setup.breaks);
  const Eigen::Vector3d other = model.start.N0_degph - result.parameters.N0_degph;
  if (other.cwiseAbs().maxCoeff() > start_limits.large_bias_degph) model.parameters.N0_degph = model.start.N0_degph;
  const std::vector<int> own = own_columns(result);
  constexpr int most_passes = 8;
  std::vector<double> turned_last;
  for (int k = 0; k < most_passes; ++k) {
    setup.with_columns = true;
    const auto pass = run_filter(holdout, model.parameters, effect_model_of(model, holdout.info.latitude_deg), setup);
    const Eigen::VectorXd step = solve_subset(pass.information, pass.gradient, own, result.ranges).step;
    if (!step.allFinite()) break;
    ParameterVector values = to_vector(model.parameters);
    for (std::size_t i = 0; i < own.size(); ++i) {
      const double by = step[Eigen::Index(i)];
      if (own[i] < parameter_count)
        values[own[i]] += by;
      else
        model.effects[std::size_t(own[i] - parameter_count)].value += by;
    }
    model.parameters = from_vector(values);
    // Attitude is linear in the heading error up to its square: an arc minute of that from the first pass would already show at the turns.
    const double turned = correct_headings(pass, step, own, model.start, setup.headings_rad, turned_last);
    const double fall = -step.dot(pass.gradient(own));
    if (fall < near_enough && turned < 1.0) break;
  }
  setup.with_columns = false;
  return model;
}

double error_beyond_sigmas(const CompressedRecording& holdout, const JointResult& result, const NoiseModel& noise) {
  JointResult model = model_on_holdout(holdout, result, noise);
  model.setup.with_columns = true;
  const FilterResult pass =
      run_filter(holdout, model.parameters, effect_model_of(model, holdout.info.latitude_deg), model.setup);
  const std::vector<int> own = own_columns(result);
  std::vector<int> common, place;  // columns, and where they stand in the covariance
  for (std::size_t k = 0; k < result.free.size(); ++k)
    if (std::ranges::find(own, result.free[k]) == own.end()) {
      common.push_back(result.free[k]);
      place.push_back(int(k));
    }
  Eigen::MatrixXd A = pass.information;
  A(common, common) += balanced_inverse(result.covariance(place, place));
  const SubsetSolution given_way = solve_subset(A, pass.gradient, result.free, result.ranges);
  const double chi_square = pass.chi_square + given_way.step.dot(Eigen::VectorXd(pass.gradient(result.free)));
  return std::sqrt(chi_square / double(std::max<std::int64_t>(pass.observations, 1)));
}

HoldoutGate HoldoutGate::holdouts(const std::vector<const CompressedRecording*>& recordings) {
  HoldoutGate gate(recordings.size() == 1 ? "second recording"
                                          : std::to_string(recordings.size()) + " other recordings");
  for (const CompressedRecording* recording : recordings) gate.parts_.push_back({recording, {}});
  return gate;
}

HoldoutGate HoldoutGate::recordings_in_turn(const JoinedRecordings& recordings, Refit refit) {
  HoldoutGate gate("cross-validation over recordings", std::move(refit));
  std::vector<std::size_t> borders = recordings.begins;
  borders.insert(borders.begin(), 0);
  borders.push_back(recordings.data.blocks.size());
  for (std::size_t k = 0; k < recordings.parts.size(); ++k) {
    std::vector<char> left_out(recordings.data.blocks.size(), 0);
    std::fill(left_out.begin() + std::ptrdiff_t(borders[k]), left_out.begin() + std::ptrdiff_t(borders[k + 1]), 1);
    gate.parts_.push_back({recordings.parts[k], std::move(left_out), int(k)});
  }
  return gate;
}

HoldoutGate HoldoutGate::dwells_in_turn(const CompressedRecording& recording, Refit refit) {
  HoldoutGate gate("cross-validation over dwells", std::move(refit));
  gate.parts_.assign(fold_count, {&recording, std::vector<char>(recording.blocks.size(), 0)});
  for (std::size_t b = 0; b < recording.blocks.size(); ++b) {
    const int segment = recording.blocks[b].segment;
    // Alignments stay in, since they carry the chain. Each fold leaves out every fourth dwell.
    if (recording.segments[segment].kind != SegmentKind::still) continue;
    int dwell = 0;
    for (int k = 0; k < segment; ++k) dwell += recording.segments[k].kind == SegmentKind::still;
    gate.parts_[std::size_t(dwell % fold_count)].left_out[b] = 1;
  }
  return gate;
}

HoldoutError HoldoutGate::error(const JointResult& result, const NoiseModel& noise) const {
  Sums sums;
  for (const Part& part : parts_) {
    const CompressedRecording& recording = *part.recording;
    const bool in_the_fit = !part.left_out.empty() && part.number < 0;
    const std::optional<JointResult> again =
        part.left_out.empty() ? std::nullopt : std::optional(refit_(result, part.left_out));
    const JointResult& model_of = again ? *again : result;
    const bool says_nothing = part.number >= 0 && model_of.undetermined.size() > open_without(part.number, result);
    const JointResult model = in_the_fit ? model_of : model_on_holdout(recording, model_of, noise);
    FilterSetup setup = in_the_fit ? result.setup : model.setup;
    if (in_the_fit) setup.noise = noise, setup.unobserved = part.left_out;
    setup.with_columns = false;
    setup.keep_innovations = true;
    const FilterResult pass =
        run_filter(recording, model.parameters, effect_model_of(model, recording.info.latitude_deg), setup);
    add(recording, in_the_fit ? pass.left_out : pass.innovations, says_nothing, sums);
  }
  HoldoutError error = sums.error;
  error.normalised_rms = std::sqrt(error.chi_square / double(std::max<std::int64_t>(error.observations, 1)));
  error.velocity_rms_mps = std::sqrt(sums.velocity_square / std::max(sums.velocity_count, 1.0));
  return error;
}

}  // namespace turncal
