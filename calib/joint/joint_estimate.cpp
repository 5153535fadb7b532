#include "calib/joint/joint_estimate.h"

#include <algorithm>
#include <cmath>

#include "calib/joint/joined_recordings.h"
#include "calib/joint/joint_faults.h"
#include "calib/joint/joint_iterations.h"
#include "calib/joint/noise_fit.h"
#include "calib/model/limits.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/table_turns.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {

namespace {

// What a unit can be off goes with its noise, not with how long it was recorded: the ranges are those of this time at rest.
constexpr double fourteen_steps_s = 5400.0;
// A step of so many sigma is taken from the last pass, and its effect on that pass is linear.
constexpr double last_step_sigma = 1.0;

Eigen::VectorXd all_ranges(const ParameterVector& base, const std::vector<EffectColumn>& effects) {
  Eigen::VectorXd ranges(parameter_count + static_cast<Eigen::Index>(effects.size()));
  ranges.head<parameter_count>() = base;
  for (std::size_t k = 0; k < effects.size(); ++k)
    ranges[parameter_count + static_cast<Eigen::Index>(k)] = absurd_magnitude(*effects[k].entry);
  return ranges;
}

}  // namespace

// Biases of several recordings: what the rests of each say, where they are far apart.
void JointRun::start_of_each() {
  std::vector<std::size_t> ends(options_.begins.begin(), options_.begins.end());
  ends.push_back(recording_.blocks.size());
  CompressedRecording part = recording_;
  std::size_t begin = 0;
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < ends.size(); begin = ends[k++]) {
    part.blocks.assign(recording_.blocks.begin() + static_cast<std::ptrdiff_t>(begin),
                       recording_.blocks.begin() + static_cast<std::ptrdiff_t>(ends[k]));
    const JointStart start = joint_start(part, result_.parameters);
    if (!start.error.empty()) return;
    if (k == 0) first = start.N0_degph;
    const Eigen::Vector3d beside = start.N0_degph - first;
    if (beside.cwiseAbs().maxCoeff() <= start_limits.large_bias_degph) continue;
    result_.parameters.N0_degph = first;
    for (int column = 0; column < effects_.columns; ++column) {
      const EffectColumn& turn_on = options_.effects[static_cast<std::size_t>(column)];
      if (is_gyro_turn_on(turn_on) && turn_on.recording == static_cast<int>(k))
        effects_.values[column] = beside[turn_on.component];
    }
  }
}

JointResult JointRun::run() {
  JointResult& r = result_;
  r.parameters = options_.start.value_or(start_parameters(recording_.info));
  if (recording_.blocks.empty()) {
    r.message = "the recording holds no samples";
    return r;
  }
  r.allan = options_.faults_of ? options_.faults_of->allan : allan_deviation(recording_, r.parameters);
  if (options_.faults_of) {
    r.start = options_.faults_of->start;
    r.setup.headings_rad = options_.faults_of->setup.headings_rad;
  } else {
    r.start = joint_start(recording_, r.parameters);
    r.setup.headings_rad = {r.start.heading_rad};
    // What the first pass could not linearise: a bias that turns the unit by radians in the run.
    if (!options_.start && r.start.N0_degph.cwiseAbs().maxCoeff() > start_limits.large_bias_degph)
      r.parameters.N0_degph = r.start.N0_degph;
    if (!options_.start && !options_.begins.empty()) start_of_each();
  }
  // A counter of another weight than the nominal one: the table's turns say which.
  if (!options_.start && !options_.faults_of && recording_.info.gyro_increment == IncrementKind::pulses)
    if (const double felt = felt_of_commanded(recording_);
        std::abs(felt - 1.0) > slip_nearness && clipped_turns(recording_).empty())
      r.parameters.n /= felt;
  r.setup.mounting = r.start.mounting;
  if (!r.start.error.empty()) {
    r.message = r.start.error;
    return r;
  }
  start_.resize(static_cast<Eigen::Index>(subset_.size()));
  ParameterVector begin = to_vector(r.parameters);
  for (std::size_t i = 0; i < subset_.size(); ++i) start_[static_cast<Eigen::Index>(i)] = value_of(subset_[i], begin);
  r.setup.unobserved = options_.unobserved;
  r.reference_temperature_c = reference_temperature_c_;
  if (options_.noise)
    r.setup.noise = *options_.noise;
  else if (options_.start_noise)
    r.setup.noise = *options_.start_noise;
  else
    r.setup.noise = start_noise(recording_, r.allan, r.parameters);
  if (options_.faults_of)
    ranges_ = options_.faults_of->ranges.head<parameter_count>();
  else
    ranges_ = plausible_ranges(r.setup.noise, fourteen_steps_s);
  ranges_ = r.ranges = all_ranges(ranges_, options_.effects);
  if (options_.faults_of) {
    r.faults = options_.faults_of->faults;
    r.setup.breaks = options_.faults_of->setup.breaks;
  } else {
    r.faults = faults_from_events(recording_, r.setup.breaks);
    for (const Break& cut : options_.breaks) add_break(r.setup.breaks, cut);
    for (const std::size_t block : options_.begins)
      add_break(r.setup.breaks, {.block = block, .begins_recording = true});
  }

  if (options_.faults_of) {
    iterate(0.3, 1, close_by);  // beside a finished fit one step is most of the way
  } else {
    const bool settled = settle();
    // What reads other axes than the record says may settle as well.
    const Parameters from = from_vector(begin);
    const bool upright = (r.parameters.a * from.a.inverse()).diagonal().minCoeff() > 0.0;
    const std::string wrong = settled && upright ? wrong_axes(r.parameters.n * from.n.inverse())
                                                 : wrong_table_axes(recording_, r.setup.mounting);
    if (!settled || !upright || !wrong.empty()) {
      r.message = (settled ? "" : "the estimate does not settle: ") +
                  (wrong.empty() ? "the recording contradicts the model (wrong segments, signs or units?)" : wrong);
      return r;
    }
  }
  if (options_.one_step) {
    r.converged = true;
    r.message = "one step";
    r.undetermined.resize(static_cast<std::size_t>(solution_.undetermined.cols()));
    r.noise = r.setup.noise;
    for (int k = 0; k < effects_.columns; ++k)
      r.effects.push_back({options_.effects[static_cast<std::size_t>(k)], effects_.values[k], 0.0});
    return r;
  }
  if (options_.look_for_faults && !options_.faults_of) look_for_faults();
  if (!options_.noise) {
    NoiseFitOptions fit_options;
    fit_options.bias_instability = options_.fit_bias_instability;
    fit_options.near_start = options_.faults_of != nullptr;  // a trial beside a finished fit
    FilterSetup setup = r.setup;
    const CompressedRecording fewer =
        coarser(recording_, fit_options.near_start ? for_noise_of_trials : for_noise, setup);
    r.noise_fit = fit_noise(fewer, r.parameters, effects_, setup, subset_, ranges_, fit_options);
    r.setup.noise = r.noise_fit->noise;
  }
  const bool ended = is_open() ? iterate(0.3, options_.max_iterations, {1.0, 0.0})
                               : options_.candidates.empty() || iterate(0.3, 5, close_by);  // their passes are dear
  r.converged = last_passes() && (ended || !is_open());
  r.message = r.converged ? "converged" : "the last iterations still moved the parameters";
  report();
  return r;
}

// One at a time, the worst first: a fault that is not cut out spoils the seconds around it.
void JointRun::look_for_faults() {
  for (int round = 0; round < 12; ++round) {
    FilterSetup setup = result_.setup;
    setup.with_columns = false;
    setup.keep_innovations = true;
    const FilterResult pass = run_filter(recording_, result_.parameters, effects_, setup);
    if (!cut_worst_fault(recording_, pass.innovations, result_.faults, result_.setup.breaks)) return;
    iterate(0.3, 4, close_by);
  }
}

// Every second, and the candidates.
bool JointRun::last_passes() {
  JointResult& r = result_;
  std::vector<EffectColumn> columns = options_.effects;
  columns.insert(columns.end(), options_.candidates.begin(), options_.candidates.end());
  EffectModel with_candidates = make_effect_model(columns, {recording_.info.latitude_deg}, reference_temperature_c_);
  FilterSetup setup = r.setup;
  setup.keep_innovations = true;
  // A trial beside a finished fit takes it over: it is a part of a sigma, and hardly another one.
  const bool known = options_.faults_of && options_.faults_of->noise_pull.size() == parameter_count;
  r.noise_pull = known ? options_.faults_of->noise_pull
                       : pull_of_noise(recording_, r.parameters, effects_, r.setup, subset_, solution_.covariance);
  for (int k = 0; k < 5; ++k) {
    with_candidates.values.head(effects_.columns) = effects_.values;
    setup.headings_rad = r.setup.headings_rad;
    r.last = run_filter(recording_, r.parameters, with_candidates, setup);
    r.last.gradient.head<parameter_count>() -= r.noise_pull;
    if (is_open()) {  // where it ended it stays
      solution_ = solve_subset(r.last.information, r.last.gradient, subset_, ranges_);
      return true;
    }
    const double largest = improve(r.last);
    if (std::isnan(largest)) return false;
    if (largest > last_step_sigma) continue;
    Eigen::VectorXd step = Eigen::VectorXd::Zero(r.last.gradient.size());
    step(subset_) = step_;
    const Eigen::VectorXd change = r.last.information * step;
    r.last.chi_square += step.dot(2.0 * r.last.gradient + change);
    r.last.gradient += change;
    return true;
  }
  return false;
}

// A trial beside a finished fit takes its widening over. None where directions are open: along those it is that of the ranges.
void JointRun::widen() {
  JointResult& r = result_;
  r.unseen_instability = Eigen::MatrixXd::Zero(r.covariance.rows(), r.covariance.cols());
  if (is_open() || !r.noise_fit) return;
  if (!options_.faults_of) {
    r.unseen_instability = r.noise_fit->unseen_instability;
  } else if (!r.noise.has_bias_instability()) {
    const Eigen::MatrixXd& from = options_.faults_of->unseen_instability;
    const auto turn_ons = 6 * static_cast<int>(options_.begins.size());
    const auto base =
        std::count_if(subset_.begin(), subset_.end(), [&](int k) { return k < parameter_count + turn_ons; });
    const Eigen::Index both = std::min<Eigen::Index>(from.rows(), base);
    r.unseen_instability.topLeftCorner(both, both) = from.topLeftCorner(both, both);
  }
  r.covariance += r.unseen_instability;
}

void JointRun::report() {
  JointResult& r = result_;
  r.free = subset_;
  r.covariance = solution_.covariance;
  widen();
  r.noise = r.setup.noise;
  r.normalised_rms = std::sqrt(r.last.chi_square / static_cast<double>(std::max<std::int64_t>(r.last.observations, 1)));
  r.whiteness = test_whiteness(r.last.innovations);

  for (Eigen::Index d = 0; d < solution_.undetermined.cols(); ++d) {
    const Eigen::VectorXd direction = solution_.undetermined.col(d);
    Undetermined u;
    for (std::size_t i = 0; i < subset_.size(); ++i) {
      const double weight = direction[static_cast<Eigen::Index>(i)];
      if (std::abs(weight) < determined_limits.smallest_part) continue;
      const std::string key = subset_[i] < parameter_count
                                  ? std::string(parameter_keys[static_cast<std::size_t>(subset_[i])])
                                  : options_.effects[static_cast<std::size_t>(subset_[i] - parameter_count)].key();
      u.combination.emplace_back(key, weight);
    }
    std::sort(u.combination.begin(), u.combination.end(),
              [](const auto& a, const auto& b) { return std::abs(a.second) > std::abs(b.second); });
    r.undetermined.push_back(std::move(u));
  }
  for (std::size_t i = 0; i < subset_.size(); ++i) {
    const double sigma = std::sqrt(r.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)));
    if (subset_[i] < parameter_count) {
      r.determined[static_cast<std::size_t>(subset_[i])] = !solution_.lost[i];
      r.sigma[subset_[i]] = solution_.lost[i] ? 0.0 : sigma;
    } else {
      const int k = subset_[i] - parameter_count;
      r.effects.push_back({options_.effects[static_cast<std::size_t>(k)], effects_.values[k], sigma});
    }
  }
}

JointResult joint_estimate(const CompressedRecording& recording, const JointOptions& options) {
  return JointRun(recording, options).run();
}

Whiteness test_whiteness(const std::vector<Innovation>& innovations) {
  constexpr int lags = 5;
  Whiteness w;
  w.autocorrelation = Eigen::VectorXd::Zero(lags);
  const NoiseLimits& limits = noise_limits;
  if (innovations.size() < static_cast<std::size_t>(limits.fewest_seconds)) {
    w.message = "too few static seconds to judge";
    return w;
  }
  const auto value = [&](std::size_t i) -> Eigen::Vector3d {
    return innovations[i].normalised.cwiseMax(-limits.outlier).cwiseMin(limits.outlier);
  };
  double square = 0.0;
  double raw = 0.0;
  for (std::size_t i = 0; i < innovations.size(); ++i) {
    square += value(i).squaredNorm();
    raw += innovations[i].normalised.squaredNorm();
    for (int lag = 1; lag <= lags && static_cast<std::size_t>(lag) <= i; ++lag)
      if (innovations[i].block - innovations[i - static_cast<std::size_t>(lag)].block == static_cast<std::size_t>(lag))
        w.autocorrelation[lag - 1] += value(i).dot(value(i - static_cast<std::size_t>(lag)));
  }
  w.autocorrelation /= square;
  w.level = raw / (3.0 * static_cast<double>(innovations.size()));
  const double worst = w.autocorrelation.cwiseAbs().maxCoeff();
  const double values = 3.0 * static_cast<double>(innovations.size());
  const double limit = std::max(limits.white_correlation, limits.of_chance / std::sqrt(values));
  const double level_spread = limits.of_chance * std::sqrt(2.0 / values);
  w.white = worst < limit && w.level > std::min(limits.white_lowest, 1.0 - level_spread) &&
            w.level < std::max(limits.white_highest, 1.0 + level_spread);
  w.message = w.white          ? "innovations are white at the noise model"
              : worst >= limit ? "innovations are correlated in time: the noise model does not fit"
                               : "innovations are larger or smaller than the noise model says";
  return w;
}

}  // namespace turncal
