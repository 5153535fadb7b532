#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/joint/joint_iterations.h"
#include "calib/model/limits.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {

// Gauss-Newton at the noise that is measured before the fit. Dwells of a few seconds hardly show it, and an optimum too narrow for the
// start is missed: then it is tried again from wider ones, and what is found there is kept if it fits and, where it can be compared, fits better.
bool JointRun::settle() {
  JointResult& r = result_;
  const Parameters start = r.parameters;
  const Eigen::VectorXd start_values = effects_.values;
  const NoiseModel noise = r.setup.noise;
  const bool settled = settle_from_here();
  if (settled && misfit_ < start_limits.misfit) return true;
  const Parameters first = r.parameters;
  const Eigen::VectorXd first_values = effects_.values;
  const double first_misfit = settled ? misfit_ : std::numeric_limits<double>::infinity();
  for (const double louder : {5.0, 25.0}) {
    r.parameters = start;
    effects_.values = start_values;
    NoiseModel wide = noise;
    wide.angle_random_walk *= louder;
    wide.velocity_random_walk *= louder;
    const auto settles_with = [&](const NoiseModel& with) {
      r.setup.noise = with;
      return settle_from_here();
    };
    const bool near = settles_with(wide) && misfit_ < start_limits.misfit;
    const Parameters found = r.parameters;
    const Eigen::VectorXd found_values = effects_.values;
    const bool stands = near && settles_with(noise);
    if (stands && misfit_ < 0.5 * first_misfit) return true;
    r.setup.noise = noise;
    if (!near || stands || settled || options_.noise) continue;
    // Even there it is too narrow: the noise is fitted from the wider one.
    r.setup.noise = wide;
    r.parameters = found;
    effects_.values = found_values;
    return true;
  }
  r.parameters = first;
  effects_.values = first_values;
  return settled;
}

bool JointRun::settle_from_here() {
  const Parameters start = result_.parameters;
  const Eigen::VectorXd start_values = effects_.values;
  if (!options_.start && !iterate(1.0, 6, far_off)) {
    result_.parameters = start;
    effects_.values = start_values;
  }
  return iterate(0.3, options_.max_iterations, close_by);
}

// Gauss-Newton until the largest step is below `tolerance` sigma. Where directions are open, a step of their ranges is far from
// linear and its sigma says little: a step that made things worse is taken back to a part of it, and it ends when nothing is
// gained any more.
bool JointRun::iterate(double tolerance, int max_iterations, const Coarseness& coarseness) {
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

void JointRun::move(const Eigen::VectorXd& step) {
  ParameterVector values = to_vector(result_.parameters);
  for (std::size_t i = 0; i < subset_.size(); ++i) value_of(subset_[i], values) += step[static_cast<Eigen::Index>(i)];
  result_.parameters = from_vector(values);
}

// How far the parameters are from where they began, in ranges, squared.
double JointRun::out_of_range() {
  ParameterVector values = to_vector(result_.parameters);
  double sum = 0.0;
  for (std::size_t i = 0; i < subset_.size(); ++i)
    sum += std::pow((value_of(subset_[i], values) - start_[static_cast<Eigen::Index>(i)]) / ranges_[subset_[i]], 2);
  return sum;
}

// The step that a pass suggests. Returns the largest one in sigma; NaN where there is none.
double JointRun::improve(const FilterResult& pass) {
  ++result_.iterations;
  solution_ = solve_subset(pass.information, pass.gradient, subset_, ranges_);
  misfit_ = pass.chi_square / static_cast<double>(std::max<std::int64_t>(pass.observations, 1));
  looseness_ = std::max(misfit_, 1.0);
  if (!solution_.step.allFinite()) return std::numeric_limits<double>::quiet_NaN();
  step_ = solution_.step;
  Eigen::VectorXd sigma = solution_.covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
  if (is_open()) step_within_ranges(pass, step_, sigma);
  move(step_);
  const double largest = step_.size() > 0 ? step_.cwiseQuotient(sigma).cwiseAbs().maxCoeff() : 0.0;
  return std::max(largest, correct_headings(pass, step_, subset_, result_.start, result_.setup.headings_rad));
}

double correct_headings(const FilterResult& pass, const Eigen::VectorXd& step, const std::vector<int>& subset,
                        const JointStart& start, std::vector<double>& headings) {
  if (!(start.heading_sigma_rad < 1.0)) return 0.0;  // not seen: nothing to correct it by
  const double first = headings.front();
  double largest = 0.0;
  for (std::size_t k = 0; k < pass.heading_error_rad.size(); ++k) {
    if (k >= headings.size()) headings.push_back(first);
    const Eigen::VectorXd by_parameter = pass.heading_by_parameter[k](subset);
    const double correction = pass.heading_error_rad[k] + by_parameter.dot(step);
    headings[k] += correction;
    largest = std::max(largest, std::abs(correction) / pass.heading_sigma_rad[k]);
  }
  return largest;
}

// Gauss-Newton in the determined directions alone would creep, since which ones those are turns with every linearisation.
// So where some are open, the plausible ranges about the start are taken for observations; what is determined does not
// notice them.
void JointRun::step_within_ranges(const FilterResult& pass, Eigen::VectorXd& step, Eigen::VectorXd& sigma) {
  const Eigen::VectorXd weight = looseness_ * Eigen::VectorXd(ranges_(subset_)).cwiseAbs2().cwiseInverse();
  ParameterVector values = to_vector(result_.parameters);
  Eigen::VectorXd gradient = pass.gradient(subset_);
  for (std::size_t i = 0; i < subset_.size(); ++i) {
    const Eigen::Index row = static_cast<Eigen::Index>(i);
    gradient[row] += weight[row] * (value_of(subset_[i], values) - start_[row]);
  }
  Eigen::MatrixXd information = pass.information(subset_, subset_);
  information.diagonal() += weight;
  const Eigen::VectorXd balance = information.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd unit = balance.asDiagonal() * information * balance.asDiagonal();
  const Eigen::MatrixXd covariance =
      balance.asDiagonal() * solve_symmetric(unit, Eigen::MatrixXd(balance.asDiagonal()));
  step = -covariance * gradient;
  sigma = covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
}

}  // namespace turncal
