#include "calib/diagnosis/holdout.h"

#include <algorithm>
#include <cmath>

#include "calib/joint/joint_faults.h"

namespace turncal {
namespace {

constexpr int fold_count = 4;

// The plain velocity error is taken where it speaks of the model and not yet of the angle random walk, which turns into
// metres a second after minutes: in the first seconds of each dwell.
constexpr int velocity_seconds = 20;

struct Sums {
  HoldoutError error;
  double velocity_square = 0.0;
  double velocity_count = 0.0;
};
void add(const CompressedRecording& recording, const std::vector<Innovation>& innovations, Sums& sums) {
  int second = 0;
  std::size_t previous = 0;
  for (const Innovation& i : innovations) {
    sums.error.chi_square += i.normalised.squaredNorm();
    sums.error.normalised.push_back(i.normalised);
    sums.error.observations += 3;
    second = i.block > 0 && previous + 1 == i.block && recording.blocks[i.block - 1].whole_second ? second + 1 : 0;
    previous = i.block;
    if (second < velocity_seconds) {
      sums.velocity_square += i.free_velocity_mps.squaredNorm();
      sums.velocity_count += 1.0;
    }
  }
}

// Parameters and effects of `result` with the recording's own biases, and its own values of what goes with the time of one run.
void take_own_biases(const CompressedRecording& recording, const JointResult& result, FilterSetup setup,
                     ParameterVector& parameters, EffectModel& model) {
  setup.with_columns = true;
  setup.keep_innovations = false;
  std::vector<int> own = {0, 1, 2, 3, 4, 5};
  for (std::size_t k = 0; k < result.effects.size(); ++k)
    if (result.effects[k].column.entry->of_one_run) own.push_back(parameter_count + static_cast<int>(k));
  for (int iteration = 0; iteration < 3; ++iteration) {
    const FilterResult pass = run_filter(recording, from_vector(parameters), model, setup);
    const SubsetSolution solution = solve_subset(pass.information, pass.gradient, own, result.ranges);
    double fall = 0.0;
    for (std::size_t i = 0; i < own.size(); ++i) {
      const Eigen::Index k = static_cast<Eigen::Index>(i);
      (own[i] < parameter_count ? parameters[own[i]] : model.values[own[i] - parameter_count]) += solution.step[k];
      fall -= solution.step[k] * pass.gradient[own[i]];
    }
    if (fall < 1000.0) break;  // of chi2: near enough that the problem was linear
  }
}

}  // namespace

HoldoutGain& HoldoutGain::operator+=(const HoldoutGain& other) {
  gain += other.gain;
  expected += other.expected;
  standard_error = std::hypot(standard_error, other.standard_error);
  return *this;
}

HoldoutGain holdout_gain(const HoldoutError& without, const HoldoutError& with) {
  HoldoutGain result;
  result.gain = without.chi_square - with.chi_square;
  for (std::size_t k = 0; k < std::min(without.normalised.size(), with.normalised.size()); ++k)
    result.expected += (without.normalised[k] - with.normalised[k]).squaredNorm();
  result.standard_error = 2.0 * std::sqrt(result.expected);
  return result;
}

EffectModel effect_model_of(const JointResult& result, double latitude_deg) {
  std::vector<EffectColumn> columns;
  for (const EstimatedEffect& e : result.effects) columns.push_back(e.column);
  EffectModel model = make_effect_model(columns, {latitude_deg}, result.reference_temperature_c);
  for (std::size_t k = 0; k < result.effects.size(); ++k)
    model.values[static_cast<Eigen::Index>(k)] = result.effects[k].value;
  return model;
}

FilterSetup holdout_setup(const CompressedRecording& holdout, const JointResult& result, const NoiseModel& noise) {
  FilterSetup setup;
  setup.noise = noise;
  faults_from_events(holdout, setup.breaks);
  const JointStart start = joint_start(holdout, result.parameters);
  setup.headings_rad = {start.heading_rad};
  setup.mounting = start.mounting;
  // Attitude is linear in the heading to its square: an angular minute of the first look would already show at the turns.
  setup.with_columns = false;
  const EffectModel model = effect_model_of(result, holdout.info.latitude_deg);
  for (int iteration = 0; iteration < 2; ++iteration) {
    const FilterResult pass = run_filter(holdout, result.parameters, model, setup);
    setup.headings_rad.resize(std::max(setup.headings_rad.size(), pass.heading_error_rad.size()), start.heading_rad);
    for (std::size_t k = 0; k < pass.heading_error_rad.size(); ++k) setup.headings_rad[k] += pass.heading_error_rad[k];
  }
  return setup;
}

HoldoutGate::HoldoutGate(const CompressedRecording& recording, const CompressedRecording* holdout, Refit refit)
    : recording_(recording), holdout_(holdout), refit_(std::move(refit)) {
  if (holdout_) return;
  folds_.assign(fold_count, std::vector<char>(recording.blocks.size(), 0));
  for (std::size_t b = 0; b < recording.blocks.size(); ++b) {
    const int segment = recording.blocks[b].segment;
    // Alignments stay: they carry the chain. Every fourth dwell is left out of one fold.
    if (recording.segments[segment].kind != SegmentKind::still) continue;
    int dwell = 0;
    for (int k = 0; k < segment; ++k) dwell += recording.segments[k].kind == SegmentKind::still;
    folds_[static_cast<std::size_t>(dwell % fold_count)][b] = 1;
  }
}

HoldoutError HoldoutGate::error(const JointResult& result, const NoiseModel& noise) const {
  Sums sums;
  FilterSetup setup = holdout_ ? holdout_setup(*holdout_, result, noise) : FilterSetup{};
  setup.noise = noise;
  setup.with_columns = false;
  setup.keep_innovations = true;
  if (holdout_) {
    EffectModel model = effect_model_of(result, holdout_->info.latitude_deg);
    ParameterVector parameters = to_vector(result.parameters);
    take_own_biases(*holdout_, result, setup, parameters, model);
    add(*holdout_, run_filter(*holdout_, from_vector(parameters), model, setup).innovations, sums);
  } else {
    setup.breaks = result.setup.breaks;
    setup.headings_rad = result.setup.headings_rad;
    setup.mounting = result.setup.mounting;
    std::vector<EffectColumn> columns;
    for (const EstimatedEffect& e : result.effects) columns.push_back(e.column);
    for (const std::vector<char>& fold : folds_) {
      const JointResult refitted = refit_(columns, result, fold);
      setup.unobserved = fold;
      const EffectModel model = effect_model_of(refitted, recording_.info.latitude_deg);
      add(recording_, run_filter(recording_, refitted.parameters, model, setup).left_out, sums);
    }
  }
  HoldoutError error = sums.error;
  error.normalised_rms =
      std::sqrt(error.chi_square / static_cast<double>(std::max<std::int64_t>(error.observations, 1)));
  error.velocity_rms_mps = std::sqrt(sums.velocity_square / std::max(sums.velocity_count, 1.0));
  return error;
}

}  // namespace turncal
