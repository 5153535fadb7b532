#include "calib/joint/joint_estimate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "calib/joint/linear_motion.h"
#include "calib/joint/several_recordings.h"
#include "calib/model/limits.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/numerics.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
namespace {

// The errors of a unit scale with its noise, not with the length of its recording: the ranges are those of this time at rest.
constexpr double fourteen_steps_s = 5400.0;
// A step of up to so many sigma is taken from the last pass, which is linear over it.
constexpr double last_step_sigma = 1.0;

Eigen::VectorXd all_ranges(const ParameterVector& base, const std::vector<EffectColumn>& effects) {
  Eigen::VectorXd ranges(parameter_count + effects.size());
  ranges.head<parameter_count>() = base;
  for (std::size_t k = 0; k < effects.size(); ++k) ranges[parameter_count + k] = absurd_magnitude(*effects[k].entry);
  return ranges;
}

// Far from the solution some sigma are near enough. Near it, single seconds in the middle of a dwell add little: the
// sigmas are 0.1 to 0.5 % larger than from every second.
constexpr Coarseness far_off = {20.0, 0.05};
constexpr Coarseness close_by = {8.0, 0.025};
constexpr Coarseness for_noise = {8.0, 0.0};
constexpr Coarseness for_noise_of_trials = {20.0, 0.0};

double chi_square_an_observation(const FilterResult& pass) {
  return pass.chi_square / double(std::max<std::int64_t>(pass.observations, 1));
}

class JointRun {
 public:
  JointRun(const CompressedRecording& recording, const JointOptions& options)
      : recording_(recording),
        options_(options),
        reference_temperature_c_(options.reference_temperature_c.value_or(
            std::isnan(recording.mean_temperature_c) ? 0.0 : recording.mean_temperature_c)) {
    effects_ = make_effect_model(options.effects, {recording.info.latitude_deg}, reference_temperature_c_);
    subset_ = options.free_parameters.value_or(free_parameters());
    if (options.start_effects.size() == effects_.columns) effects_.values = options.start_effects;
    for (int k = 0; k < effects_.columns; ++k) subset_.push_back(parameter_count + k);
  }

  JointResult run() {
    JointResult& r = result_;
    r.parameters = options_.start.value_or(start_parameters(recording_.info));
    if (recording_.blocks.empty()) {
      r.message = "the recording holds no samples";
      return r;
    }
    const JointResult* const beside = options_.faults_of;
    if (beside) {
      r.allan = beside->allan;
      r.start = beside->start;
      r.setup.headings_rad = beside->setup.headings_rad;
    } else {
      r.allan = allan_deviation(recording_, r.parameters);
      r.start = joint_start(recording_, r.parameters);
      r.setup.headings_rad = {r.start.heading_rad};
      // A bias that turns the unit by radians in the run is beyond the linearisation of the first pass.
      if (!options_.start && r.start.N0_degph.cwiseAbs().maxCoeff() > start_limits.large_bias_degph)
        r.parameters.N0_degph = r.start.N0_degph;
      if (!options_.start && !options_.begins.empty()) start_of_each();
    }
    // A pulse weight other than the nominal one shows in the table's turns.
    if (!options_.start && !beside && recording_.info.gyro_increment == IncrementKind::pulses)
      if (const double felt = felt_of_commanded(recording_);
          std::abs(felt - 1.0) > slip_nearness && clipped_turns(recording_).empty())
        r.parameters.n /= felt;
    r.setup.mounting = r.start.mounting;
    if (!r.start.error.empty()) {
      r.message = r.start.error;
      return r;
    }
    start_.resize(subset_.size());
    ParameterVector begin = to_vector(r.parameters);
    for (std::size_t i = 0; i < subset_.size(); ++i) start_[i] = value_of(subset_[i], begin);
    r.setup.unobserved = options_.unobserved;
    r.reference_temperature_c = reference_temperature_c_;
    if (const std::optional<NoiseModel>& known = options_.noise ? options_.noise : options_.start_noise)
      r.setup.noise = *known;
    else
      r.setup.noise = start_noise(recording_, r.allan, r.parameters);
    if (beside) {
      ranges_ = beside->ranges.head<parameter_count>();
      r.faults = beside->faults;
      r.setup.breaks = beside->setup.breaks;
    } else {
      ranges_ = plausible_ranges(r.setup.noise, fourteen_steps_s);
      r.faults = faults_from_events(recording_, r.setup.breaks);
      for (const Break& cut : options_.breaks) add_break(r.setup.breaks, cut);
      for (const std::size_t block : options_.begins)
        add_break(r.setup.breaks, {.block = block, .begins_recording = true});
    }
    ranges_ = r.ranges = all_ranges(ranges_, options_.effects);

    if (beside) {
      iterate(0.3, options_.one_step ? 1 : options_.max_iterations, options_.one_step ? close_by : for_noise_of_trials);
    } else {
      const bool settled = settle();
      // A unit that reads other axes than the record says may settle as well.
      const Parameters from = from_vector(begin);
      const bool upright = (r.parameters.a * from.a.inverse()).diagonal().minCoeff() > 0.0;
      const std::string wrong = settled && upright ? wrong_axes(r.parameters.n * from.n.inverse())
                                                   : wrong_table_axes(recording_, r.setup.mounting);
      if (!settled || !upright || !wrong.empty()) {
        r.message = (settled ? "" : "the estimate does not converge: ") +
                    (wrong.empty() ? "the recording contradicts the model (wrong segments, signs or units?)" : wrong);
        return r;
      }
    }
    if (options_.one_step) {
      r.converged = true;
      r.message = "one step";
      r.undetermined.resize(solution_.undetermined.cols());
      r.noise = r.setup.noise;
      for (int k = 0; k < effects_.columns; ++k) r.effects.push_back({options_.effects[k], effects_.values[k], 0.0});
      return r;
    }
    if (options_.look_for_faults && !beside) look_for_faults();
    if (!options_.noise) measure_noise();
    const bool ended = is_open() ? iterate(0.3, options_.max_iterations, {1.0, 0.0})
                                 : options_.candidates.empty() || iterate(0.3, 5, close_by);  // their passes are costly
    r.converged = last_passes() && (ended || !is_open());
    r.message = r.converged ? "converged" : "the last iterations still moved the parameters";
    report();
    return r;
  }

 private:
  // The signal of an effect was noise in the fit without it: if it was much of the noise, noise and parameters are fitted again.
  void measure_noise() {
    JointResult& r = result_;
    const bool beside = options_.faults_of != nullptr;
    const NoiseFitOptions fit_options{options_.fit_bias_instability, beside};
    for (int round = 0; round < 3; ++round) {
      FilterSetup setup = r.setup;
      const CompressedRecording fewer = coarser(recording_, beside ? for_noise_of_trials : for_noise, setup);
      r.noise_fit = fit_noise(fewer, r.parameters, effects_, setup, subset_, ranges_, fit_options);
      r.setup.noise = r.noise_fit->noise;
      if (!beside || r.noise_fit->converged || !iterate(0.3, options_.max_iterations, for_noise_of_trials)) return;
    }
  }

  // Starts the biases of several recordings from the rests of each, if they are far apart.
  void start_of_each() {
    std::vector<std::size_t> ends(options_.begins.begin(), options_.begins.end());
    ends.push_back(recording_.blocks.size());
    CompressedRecording part = recording_;
    std::size_t begin = 0;
    Eigen::Vector3d first = Eigen::Vector3d::Zero();
    for (std::size_t k = 0; k < ends.size(); begin = ends[k++]) {
      part.blocks.assign(recording_.blocks.begin() + std::ptrdiff_t(begin),
                         recording_.blocks.begin() + std::ptrdiff_t(ends[k]));
      const JointStart start = joint_start(part, result_.parameters);
      if (!start.error.empty()) return;
      if (k == 0) first = start.N0_degph;
      const Eigen::Vector3d beside = start.N0_degph - first;
      if (beside.cwiseAbs().maxCoeff() <= start_limits.large_bias_degph) continue;
      result_.parameters.N0_degph = first;
      for (int column = 0; column < effects_.columns; ++column) {
        const EffectColumn& turn_on = options_.effects[column];
        if (is_gyro_turn_on(turn_on) && turn_on.recording == int(k))
          effects_.values[column] = beside[turn_on.component];
      }
    }
  }

  // Gauss-Newton at the noise measured before the fit. Dwells of a few seconds hardly show that noise, and the start can miss a
  // narrow optimum: then wider noise is tried. What that finds is kept if it fits and, where both can be compared, fits better.
  bool settle() {
    const Place start = place();
    const NoiseModel noise = result_.setup.noise;
    const bool settled = settle_from_here();
    if (settled && misfit_ < start_limits.misfit) return true;
    const Place first = place();
    const double first_misfit = settled ? misfit_ : std::numeric_limits<double>::infinity();
    const auto settles_with = [&](const NoiseModel& with) {
      result_.setup.noise = with;
      return settle_from_here();
    };
    for (const double louder : {5.0, 25.0}) {
      go_to(start);
      NoiseModel wide = noise;
      wide.angle_random_walk *= louder;
      wide.velocity_random_walk *= louder;
      const bool near = settles_with(wide) && misfit_ < start_limits.misfit;
      const Place found = place();
      const bool stands = near && settles_with(noise);
      if (stands && misfit_ < 0.5 * first_misfit) return true;
      result_.setup.noise = noise;
      if (!near || stands || settled || options_.noise) continue;
      // Even from there the optimum is too narrow: the noise is fitted from the wider one.
      result_.setup.noise = wide;
      go_to(found);
      return true;
    }
    go_to(first);
    return settled;
  }

  bool settle_from_here() {
    const Place start = place();
    if (!options_.start && !iterate(1.0, 6, far_off)) go_to(start);
    return iterate(0.3, options_.max_iterations, close_by);
  }

  // The point that the iteration has reached: parameters and the values of the effects.
  using Place = std::pair<Parameters, Eigen::VectorXd>;
  Place place() const { return {result_.parameters, effects_.values}; }
  void go_to(const Place& there) { std::tie(result_.parameters, effects_.values) = there; }

  // Gauss-Newton until the largest step is below `tolerance` sigma. Along open directions a step as large as their
  // ranges is far from linear, and its sigma is no guide: a step that raises chi-square is shortened, and the iteration
  // ends when it gains nothing more.
  bool iterate(double tolerance, int max_iterations, const Coarseness& coarseness) {
    constexpr double part = 0.3;
    constexpr double nothing_gained = 0.1;  // of chi-square
    FilterSetup setup = result_.setup;
    const CompressedRecording fewer = coarser(recording_, coarseness, setup);
    const auto pass_here = [&] {
      setup.headings_rad = result_.setup.headings_rad;
      return run_filter(fewer, result_.parameters, effects_, setup);
    };
    bool open = false;
    double before = std::numeric_limits<double>::infinity();
    for (int k = 0; k < max_iterations; ++k) {
      FilterResult pass = pass_here();
      double from_start = out_of_range();
      for (int less = 0; less < 8 && open && pass.chi_square + looseness_ * from_start > before; ++less) {
        move(-(1.0 - part) * step_);
        step_ *= part;
        pass = pass_here();
        from_start = out_of_range();
      }
      if (open && before - (pass.chi_square + looseness_ * from_start) < nothing_gained * looseness_) return true;
      const double largest = improve(pass);
      if (std::isnan(largest)) return false;
      open = is_open();
      if (!open && largest < tolerance) return true;
      before = pass.chi_square + looseness_ * from_start;
    }
    return false;
  }

  // Takes the step that a pass suggests. Returns the largest one in sigma; NaN if there is none.
  double improve(const FilterResult& pass) {
    ++result_.iterations;
    solution_ = solve_subset(pass.information, pass.gradient, subset_, ranges_);
    misfit_ = chi_square_an_observation(pass);
    looseness_ = std::max(misfit_, 1.0);
    if (!solution_.step.allFinite()) return std::numeric_limits<double>::quiet_NaN();
    step_ = solution_.step;
    Eigen::VectorXd sigma = solution_.covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
    if (is_open()) step_within_ranges(pass, step_, sigma);
    move(step_);
    const double largest = step_.size() > 0 ? step_.cwiseQuotient(sigma).cwiseAbs().maxCoeff() : 0.0;
    return std::max(largest,
                    correct_headings(pass, step_, subset_, result_.start, result_.setup.headings_rad, last_headings_));
  }

  void move(const Eigen::VectorXd& step) {
    ParameterVector values = to_vector(result_.parameters);
    for (std::size_t i = 0; i < subset_.size(); ++i) value_of(subset_[i], values) += step[i];
    result_.parameters = from_vector(values);
  }

  // Returns the squared distance of the parameters from their start, in ranges.
  double out_of_range() {
    ParameterVector values = to_vector(result_.parameters);
    double sum = 0.0;
    for (std::size_t i = 0; i < subset_.size(); ++i)
      sum += std::pow((value_of(subset_[i], values) - start_[i]) / ranges_[subset_[i]], 2);
    return sum;
  }

  double& value_of(int column, ParameterVector& parameters) {
    return column < parameter_count ? parameters[column] : effects_.values[column - parameter_count];
  }

  // Gauss-Newton in the determined directions alone would creep, since these turn with every linearisation. So if some
  // are open, the plausible ranges about the start count as observations, too weak to move what is determined.
  void step_within_ranges(const FilterResult& pass, Eigen::VectorXd& step, Eigen::VectorXd& sigma) {
    const Eigen::VectorXd weight = looseness_ * Eigen::VectorXd(ranges_(subset_)).cwiseAbs2().cwiseInverse();
    ParameterVector values = to_vector(result_.parameters);
    Eigen::VectorXd gradient = pass.gradient(subset_);
    for (std::size_t i = 0; i < subset_.size(); ++i)
      gradient[i] += weight[i] * (value_of(subset_[i], values) - start_[i]);
    Eigen::MatrixXd information = pass.information(subset_, subset_);
    information.diagonal() += weight;
    const Eigen::MatrixXd covariance = balanced_inverse(information);
    step = -covariance * gradient;
    sigma = covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
  }

  // Cuts faults one at a time, the worst first: a fault that is not cut spoils the seconds around it.
  void look_for_faults() {
    for (int round = 0; round < 12; ++round) {
      FilterSetup setup = result_.setup;
      setup.with_columns = false;
      setup.keep_innovations = true;
      const FilterResult pass = run_filter(recording_, result_.parameters, effects_, setup);
      if (!cut_worst_fault(recording_, pass.innovations, result_.faults, result_.setup.breaks)) return;
      iterate(0.3, 4, close_by);
    }
  }

  bool is_open() const { return solution_.undetermined.cols() > 0; }

  // Passes over every second, with the candidates.
  bool last_passes() {
    JointResult& r = result_;
    std::vector<EffectColumn> columns = options_.effects;
    columns.insert(columns.end(), options_.candidates.begin(), options_.candidates.end());
    EffectModel with_candidates = make_effect_model(columns, {recording_.info.latitude_deg}, reference_temperature_c_);
    FilterSetup setup = r.setup;
    setup.keep_innovations = true;
    // A trial beside a finished fit reuses its pull, which is a part of a sigma and hardly changes.
    const bool known = options_.faults_of && options_.faults_of->noise_pull.size() == parameter_count;
    r.noise_pull = known ? options_.faults_of->noise_pull
                         : pull_of_noise(recording_, r.parameters, effects_, r.setup, subset_, solution_.covariance);
    for (int k = 0; k < 5; ++k) {
      with_candidates.values.head(effects_.columns) = effects_.values;
      setup.headings_rad = r.setup.headings_rad;
      r.last = run_filter(recording_, r.parameters, with_candidates, setup);
      r.last.gradient.head<parameter_count>() -= r.noise_pull;
      if (is_open()) {  // open directions: no more steps
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

  // Adds the unseen instability to the covariance; a trial beside a finished fit reuses that of the fit. None while
  // directions are open.
  void widen() {
    JointResult& r = result_;
    r.unseen_instability = Eigen::MatrixXd::Zero(r.covariance.rows(), r.covariance.cols());
    if (is_open() || !r.noise_fit) return;
    if (!options_.faults_of) {
      r.unseen_instability = r.noise_fit->unseen_instability;
    } else if (!r.noise.has_bias_instability()) {
      const Eigen::MatrixXd& from = options_.faults_of->unseen_instability;
      const auto turn_ons = 6 * int(options_.begins.size());
      const auto base = std::ranges::count_if(subset_, [&](int k) { return k < parameter_count + turn_ons; });
      const Eigen::Index both = std::min<Eigen::Index>(from.rows(), base);
      r.unseen_instability.topLeftCorner(both, both) = from.topLeftCorner(both, both);
    }
    r.covariance += r.unseen_instability;
  }

  void report() {
    JointResult& r = result_;
    r.free = subset_;
    r.covariance = solution_.covariance;
    widen();
    r.noise = r.setup.noise;
    r.normalised_rms = std::sqrt(chi_square_an_observation(r.last));
    r.whiteness = test_whiteness(r.last.innovations);

    for (Eigen::Index d = 0; d < solution_.undetermined.cols(); ++d) {
      const Eigen::VectorXd direction = solution_.undetermined.col(d);
      Undetermined u;
      for (std::size_t i = 0; i < subset_.size(); ++i) {
        const double weight = direction[i];
        if (std::abs(weight) < determined_limits.smallest_part) continue;
        const int k = subset_[i];
        u.combination.emplace_back(k < parameter_count ? parameter_key(k) : options_.effects[k - parameter_count].key(),
                                   weight);
      }
      std::ranges::sort(u.combination,
                        [](const auto& a, const auto& b) { return std::abs(a.second) > std::abs(b.second); });
      r.undetermined.push_back(std::move(u));
    }
    for (std::size_t i = 0; i < subset_.size(); ++i) {
      const double sigma = std::sqrt(r.covariance(i, i));
      if (subset_[i] < parameter_count) {
        r.determined[subset_[i]] = !solution_.lost[i];
        r.sigma[subset_[i]] = solution_.lost[i] ? 0.0 : sigma;
      } else {
        const int k = subset_[i] - parameter_count;
        r.effects.push_back({options_.effects[k], effects_.values[k], sigma});
      }
    }
  }

  const CompressedRecording& recording_;
  const JointOptions& options_;
  Eigen::VectorXd ranges_;
  const double reference_temperature_c_;
  EffectModel effects_;
  std::vector<int> subset_;
  Eigen::VectorXd start_;  // where the parameters of the subset began
  SubsetSolution solution_;
  Eigen::VectorXd step_;               // of the subset, the last one taken
  std::vector<double> last_headings_;  // last correction of each chain's heading
  // Weight of the ranges: 1, or the misfit where larger. Else large residuals would push parameters that they hardly show.
  double looseness_ = 1.0;
  double misfit_ = 0.0;  // chi-square an observation before the last step of iterate()
  JointResult result_;
};

}  // namespace

Eigen::MatrixXd response_to_temperature(const CompressedRecording& recording, const JointResult& fit) {
  FilterSetup setup = fit.setup;
  setup.with_columns = true;
  const CompressedRecording coarse = coarser(recording, coarseness_of_scores, setup);
  const EffectModel no_effects = make_effect_model({}, {}, 0.0);
  LinearMotion motion(coarse, fit.parameters, no_effects, setup, {true, {walk_noise(setup.noise)}});
  std::vector<LinearInterval> intervals;
  for (LinearInterval interval; motion.next(interval);) {  // appends each parameter's column times T - mean
    const double off = double(coarse.blocks[interval.block].temperature_c) - recording.mean_temperature_c;
    LinearInterval& both = intervals.emplace_back(interval);
    for (Columns* const of : {&both.B_psi, &both.B_v, &both.D})
      *of = (Columns(2 * of->rows(), 3) << *of, (std::isnan(off) ? 0.0 : off) * *of).finished();
  }
  std::vector<int> keys = fit.free;
  std::erase_if(keys, [&](int key) { return key >= parameter_count || !fit.determined[key]; });
  const Eigen::MatrixXd A = run_filter(intervals, setup, {1.0}).information;
  Eigen::MatrixXd response = Eigen::MatrixXd::Zero(parameter_count, parameter_count);
  if (!keys.empty())
    response(keys, keys) = balanced_inverse(A(keys, keys)) * A.rightCols<parameter_count>()(keys, keys);
  return response;
}

JointResult joint_estimate(const CompressedRecording& recording, const JointOptions& options) {
  return JointRun(recording, options).run();
}

Whiteness test_whiteness(const std::vector<Innovation>& innovations) {
  constexpr int lags = 5;
  Whiteness w;
  w.autocorrelation = Eigen::VectorXd::Zero(lags);
  const NoiseLimits& limits = noise_limits;
  if (std::ssize(innovations) < limits.fewest_seconds) {
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
    for (std::size_t lag = 1; lag <= lags && lag <= i; ++lag)
      if (innovations[i].block - innovations[i - lag].block == lag)
        w.autocorrelation[lag - 1] += value(i).dot(value(i - lag));
  }
  w.autocorrelation /= square;
  const double values = 3.0 * double(innovations.size());
  w.level = raw / values;
  const double worst = w.autocorrelation.cwiseAbs().maxCoeff();
  const double limit = std::max(limits.white_correlation, limits.of_chance / std::sqrt(values));
  const double level_spread = limits.of_chance * std::sqrt(2.0 / values);
  w.white = worst < limit && w.level > std::min(limits.white_lowest, 1.0 - level_spread) &&
            w.level < std::max(limits.white_highest, 1.0 + level_spread);
  w.message = w.white          ? "innovations are white at the noise model"
              : worst >= limit ? "innovations are correlated in time: the noise model does not fit"
                               : "innovations are larger or smaller than the noise model says";
  return w;
}

double correct_headings(const FilterResult& pass, const Eigen::VectorXd& step, const std::vector<int>& subset,
                        const JointStart& start, std::vector<double>& headings, std::vector<double>& last) {
  if (!(start.heading_sigma_rad < 1.0)) return 0.0;  // not seen: nothing to correct it by
  constexpr double linear_rad = 0.5;
  const double first = headings.front();
  const std::size_t chains = pass.heading_error_rad.size();
  headings.resize(std::max(headings.size(), chains), first);
  last.resize(headings.size(), 0.0);
  double largest = 0.0;
  for (std::size_t k = 0; k < chains; ++k) {
    const double full = pass.heading_error_rad[k] + pass.heading_by_parameter[k](subset).dot(step);
    const double limit = full * last[k] < 0.0 ? 0.5 * std::abs(last[k]) : linear_rad;
    last[k] = std::clamp(full, -limit, limit);
    headings[k] += last[k];
    largest = std::max(largest, std::abs(last[k]) / pass.heading_sigma_rad[k]);
  }
  return largest;
}

}  // namespace turncal
