#include "calib/thermal/thermal_model.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

#include "calib/evidence/statement.h"
#include "calib/statistics/numerics.h"
#include "calib/types/value_text.h"

namespace turncal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index terms = thermal_smooth - 1, smooth_count = thermal_columns - thermal_smooth;  // without the constant
using Columns = Eigen::Matrix<double, 1, thermal_columns>;
using BlockVector = Eigen::Matrix<double, thermal_columns, 1>;

// Numerical floors: prior variance of an absent term, in a leg's variance; log weight relative to the best model at
// which a branch is dropped; pivot of a correlation matrix below which it is singular.
constexpr double least_variance = 1e-6, branch_floor = -12.0, least_pivot = 1e-10;

// The functions of temperature in t, -1 to 1 over the range: Legendre polynomials, and a basis of the Gaussian process beside them.
class Functions {
 public:
  Functions(double low_c, double high_c) : mid_(0.5 * (low_c + high_c)), half_(0.5 * (high_c - low_c)) {
    for (Index k = 0; k < nodes; ++k) at_[k] = -1.0 + 2.0 * double(k) / (nodes - 1);
    MatrixXd K(nodes, nodes), P(nodes, 4);
    for (Index k = 0; k < nodes; ++k) K.col(k) = kernel(at_[k]), P.row(k) = polynomials(at_[k]);
    const MatrixXd to_cubic = solve_symmetric(P.transpose() * P, MatrixXd(P.transpose()));
    const MatrixXd beside = MatrixXd::Identity(nodes, nodes) - P * to_cubic;
    const SymmetricEigen eigen = symmetric_eigen(beside * K * beside);
    // Scaled to unit variance, in the mean over the range.
    const double scale = std::sqrt(nodes / eigen.values.tail<smooth_count>().sum());
    for (Index a = 0; a < smooth_count; ++a)
      to_smooth_.col(a) = beside * eigen.vectors.col(nodes - 1 - a) * (scale / std::sqrt(eigen.values[nodes - 1 - a]));
    cubic_of_smooth_ = to_cubic * K * to_smooth_;
  }
  Columns at(double temperature_c, double rate = 0.0, int direction = 0) const {
    const double t = (temperature_c - mid_) / half_;
    Columns row;
    row.head<thermal_smooth>() << polynomials(t), rate, direction, direction * (1.0 - t * t);
    row.tail<smooth_count>() = kernel(t).transpose() * to_smooth_ - row.head<4>() * cubic_of_smooth_;
    return row;
  }
  // Returns the map of coefficients from Legendre polynomials to powers of T - reference.
  MatrixXd to_powers(double reference_c) const {
    const double s = 1.0 / half_, o = (reference_c - mid_) / half_;  // t = o + s x
    MatrixXd B = MatrixXd::Identity(thermal_columns, thermal_columns);
    B.topLeftCorner<4, 4>() << 1.0, o, 1.5 * o * o - 0.5, (2.5 * o * o - 1.5) * o,  //
        0.0, s, 3.0 * o * s, (7.5 * o * o - 1.5) * s,                               //
        0.0, 0.0, 1.5 * s * s, 7.5 * o * s * s,                                     //
        0.0, 0.0, 0.0, 2.5 * s * s * s;
    return B;
  }

 private:
  static constexpr Index nodes = 25;
  static Eigen::RowVector4d polynomials(double t) { return {1.0, t, 1.5 * t * t - 0.5, (2.5 * t * t - 1.5) * t}; }
  VectorXd kernel(double t) const {
    const double l = 2.0 * thermal_priors.length_of_range;
    return (-0.5 * ((at_.array() - t) / l).square()).exp();
  }
  double mid_, half_;
  VectorXd at_ = VectorXd::Zero(nodes);
  MatrixXd to_smooth_ = MatrixXd::Zero(nodes, smooth_count), cubic_of_smooth_;
};

bool is_bias(int key) { return key < 6; }

// What all fits of these legs, and of parts of them, share. Values in the sigma of a leg, about `centre`.
struct Setting {
  explicit Setting(double low_c, double high_c) : functions(low_c, high_c) {}
  Functions functions;
  double rate_unit = 0.0;  // C/h: the largest of all legs; infinite if they have the same
  std::vector<int> keys;
  ParameterVector scale = ParameterVector::Ones(), centre = ParameterVector::Zero();
};

// The legs of one fit, as information: W_i = C_i^-1 over the keys of the setting.
struct LegData {
  double temperature_c = 0.0, rate = 0.0;  // in rate_unit
  int direction = 0, switch_on = 0;
  MatrixXd W, within;  // keys x keys, zero where the leg determines nothing
  VectorXd y;
};

// What models may hold, as far as the legs allow.
struct Allowed {
  int temperatures = 0, order = 0;
  bool smooth = false, rate = false, hysteresis = false;
  int switch_ons = 0;
  double log_odds = 0.0;  // of rate, hysteresis, loop
};

template <class Leg>
int count_temperatures(const std::vector<Leg>& legs) {
  std::vector<double> all;
  for (const Leg& leg : legs) all.push_back(leg.temperature_c);
  std::ranges::sort(all);
  const auto is_same = [](double a, double b) { return b - a <= thermal_priors.same_temperature_c; };
  return int(std::unique(all.begin(), all.end(), is_same) - all.begin());
}

Allowed allowed_by(const std::vector<LegData>& legs, std::size_t keys) {
  Allowed a;
  a.temperatures = count_temperatures(legs);
  a.order = std::min(3, a.temperatures - 1);
  a.smooth = a.temperatures >= 5;  // more than a cubic has coefficients
  std::set<double> rates;
  std::set<int> directions, switch_ons;
  for (const LegData& leg : legs)
    rates.insert(leg.rate), directions.insert(leg.direction), switch_ons.insert(leg.switch_on);
  a.rate = rates.size() > 1;
  a.hysteresis = directions.contains(1) && directions.contains(-1);
  a.switch_ons = int(switch_ons.size());
  const double p = thermal_priors.per_effect / double(3 * keys);
  a.log_odds = std::log(p / (1.0 - p));
  return a;
}

// ---- models of one parameter ----

// Q and s of the evidence for orders 1 to 3, rate, hysteresis, loop; everything else is eliminated.
struct System {
  Eigen::Matrix<double, terms, terms> Q;
  Eigen::Matrix<double, terms, 1> s;
};

// Adds a column with its prior precision. Returns half the fall of chi-square.
double take_in(System& system, int c, double precision) {
  const Eigen::Matrix<double, terms, 1> column = system.Q.col(c);
  const double k = 1.0 / (column[c] + precision), s = system.s[c];
  system.Q.noalias() -= k * column * column.transpose();
  system.s -= k * s * column;
  return 0.5 * k * s * s;
}

// Precision and vector of some unknowns, and their log evidence.
struct Weighed {
  MatrixXd P;
  VectorXd q;
  double log_weight = 0.0;
};

// Integrates over the last `count` unknowns, each of this prior variance.
Weighed without_last(const Weighed& all, Index count, double variance) {
  const Index n = all.P.rows() - count;
  MatrixXd inner = all.P.bottomRightCorner(count, count);
  inner.diagonal().array() += 1.0 / variance;
  double log_determinant = 0.0;
  const VectorXd b = solve_symmetric(inner, VectorXd(all.q.tail(count)), log_determinant);
  const MatrixXd right = all.P.bottomLeftCorner(count, n);
  return {
      all.P.topLeftCorner(n, n) - right.transpose() * solve_symmetric(inner, right),
      all.q.head(n) - right.transpose() * b,
      all.log_weight + 0.5 * b.dot(all.q.tail(count)) - 0.5 * (log_determinant + double(count) * std::log(variance))};
}

struct Leaf {
  double weight = 0.0;                   // logarithm, then probability
  std::array<double, terms> variance{};  // 0: not in the model
  double smooth = 0.0;
  int order = 0, effects = 0, switch_on = 0;  // switch_on: index into its grid
};

// What the legs and the other parameters tell of one: precision and vector of its coefficients, then of its switch-ons.
struct Cavity : Weighed {
  double spread = 0.0;  // of the legs' values
};

struct Average {
  BlockVector mean = BlockVector::Zero();
  MatrixXd covariance;
  BlockVector prior = BlockVector::Zero();  // mean prior variances
  double switch_on = 0.0;                   // mean variance
  std::array<double, 4> order{};
  double smooth = 0.0, rate = 0.0, hysteresis = 0.0;
};

// Returns the grid of prior variances of an unknown with sigma `own`.
std::vector<double> sizes(double own, double largest) {
  std::vector<double> grid;
  double size = thermal_priors.smallest * own;
  for (int k = 0; k < thermal_priors.sizes && (k == 0 || size <= largest); ++k, size *= thermal_priors.factor)
    grid.push_back(size * size);
  return grid;
}

class Search {
 public:
  Search(const Cavity& cavity, const Allowed& allowed, bool bias) : cavity_(cavity), allowed_(allowed) {
    switch_on_.push_back(0.0);
    if (bias && allowed.switch_ons > 1)
      for (double t = thermal_priors.switch_on_smallest; t < 2.0 * cavity.spread; t *= thermal_priors.switch_on_factor)
        switch_on_.push_back(t);
    for (std::size_t k = 0; k < switch_on_.size(); ++k) at_switch_on(int(k));
  }
  Average average();

 private:
  void at_switch_on(int index);
  void explore(const System& system, int next, Leaf leaf, const double log_shape[4]);

  const Cavity& cavity_;
  const Allowed& allowed_;
  std::vector<double> switch_on_;                     // sigmas
  std::vector<Weighed> coefficients_;                 // of each
  std::array<std::vector<double>, terms> variances_;  // of each column
  std::vector<Leaf> leaves_;
  double best_ = -std::numeric_limits<double>::infinity();
};

void Search::at_switch_on(int index) {
  const double variance = switch_on_[index] * switch_on_[index];
  Weighed all = static_cast<const Weighed&>(cavity_);
  if (variance > 0.0) all = without_last(all, all.P.rows() - thermal_columns, variance);
  coefficients_.push_back({all.P.topLeftCorner<thermal_columns, thermal_columns>(), all.q.head<thermal_columns>(),
                           all.log_weight - std::log(double(switch_on_.size()))});
  all = coefficients_.back();
  // The constant has a flat prior and is eliminated.
  const BlockVector column = all.P.col(0);
  all.log_weight += 0.5 * all.q[0] * all.q[0] / column[0] - 0.5 * std::log(column[0]);
  all.P -= column * column.transpose() / column[0];
  all.q -= column * (all.q[0] / column[0]);
  const double spread = cavity_.spread, most = thermal_priors.most_of_spread * spread;
  for (Index c = 0; c < terms; ++c) {
    const double own = all.P(c + 1, c + 1);
    const bool told = c < 3 ? c < allowed_.order : c == 3 ? allowed_.rate : allowed_.hysteresis;
    variances_[c] = told && own > least_pivot ? sizes(1.0 / std::sqrt(own), most) : std::vector<double>{};
  }
  const auto system_of = [](const Weighed& of) {
    return System{of.P.block<terms, terms>(1, 1), of.q.segment<terms>(1)};
  };
  Leaf leaf;
  leaf.switch_on = index;
  const std::array<double, 5>& shape = thermal_priors.shape;
  double odds = allowed_.smooth ? shape[4] : 0.0;
  for (int k = 0; k <= allowed_.order; ++k) odds += shape[k];
  double polynomials[4];
  for (std::size_t k = 0; k < 4; ++k) polynomials[k] = std::log(shape[k] / odds);
  leaf.weight = all.log_weight;
  explore(system_of(all), 0, leaf, polynomials);
  if (!allowed_.smooth) return;
  // A smooth function beside a cubic; its sizes begin with the sigma of a mean of all legs.
  double with_s[4] = {-INFINITY, -INFINITY, -INFINITY, std::log(shape[4] / odds)};
  // A function without a mean spreads over at least twice its rms.
  const auto all_sizes = sizes(1.0 / std::sqrt(coefficients_.back().P(0, 0)), 0.5 * spread);
  for (const double size : all_sizes) {
    const Weighed rest = without_last(all, smooth_count, size);
    leaf.smooth = size;
    leaf.weight = rest.log_weight - std::log(double(all_sizes.size()));
    explore(system_of(rest), 0, leaf, with_s);
  }
}

void Search::explore(const System& system, int next, Leaf leaf, const double log_shape[4]) {
  Leaf whole = leaf;
  whole.weight += log_shape[leaf.order] + leaf.effects * allowed_.log_odds;
  best_ = std::max(best_, whole.weight);
  if (whole.weight > best_ + branch_floor) leaves_.push_back(whole);
  if (next == terms) return;
  // No set of further columns gains more than all of them together, at the odds of the best order.
  System rest = system;
  const double floor = least_pivot * (1.0 + system.Q.diagonal().maxCoeff());
  double most_gain = *std::max_element(log_shape + leaf.order, log_shape + allowed_.order + 1);
  for (int c = next; c < terms; ++c)
    if (!variances_[c].empty()) most_gain += take_in(rest, c, floor);
  for (int c = next; c < terms; ++c) {
    const auto& variances = variances_[c];
    if (variances.empty() || (c < 3 && c != leaf.order)) continue;
    const double prior = -std::log(double(variances.size()));
    for (const double variance : variances) {
      const double price = prior - 0.5 * std::log1p(variance * system.Q(c, c));
      Leaf longer = leaf;
      if (c >= 3) ++longer.effects;
      if (leaf.weight + price + most_gain + longer.effects * allowed_.log_odds < best_ + branch_floor) continue;
      System child = system;
      longer.weight += price + take_in(child, c, 1.0 / variance);
      longer.variance[c] = variance;
      if (c < 3) longer.order = c + 1;
      explore(child, c + 1, longer, log_shape);
    }
  }
}

Average Search::average() {
  double sum = 0.0;
  std::erase_if(leaves_, [&](const Leaf& leaf) { return leaf.weight < best_ + branch_floor; });
  for (Leaf& leaf : leaves_) sum += leaf.weight = std::exp(leaf.weight - best_);
  Average result;
  MatrixXd second = MatrixXd::Zero(thermal_columns, thermal_columns);
  for (Leaf& leaf : leaves_) {
    leaf.weight /= sum;
    BlockVector prior = BlockVector::Zero();
    prior.segment<terms>(1) = Eigen::Map<const Eigen::Matrix<double, terms, 1>>(leaf.variance.data());
    prior.tail<smooth_count>().setConstant(leaf.smooth);
    result.prior += leaf.weight * prior;
    const double t = switch_on_[leaf.switch_on];
    result.switch_on += leaf.weight * t * t;
    if (leaf.smooth > 0.0)
      result.smooth += leaf.weight;
    else
      result.order[leaf.order] += leaf.weight;
    if (leaf.variance[3] > 0.0) result.rate += leaf.weight;
    if (leaf.variance[4] > 0.0 || leaf.variance[5] > 0.0) result.hysteresis += leaf.weight;
    // Coefficients z of unit prior variance, so that absent ones need no case of their own; the constant is flat.
    BlockVector root = prior.cwiseSqrt();
    root[0] = 1.0;
    const Weighed& of = coefficients_[leaf.switch_on];
    MatrixXd inner = root.asDiagonal() * of.P * root.asDiagonal();
    inner.diagonal().tail<thermal_columns - 1>().array() += 1.0;
    const MatrixXd C = root.asDiagonal() * solve_symmetric(inner, MatrixXd(root.asDiagonal()));
    const BlockVector mean = C * of.q;
    result.mean += leaf.weight * mean;
    second += leaf.weight * (C + mean * mean.transpose());
  }
  result.covariance = second - result.mean * result.mean.transpose();
  return result;
}

// ---- all parameters together ----

struct Fit {
  std::vector<Average> averages;
  double lag_prior = 0.0, lag_variance = 0.0, lag_probability = 0.0;  // mean prior variance; in C at rate_unit
  VectorXd mean;                                                      // thermal_columns of each, then the lag
  MatrixXd covariance;                                                // of all
};

// Returns a leg as linear in the coefficients and then the lag, about these values: keys x (thermal_columns of each and 1).
MatrixXd rows_of(const LegData& leg, const Setting& setting, const VectorXd& about) {
  constexpr double step_c = 0.01;
  const Index count = setting.keys.size(), lag = count * thermal_columns;
  const auto at = [&](double c) {
    return setting.functions.at(leg.temperature_c - about[lag] * leg.rate + c, leg.rate, leg.direction);
  };
  const Columns row = at(0.0), slope = (at(step_c) - at(-step_c)) / (2.0 * step_c);
  MatrixXd F = MatrixXd::Zero(count, lag + 1);
  for (Index j = 0; j < count; ++j) {
    const Index first = j * thermal_columns;
    F.middleCols<thermal_columns>(first) = leg.within.col(j) * slope;
    F.block<1, thermal_columns>(j, first) += row;
    F(j, lag) = -leg.rate * slope.dot(about.segment<thermal_columns>(first));
  }
  return F;
}

// The joint system: for each key the places of its columns, and, behind all columns and the lag, of its switch-ons.
struct Joint {
  MatrixXd H;
  VectorXd b;
  std::vector<std::vector<Index>> rows;  // of each parameter
};

Joint joint_system(const std::vector<LegData>& legs, const Setting& setting, const VectorXd& about) {
  std::vector<int> ons;
  for (const LegData& leg : legs)
    if (std::ranges::find(ons, leg.switch_on) == ons.end()) ons.push_back(leg.switch_on);
  const Index biases = std::ranges::count_if(setting.keys, is_bias);
  const Index count = setting.keys.size(), of_ons = ons.size(), lag = count * thermal_columns;
  const Index size = lag + 1 + biases * of_ons;
  Joint joint{MatrixXd::Zero(size, size), VectorXd::Zero(size), {}};
  Index next = lag + 1;
  for (Index j = 0; j < count; ++j) {
    std::vector<Index> rows(thermal_columns);
    std::iota(rows.begin(), rows.end(), j * thermal_columns);
    if (is_bias(setting.keys[j]))
      for (Index k = 0; k < of_ons; ++k) rows.push_back(next++);
    joint.rows.push_back(rows);
  }
  for (const LegData& leg : legs) {
    MatrixXd F = MatrixXd::Zero(count, size);
    F.leftCols(lag + 1) = rows_of(leg, setting, about);
    const auto on = std::ranges::find(ons, leg.switch_on) - ons.begin();
    for (Index j = 0; j < count; ++j)
      if (const auto& rows = joint.rows[j]; rows.size() > thermal_columns) F(j, rows[thermal_columns + on]) = 1.0;
    const MatrixXd WF = leg.W * F;
    joint.H.noalias() += F.transpose() * WF;
    joint.b.noalias() += WF.transpose() * (leg.y + F.col(lag) * about[lag]);
  }
  return joint;
}

double spread_of(const std::vector<LegData>& legs, Index j) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const LegData& leg : legs)
    if (leg.W(j, j) > 0.0) low = std::min(low, leg.y[j]), high = std::max(high, leg.y[j]);
  return std::max(1.0, high - low);
}

// Returns the precision of the averages' priors; the constants have none.
VectorXd prior_precision(const Joint& joint, const Fit& fit) {
  VectorXd precision = VectorXd::Zero(joint.b.size());
  for (std::size_t j = 0; j < fit.averages.size(); ++j)
    for (std::size_t k = 1; k < joint.rows[j].size(); ++k) {
      const double variance = k < thermal_columns ? fit.averages[j].prior[k] : fit.averages[j].switch_on;
      precision[joint.rows[j][k]] = 1.0 / std::max(variance, least_variance);
    }
  precision[fit.averages.size() * thermal_columns] = 1.0 / std::max(fit.lag_prior, least_variance);
  return precision;
}

// Weighs no lag against one of each size, by what all parameters tell together.
void weigh_lag(double precision, double q, double longest, Fit& fit) {
  const auto grid = sizes(std::min(1.0 / std::sqrt(precision), longest / thermal_priors.smallest), longest);
  const double largest = 0.5 * q * q / (1.0 / grid.back() + precision);  // gain of a size
  const double none = (1.0 - thermal_priors.lag) * std::exp(-largest);
  double sum = none, mean = 0.0, second = 0.0, prior = 0.0;
  for (const double v : grid) {
    const double C = 1.0 / (1.0 / v + precision), gain = std::exp(0.5 * C * q * q - largest),
                 weight = thermal_priors.lag / double(grid.size()) * std::sqrt(C / v) * gain;
    sum += weight, prior += weight * v, mean += weight * C * q, second += weight * (C + C * q * C * q);
  }
  fit.lag_probability = 1.0 - none / sum, fit.lag_prior = prior / sum;
  fit.mean[fit.mean.size() - 1] = mean / sum, fit.lag_variance = second / sum - mean * mean / (sum * sum);
}

// Returns L of A = L L'; A is positive definite but for rounding.
MatrixXd lower_root(MatrixXd A) {
  A.diagonal().array() += 0.01 * least_variance;
  return A.llt().matrixL();
}

// Multiplies the unknowns from `first` on by T.
void transform(MatrixXd& C, Index first, const MatrixXd& T) {
  C.middleRows(first, T.rows()) = (T * C.middleRows(first, T.rows())).eval();
  C.middleCols(first, T.rows()) = (C.middleCols(first, T.rows()) * T.transpose()).eval();
}

// `before`: a fit to begin with; null: every term may be large.
Fit fit(const std::vector<LegData>& legs, const Setting& setting, const Fit* before) {
  const Index count = setting.keys.size(), lag = count * thermal_columns;
  const double longest = thermal_priors.longest_lag_h * setting.rate_unit;
  const Allowed allowed = allowed_by(legs, setting.keys.size());
  Fit result;
  Joint joint;
  MatrixXd M;
  VectorXd precision, m;
  const auto solve = [&] {
    joint = joint_system(legs, setting, result.mean);
    precision = prior_precision(joint, result);
    M = balanced_inverse(joint.H + MatrixXd(precision.asDiagonal()));
    m = M * joint.b;
  };
  if (before) {
    result = *before;
  } else {
    result.averages.resize(count);
    for (Index j = 0; j < count; ++j) {
      result.averages[j].prior.segment<3>(1).setConstant(std::pow(spread_of(legs, j), 2));
      result.averages[j].prior.segment<3>(4).setOnes();
      result.averages[j].switch_on = is_bias(setting.keys[j]) ? 1.0 : 0.0;
    }
    if (allowed.rate) result.lag_prior = longest * longest;
    result.mean = VectorXd::Zero(lag + 1);
    solve();
    result.mean.head(lag) = m.head(lag);
  }
  constexpr int rounds = 3;
  for (int round = before ? rounds - 1 : 0; round < rounds; ++round) {
    solve();
    for (Index j = 0; j < count; ++j) {
      const std::vector<Index>& rows = joint.rows[j];
      Cavity cavity;
      cavity.P = balanced_inverse(M(rows, rows));
      cavity.q = cavity.P * m(rows);
      cavity.P.diagonal() -= precision(rows);
      cavity.P = 0.5 * (cavity.P + cavity.P.transpose()).eval();
      cavity.spread = spread_of(legs, j);
      result.averages[j] = Search(cavity, allowed, is_bias(setting.keys[j])).average();
      result.mean.segment<thermal_columns>(j * thermal_columns) = result.averages[j].mean;
    }
    if (allowed.rate)
      weigh_lag(std::max(0.0, 1.0 / M(lag, lag) - precision[lag]), m[lag] / M(lag, lag), longest, result);
  }
  solve();
  result.covariance = M.topLeftCorner(lag + 1, lag + 1);
  const auto replace = [&](Index first, const MatrixXd& own) {
    const MatrixXd joint_root = lower_root(M.block(first, first, own.rows(), own.rows()));
    transform(result.covariance, first, lower_root(own) * inverse(joint_root));
  };
  for (Index j = 0; j < count; ++j) replace(j * thermal_columns, result.averages[j].covariance);
  replace(lag, MatrixXd::Constant(1, 1, result.lag_variance));
  return result;
}

// ---- from legs, and back ----

Status check(const ThermalLeg& leg) {
  const auto refuse = [&](const std::string& what) { return input_error(leg.name + ": " + what); };
  if (!std::isfinite(leg.temperature_c)) return refuse("has no temperature: expected a number");
  if (!std::isfinite(leg.rate_c_per_h)) return refuse("its rate of temperature is not finite: expected a number");
  const Index size = leg.free.size();
  if (size == 0) return refuse("determines no parameter: expected a calibration that does");
  if (leg.covariance.rows() != size || leg.covariance.cols() != size)
    return refuse(fmt::format("its covariance is {} x {}: expected one of the {} parameters that it determines",
                              leg.covariance.rows(), leg.covariance.cols(), size));
  for (Index k = 0; k < size; ++k) {
    const int key = leg.free[k];
    if (!std::isfinite(leg.value[key])) return refuse(parameter_key(key) + " is not finite: expected a number");
    if (!(leg.covariance(k, k) > 0.0) || !std::isfinite(leg.covariance(k, k)))
      return refuse("the variance of " + parameter_key(key) + ": expected a number above 0");
  }
  if (!leg.covariance.allFinite()) return refuse("its covariance is not finite: expected numbers");
  const VectorXd scale = leg.covariance.diagonal().cwiseSqrt().cwiseInverse();
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * leg.covariance * scale.asDiagonal());
  if (eigen.values[0] > least_pivot) return {};
  Index worst = 0;
  eigen.vectors.col(0).cwiseAbs().maxCoeff(&worst);
  return refuse("its covariance is singular, at " + parameter_key(leg.free[worst]) +
                ": expected that of parameters that are not functions of each other");
}

LegData data_of(const ThermalLeg& leg, const Setting& setting) {
  LegData data;
  data.temperature_c = leg.temperature_c, data.rate = leg.rate_c_per_h / setting.rate_unit;
  data.direction = leg.direction, data.switch_on = leg.switch_on;
  const Index count = setting.keys.size();
  data.W = data.within = MatrixXd::Zero(count, count);
  data.y = VectorXd::Zero(count);
  std::vector<Index> at;
  for (const int key : leg.free) at.push_back(std::ranges::find(setting.keys, key) - setting.keys.begin());
  const VectorXd scale = setting.scale(leg.free);
  data.y(at) = (leg.value - setting.centre)(leg.free).cwiseQuotient(scale);
  data.W(at, at) = scale.asDiagonal() * balanced_inverse(leg.covariance) * scale.asDiagonal();
  if (leg.within.size() > 0) data.within(at, at) = scale.cwiseInverse().asDiagonal() * leg.within * scale.asDiagonal();
  return data;
}

ThermalPoint point_at_leg(const LegData& leg, const Setting& setting, const Fit& fit) {
  const MatrixXd F = rows_of(leg, setting, fit.mean);
  const Index lag = F.cols() - 1;
  const VectorXd scale = setting.scale(setting.keys);
  ThermalPoint point;
  point.value(setting.keys) = setting.centre(setting.keys) + scale.cwiseProduct(F.leftCols(lag) * fit.mean.head(lag));
  point.covariance(setting.keys, setting.keys) =
      scale.asDiagonal() * (F * fit.covariance * F.transpose()) * scale.asDiagonal();
  return point;
}

// Sets the coefficients in file units, per power of T - reference.
void hand_out(const Fit& fit, const Setting& setting, ThermalModel& model) {
  MatrixXd B = setting.functions.to_powers(model.reference_c);
  B(thermal_rate, thermal_rate) = 1.0 / setting.rate_unit;
  model.coefficients = fit.mean;
  model.covariance = fit.covariance;
  model.lag = fit.lag_probability;
  const Index lag = model.coefficients.size() - 1;
  model.coefficients[lag] /= setting.rate_unit;
  transform(model.covariance, lag, MatrixXd::Constant(1, 1, 1.0 / setting.rate_unit));
  for (std::size_t j = 0; j < setting.keys.size(); ++j) {
    const MatrixXd out = B * setting.scale[setting.keys[j]];
    const Index first = j * thermal_columns;
    auto of_j = model.coefficients.segment(first, thermal_columns);
    of_j = (out * of_j).eval();
    of_j[0] += setting.centre[setting.keys[j]];
    transform(model.covariance, first, out);
    const Average& a = fit.averages[j];
    ThermalParameter p{setting.keys[j], a.order, a.smooth, a.rate, a.hysteresis};
    if (is_bias(p.key)) p.switch_on = std::sqrt(a.switch_on) * setting.scale[p.key];
    model.parameters.push_back(p);
  }
}

// Cross-validation: each temperature is left out once.
void hold_out(const std::vector<ThermalLeg>& legs, const std::vector<LegData>& data, const Setting& setting,
              const Fit& whole, ThermalModel& model) {
  ThermalHoldout& held_out = model.holdout;
  Eigen::Matrix<double, parameter_count, 5> sums = Eigen::Matrix<double, parameter_count, 5>::Zero();
  std::vector<std::size_t> order(legs.size());
  std::iota(order.begin(), order.end(), 0U);
  std::ranges::sort(order, {}, [&](std::size_t k) { return legs[k].temperature_c; });
  double last = -std::numeric_limits<double>::infinity();
  Fit others;
  ParameterVector sum, number;
  for (const std::size_t left_out : order) {
    const ThermalLeg& leg = legs[left_out];
    const auto is_apart = [&](double c) { return std::abs(c - last) > thermal_priors.same_temperature_c; };
    if (is_apart(leg.temperature_c)) {
      last = leg.temperature_c;
      std::vector<LegData> used;
      sum = number = ParameterVector::Zero();
      for (std::size_t k = 0; k < legs.size(); ++k) {
        if (legs[k].temperature_c >= last && !is_apart(legs[k].temperature_c)) continue;
        used.push_back(data[k]);
        for (const int key : legs[k].free) sum[key] += legs[k].value[key], number[key] += 1.0;
      }
      if (number(setting.keys).minCoeff() > 0.0) others = fit(used, setting, &whole);
    }
    if (number(setting.keys).minCoeff() == 0.0) continue;
    const ThermalPoint point = point_at_leg(data[left_out], setting, others);
    ParameterVector before = ParameterVector::Zero(), after = before;
    ParameterCovariance own = ParameterCovariance::Zero();
    own(leg.free, leg.free) = leg.covariance;
    for (const int key : leg.free) {
      const auto j = std::ranges::find(setting.keys, key) - setting.keys.begin();
      own(key, key) += others.averages[std::size_t(j)].switch_on * setting.scale[key] * setting.scale[key];
      before[key] = sum[key] / number[key] - leg.value[key];
      after[key] = point.value[key] - leg.value[key];
      const double variance = own(key, key) + point.covariance(key, key),
                   z = std::abs(after[key]) / std::sqrt(variance);
      sums.row(key) +=
          Eigen::Matrix<double, 1, 5>(before[key] * before[key], after[key] * after[key], variance, own(key, key), 1.0);
      if (z > held_out.worst_z) held_out.worst_z = z, held_out.worst_leg = leg.name, held_out.worst_key = key;
    }
    ++held_out.legs;
    held_out.before += before * before.transpose(), held_out.after += after * after.transpose(), held_out.noise += own;
  }
  for (ParameterCovariance* const of : {&held_out.before, &held_out.after, &held_out.noise})
    *of /= std::max(1, held_out.legs);
  for (ThermalParameter& p : model.parameters)
    for (int k = 0; k < 4 && sums(p.key, 4) > 0.0; ++k)
      p.left_out[std::size_t(k)] = std::sqrt(sums(p.key, k) / sums(p.key, 4));
}

}  // namespace

double ThermalParameter::at_least(int k) const {
  double sum = k > 0 ? smooth : 1.0;
  for (std::size_t n = k; k > 0 && n < order.size(); ++n) sum += order[n];
  return sum;
}

int ThermalParameter::said_order() const {
  int said = 0;
  while (said < 3 && at_least(said + 1) >= said_from) ++said;
  return said;
}

const ThermalParameter* ThermalModel::find(int key) const {
  const auto found = std::ranges::find(parameters, key, &ThermalParameter::key);
  return found == parameters.end() ? nullptr : &*found;
}

double ThermalModel::sigma(std::size_t parameter, int column) const {
  const Index at = parameter * thermal_columns + column;
  return std::sqrt(std::max(0.0, covariance(at, at)));
}

Result<ThermalModel> fit_thermal_model(const std::vector<ThermalLeg>& legs, const ThermalOptions& options) {
  if (legs.empty()) return input_error("no legs: expected calibrations at two temperatures at least");
  for (const ThermalLeg& leg : legs) TRY(check(leg));
  const auto [coldest, hottest] = std::ranges::minmax_element(legs, {}, &ThermalLeg::temperature_c);
  ThermalModel model;
  model.low_c = coldest->temperature_c, model.high_c = hottest->temperature_c;
  if (model.high_c - model.low_c <= thermal_priors.same_temperature_c)
    return input_error("{} at {:.2f} C: expected legs at two temperatures at least, {} C apart",
                       counted(std::ssize(legs), "leg"), model.low_c, thermal_priors.same_temperature_c);
  model.reference_c = options.reference_c.value_or(0.5 * (model.low_c + model.high_c));
  if (!(model.reference_c >= model.low_c && model.reference_c <= model.high_c))
    return input_error("reference temperature {} C: expected one in the range of the legs, {:.2f} to {:.2f} C",
                       model.reference_c, model.low_c, model.high_c);
  Setting setting(model.low_c, model.high_c);
  const auto [slowest, fastest] = std::ranges::minmax(legs, {}, &ThermalLeg::rate_c_per_h);
  setting.rate_unit = fastest.rate_c_per_h - slowest.rate_c_per_h > thermal_priors.same_rate_c_per_h
                          ? std::max(fastest.rate_c_per_h, -slowest.rate_c_per_h)
                          : std::numeric_limits<double>::infinity();
  for (int key = 0; key < parameter_count; ++key) {
    std::vector<double> sigmas;
    double sum = 0.0;
    for (const ThermalLeg& leg : legs) {
      const auto at = std::ranges::find(leg.free, key) - leg.free.begin();
      if (at == std::ssize(leg.free)) continue;
      sigmas.push_back(std::sqrt(leg.covariance(at, at)));
      sum += leg.value[key];
    }
    if (sigmas.empty()) continue;
    setting.keys.push_back(key);
    setting.centre[key] = sum / double(sigmas.size());
    if (sigmas.size() < legs.size())
      model.notes.push_back(
          fmt::format("{} is determined by {} of {} legs", parameter_key(key), sigmas.size(), legs.size()));
    setting.scale[key] = median(sigmas);
  }
  std::vector<LegData> data;
  for (const ThermalLeg& leg : legs) data.push_back(data_of(leg, setting));
  const Allowed allowed = allowed_by(data, setting.keys.size());
  model.temperatures = allowed.temperatures, model.most_order = allowed.order;
  const auto note_if = [&](bool missing, const std::string& what) {
    if (missing) model.notes.push_back(what);
  };
  const std::string temperatures = fmt::format("{} temperatures", allowed.temperatures);
  note_if(allowed.order < 3, fmt::format("{} determine no order above {}", temperatures, allowed.order));
  note_if(!allowed.smooth, temperatures + ": only polynomials are tried, other functions need 5");
  note_if(!allowed.rate, "all legs have the same rate of temperature: its effects are not determined");
  note_if(!allowed.hysteresis, "no temperature was approached from both sides: hysteresis is not determined");
  note_if(allowed.switch_ons < 2, "one switch-on: the turn-on repeatability of the biases is not determined");
  const Fit whole = fit(data, setting, nullptr);
  hand_out(whole, setting, model);
  for (const LegData& leg : data) model.at_legs.push_back(point_at_leg(leg, setting, whole).value);
  if (options.hold_out) hold_out(legs, data, setting, whole, model);
  return model;
}

ThermalPoint evaluate(const ThermalModel& model, double temperature_c) {
  const double at = std::clamp(temperature_c, model.low_c, model.high_c), x = at - model.reference_c;
  Columns row = Functions(model.low_c, model.high_c).at(at);
  row.head<4>() << 1.0, x, x * x, x * x * x;
  ThermalPoint point;
  for (std::size_t j = 0; j < model.parameters.size(); ++j) {
    const Index first = j * thermal_columns;
    const VectorXd with = model.covariance.middleCols<thermal_columns>(first) * row.transpose();
    point.value[model.parameters[j].key] = row * model.coefficients.segment<thermal_columns>(first);
    for (std::size_t k = 0; k < model.parameters.size(); ++k)
      point.covariance(model.parameters[k].key, model.parameters[j].key) =
          row * with.segment<thermal_columns>(k * thermal_columns);
  }
  return point;
}

double off_its_cubic(const ThermalModel& model, std::size_t parameter) {
  const Functions functions(model.low_c, model.high_c);
  const auto s = model.coefficients.segment<smooth_count>(parameter * thermal_columns + thermal_smooth);
  double worst = 0.0;
  for (int k = 0; k <= 40; ++k) {
    const double t = model.low_c + (model.high_c - model.low_c) * k / 40.0;
    worst = std::max(worst, std::abs(functions.at(t).tail<smooth_count>().dot(s)));
  }
  return worst;
}

ThermalExpectation expected_thermal_sigmas(const std::vector<ThermalLeg>& legs) {
  std::vector<int> keys = legs.front().free;  // those that every leg determines
  for (const ThermalLeg& leg : legs)
    std::erase_if(keys, [&](int key) { return std::ranges::find(leg.free, key) == leg.free.end(); });
  const auto [low, high] = std::ranges::minmax(legs, {}, &ThermalLeg::temperature_c);
  ThermalExpectation expected{0.5 * (low.temperature_c + high.temperature_c), {}};
  const double half = 0.5 * (high.temperature_c - low.temperature_c);
  const Index n = keys.size(), orders = std::min(4, count_temperatures(legs));
  MatrixXd information = MatrixXd::Zero(orders * n, orders * n);
  for (const ThermalLeg& leg : legs) {
    std::vector<Index> rows;
    for (const int key : keys) rows.push_back(std::ranges::find(leg.free, key) - leg.free.begin());
    const MatrixXd of_leg = balanced_inverse(leg.covariance(rows, rows));
    const double t = (leg.temperature_c - expected.reference_c) / half;
    for (Index a = 0; a < orders; ++a)
      for (Index b = 0; b < orders; ++b) information.block(a * n, b * n, n, n) += std::pow(t, double(a + b)) * of_leg;
  }
  const VectorXd variance = balanced_inverse(information).diagonal();
  for (Index a = 0; a < orders; ++a) {
    expected.sigma.push_back(ParameterVector::Zero());
    for (Index i = 0; i < n; ++i)
      expected.sigma.back()[keys[i]] = std::sqrt(variance[a * n + i]) / std::pow(half, double(a));
  }
  return expected;
}

}  // namespace turncal
