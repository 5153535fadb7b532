#include "calib/fleet/component_model.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

// The least of f(variance) over 0 and a logarithmic range, by a grid and golden section within its best interval.
double least(const std::function<double(double)>& f, double smallest, double largest) {
  constexpr int points = 13;
  const double step = std::log(largest / smallest) / (points - 1);
  double best = 0.0, best_value = f(0.0);
  for (int k = 0; k < points; ++k) {
    const double at = smallest * std::exp(k * step), value = f(at);
    if (value < best_value) best = at, best_value = value;
  }
  if (best == 0.0) return 0.0;
  const double golden = 0.5 * (std::sqrt(5.0) - 1.0);
  double low = std::log(best) - step, high = std::log(best) + step;
  double a = high - golden * (high - low), b = low + golden * (high - low);
  double fa = f(std::exp(a)), fb = f(std::exp(b));
  for (int k = 0; k < 18; ++k) {
    if (fa < fb) {
      high = b, b = a, fb = fa, a = high - golden * (high - low), fa = f(std::exp(a));
    } else {
      low = a, a = b, fa = fb, b = low + golden * (high - low), fb = f(std::exp(b));
    }
  }
  return std::exp(0.5 * (low + high));
}

// Between a hundredth of the smallest variance there is and what scatters at all.
struct Range {
  double smallest, largest;
};
Range range_of(const ComponentData& data) {
  double v = std::numeric_limits<double>::infinity(), sum = 0.0, square = 0.0, n = 0.0;
  for (Eigen::Index i = 0; i < data.y.size(); ++i) {
    if (!std::isfinite(data.v[i])) continue;
    v = std::min(v, data.v[i]);
    sum += data.y[i], square += data.y[i] * data.y[i], n += 1.0;
  }
  if (n < 2.0) return {1.0, 1.0};
  const double scatter = (square - sum * sum / n) / (n - 1.0);
  return {0.01 * v, std::max(4.0 * scatter, v)};
}

// -2 log of the restricted likelihood, less constants, beside X and random factors Z with these variances (one a column of Z).
double criterion(const ComponentData& data, double variance, const Eigen::MatrixXd& X, const Eigen::MatrixXd& Z,
                 const Eigen::VectorXd& of_factor) {
  const UnitWeights weights(data, variance);
  Eigen::MatrixXd all(data.y.size(), X.cols() + Z.cols() + 1);
  all << X, Z, data.y;
  Eigen::MatrixXd C = weights.product(all, all);
  double log_determinant = weights.log_determinant();
  const Eigen::Index p = X.cols(), q = Z.cols();
  if (q > 0) {  // V^-1 of the whole: C - C_z (D^-1 + Z'V^-1Z)^-1 C_z', written so that D may be 0
    const Eigen::VectorXd root = of_factor.cwiseSqrt();
    const Eigen::MatrixXd middle =
        Eigen::MatrixXd::Identity(q, q) + root.asDiagonal() * C.block(p, p, q, q) * root.asDiagonal();
    const Eigen::MatrixXd right = root.asDiagonal() * C.middleRows(p, q);
    double more = 0.0;
    solve_symmetric(middle, Eigen::VectorXd(Eigen::VectorXd::Zero(q)), more);
    log_determinant += more;
    C -= right.transpose() * solve_symmetric(middle, right);
  }
  const Eigen::VectorXd Xy = C.block(0, p + q, p, 1);
  double of_X = 0.0;
  const Eigen::VectorXd beta = solve_symmetric(Eigen::MatrixXd(C.topLeftCorner(p, p)), Xy, of_X);
  return log_determinant + of_X + C(p + q, p + q) - Xy.dot(beta);
}

}  // namespace

UnitWeights::UnitWeights(const ComponentData& data, double unit_variance) : w_(data.v.cwiseInverse()) {
  const Eigen::Index count = data.unit.size();
  for (Eigen::Index i = 0; i < count;) {
    Unit unit{i, 0, 0.0};
    double sum = 0.0;
    for (; i < count && data.unit[i] == data.unit[unit.first]; ++i) {
      sum += w_[i];
      if (w_[i] > 0.0) log_determinant_ -= std::log(w_[i]);
    }
    unit.count = i - unit.first;
    unit.shrink = unit_variance / (1.0 + unit_variance * sum);
    log_determinant_ += std::log1p(unit_variance * sum);
    if (unit.count > 1)
      units_.push_back(unit);
    else
      w_[unit.first] -= unit.shrink * sum * sum;
  }
}

Eigen::MatrixXd UnitWeights::product(const Eigen::MatrixXd& X, const Eigen::MatrixXd& Y) const {
  Eigen::MatrixXd result = X.transpose() * w_.asDiagonal() * Y;
  for (const Unit& u : units_) {
    const auto w = w_.segment(u.first, u.count).transpose();
    const Eigen::RowVectorXd x = w * X.middleRows(u.first, u.count), y = w * Y.middleRows(u.first, u.count);
    result.noalias() -= u.shrink * x.transpose() * y;
  }
  return result;
}

Eigen::VectorXd UnitWeights::diagonal(const Eigen::MatrixXd& X) const {
  Eigen::VectorXd result = X.cwiseAbs2().transpose() * w_;
  for (const Unit& u : units_)
    result -= u.shrink * (X.middleRows(u.first, u.count).transpose() * w_.segment(u.first, u.count)).cwiseAbs2();
  return result;
}

double recording_variance(const ComponentData& data) {
  double degrees = 0.0;
  const auto scatter = [&](double more) {
    double square = 0.0;
    degrees = 0.0;
    const Eigen::Index count = data.unit.size();
    for (Eigen::Index i = 0; i < count;) {
      const int unit = data.unit[i];
      double w = 0.0, wy = 0.0, wyy = 0.0, n = 0.0;
      for (; i < count && data.unit[i] == unit; ++i) {
        if (!std::isfinite(data.v[i])) continue;
        const double own = 1.0 / (data.v[i] + more);
        w += own, wy += own * data.y[i], wyy += own * data.y[i] * data.y[i], n += 1.0;
      }
      if (n < 2.0) continue;
      square += std::max(0.0, wyy - wy * wy / w);
      degrees += n - 1.0;
    }
    return square;
  };
  if (scatter(0.0) <= degrees) return 0.0;
  // It falls with sigma_r^2: halved in its logarithm.
  const Range range = range_of(data);
  double low = std::log(1e-6 * range.smallest), high = std::log(16.0 * range.largest);
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (scatter(std::exp(middle)) > degrees ? low : high) = middle;
  }
  return std::exp(0.5 * (low + high));
}

double unit_variance(const ComponentData& data, const Eigen::MatrixXd& X) {
  const Range range = range_of(data);
  const Eigen::MatrixXd none(data.y.size(), 0);
  return least([&](double variance) { return criterion(data, variance, X, none, {}); }, range.smallest, range.largest);
}

std::vector<double> variance_components(const ComponentData& data, const std::vector<std::vector<int>>& factors) {
  Eigen::Index columns = 0;
  std::vector<Eigen::Index> first;
  for (const std::vector<int>& factor : factors) {
    first.push_back(columns);
    columns += 1 + *std::max_element(factor.begin(), factor.end());
  }
  Eigen::MatrixXd Z = Eigen::MatrixXd::Zero(data.y.size(), columns);
  for (std::size_t f = 0; f < factors.size(); ++f)
    for (Eigen::Index i = 0; i < data.y.size(); ++i) Z(i, first[f] + factors[f][i]) = 1.0;
  const Eigen::MatrixXd mean = Eigen::MatrixXd::Ones(data.y.size(), 1);
  const Range range = range_of(data);
  std::vector<double> variances(factors.size() + 1, 0.0);
  const auto of_factor = [&](std::size_t f) { return f + 1 < first.size() ? first[f + 1] : columns; };
  // One after the other, thrice: the likelihood of variances of factors that cross each other has no ridges.
  for (int round = 0; round < 3; ++round)
    for (std::size_t k = 0; k < variances.size(); ++k)
      variances[k] = least(
          [&](double variance) {
            std::vector<double> trial = variances;
            trial[k] = variance;
            Eigen::VectorXd D(columns);
            for (std::size_t f = 0; f < factors.size(); ++f)
              D.segment(first[f], of_factor(f) - first[f]).setConstant(trial[f + 1]);
            return criterion(data, trial[0], mean, Z, D);
          },
          range.smallest, range.largest);
  return variances;
}

}  // namespace turncal
