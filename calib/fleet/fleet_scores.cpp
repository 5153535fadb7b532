#include "calib/fleet/fleet_scores.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numeric>

#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {

namespace {

// Returns the variance with the least f over 0 and a logarithmic range: a grid, then golden section in its best interval.
double least(const std::function<double(double)>& f, double smallest, double largest) {
  constexpr int points = 13;
  const double step = std::log(largest / smallest) / (points - 1);
  double best = 0.0, best_value = f(0.0);
  for (int k = 0; k < points; ++k) {
    const double at = smallest * std::exp(k * step), value = f(at);
    if (value < best_value - 1e-6) best = at, best_value = value;  // a smaller fall is rounding: the data do not tell
  }
  if (best == 0.0) return 0.0;
  const double golden = 0.5 * (std::sqrt(5.0) - 1.0);
  double low = std::log(best) - step, high = std::log(best) + step;
  double a = high - golden * (high - low), b = low + golden * (high - low);
  double fa = f(std::exp(a)), fb = f(std::exp(b));
  for (int k = 0; k < 18; ++k)
    if (fa < fb)
      high = b, b = a, fb = fa, a = high - golden * (high - low), fa = f(std::exp(a));
    else
      low = a, a = b, fa = fb, b = low + golden * (high - low), fb = f(std::exp(b));
  return std::exp(0.5 * (low + high));
}

// The range of the search: from a hundredth of the smallest variance to above the total scatter.
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

// Returns -2 log of the restricted likelihood, up to constants, beside X and random factors Z with these variances (one per column of Z).
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
  double product = 1.0;  // of the determinant's factors: one logarithm for many
  for (Eigen::Index i = 0; i < w_.size();) {
    Unit unit{i, 0, 0.0};
    double sum = 0.0;
    for (; i < w_.size() && data.unit[i] == data.unit[unit.first]; ++i) sum += w_[i];
    unit.count = i - unit.first;
    const double factor = 1.0 + unit_variance * sum;
    unit.shrink = unit_variance / factor;
    product *= factor;
    if (product > 1e100) log_determinant_ += std::log(product), product = 1.0;
    if (unit.count > 1)
      units_.push_back(unit);
    else
      w_[unit.first] -= unit.shrink * sum * sum;
  }
  log_determinant_ += std::log(product);
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
  // The sum falls with sigma_r^2: bisection in the logarithm.
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
    columns += 1 + *std::ranges::max_element(factor);
  }
  Eigen::MatrixXd Z = Eigen::MatrixXd::Zero(data.y.size(), columns);
  for (std::size_t f = 0; f < factors.size(); ++f)
    for (Eigen::Index i = 0; i < data.y.size(); ++i) Z(i, first[f] + factors[f][i]) = 1.0;
  const Eigen::MatrixXd mean = Eigen::MatrixXd::Ones(data.y.size(), 1);
  const Range range = range_of(data);
  std::vector<double> variances(factors.size() + 1, 0.0);
  const auto of_factor = [&](std::size_t f) { return f + 1 < first.size() ? first[f + 1] : columns; };
  // One after the other, three times: the likelihood of crossed factors has no ridges.
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

// ---- the scores ----

namespace {

constexpr int most_begins = 24;  // days tried for a step or ramp
constexpr std::size_t least_of_shape = fleet_limits.least_of_shape;

double at(const FleetScores& scores, const Hypothesis& h, std::size_t i) {
  if (h.factor >= 0 && scores.level_of(h.factor)[i] != h.level) return 0.0;
  const double since = scores.member(i).day - h.begin_day;
  if (h.shape == FleetShape::constant) return 1.0;
  return h.shape == FleetShape::step ? double(since >= 0.0) : std::max(0.0, since);
}

// Returns the columns that have data.
Eigen::MatrixXd used(const ComponentData& data, const Eigen::MatrixXd& X) {
  std::vector<Eigen::Index> columns;
  for (Eigen::Index k = 0; k < X.cols(); ++k)
    if ((X.col(k).array().abs() / data.v.array()).sum() > 0.0) columns.push_back(k);
  return X(Eigen::all, columns);
}

// Returns the number of units with data.
double units_of(const ComponentData& data) {
  double units = 0.0;
  for (std::size_t i = 0; i < data.unit.size();) {
    const int unit = data.unit[i];
    bool says = false;
    for (; i < data.unit.size() && data.unit[i] == unit; ++i) says |= std::isfinite(data.v[i]);
    units += says;
  }
  return units;
}

std::vector<double> begins(const FleetScores& scores, std::size_t factor, int level) {
  std::vector<double> days;
  for (std::size_t i = 0; i < scores.size(); ++i)
    if (scores.level_of(factor)[i] == level && std::isfinite(scores.member(i).day))
      days.push_back(scores.member(i).day);
  if (days.size() < 2 * least_of_shape) return {};
  std::ranges::sort(days);
  std::vector<double> result;
  const std::size_t between = days.size() - 2 * least_of_shape;
  for (std::size_t k = 0; k < most_begins; ++k) {
    const std::size_t i = least_of_shape + between * k / (most_begins - 1);
    const double day = 0.5 * (days[i - 1] + days[i]);
    if (days[i] > days[i - 1] && (result.empty() || day > result.back())) result.push_back(day);
  }
  return result;
}

}  // namespace

FleetScores::FleetScores(const std::vector<FleetMember>& members, std::size_t factors) : given_(members.size()) {
  std::iota(given_.begin(), given_.end(), 0);
  std::ranges::stable_sort(given_, [&](std::size_t a, std::size_t b) { return members[a].unit < members[b].unit; });
  std::map<std::string, int> place;
  std::map<std::vector<std::string>, std::size_t> layouts;
  for (const std::size_t i : given_) {
    const UnitStatistics& u = members[i].statistics;
    members_.push_back(&members[i]);
    s_.push_back(u.s);
    value_.push_back(u.value);
    for (const std::string& key : u.columns)
      if (place.emplace(key, int(components_.size())).second) components_.push_back(key);
    layout_.push_back(layouts.emplace(u.columns, layouts.size()).first->second);
  }
  effects_ = components_.size();
  for (const int k : free_parameters()) components_.push_back("parameter " + parameter_key(k));
  columns_.assign(layouts.size(), std::vector<int>(components_.size(), -1));
  for (const auto& [keys, layout] : layouts) {
    for (int k = 0; k < std::ssize(keys); ++k) columns_[layout][place[keys[k]]] = k;
    std::copy(free_parameters().begin(), free_parameters().end(), columns_[layout].begin() + std::ssize(place));
  }
  for (std::size_t f = 0; f < factors; ++f) {
    std::map<std::string, int> places;  // in the order of their names
    for (const FleetMember* m : members_) places[m->level[f]];
    levels_.emplace_back();
    for (auto& [name, level] : places) {
      level = int(levels_[f].size());
      levels_[f].push_back(name);
    }
    level_of_.emplace_back();
    for (const FleetMember* m : members_) level_of_[f].push_back(places[m->level[f]]);
  }
  for (std::size_t i = 0; i < members_.size(); ++i)
    unit_of_.push_back(i == 0 ? 0 : unit_of_.back() + (members_[i]->unit == members_[i - 1]->unit ? 0 : 1));
  aside_.assign(members_.size(), std::vector<char>(components_.size(), 0));
}

ComponentData FleetScores::nothing() const {
  const Eigen::Index count = members_.size();
  return {Eigen::VectorXd::Zero(count), Eigen::VectorXd::Constant(count, std::numeric_limits<double>::infinity()),
          unit_of_};
}

ComponentData FleetScores::data(std::size_t component) const {
  ComponentData d = nothing();
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const int k = column(i, component);
    if (k < 0 || aside_[i][component]) continue;
    const UnitStatistics& u = members_[i]->statistics;
    if (is_parameter(component)) {
      if (!(u.sigma[k] > 0.0)) continue;
      d.y[i] = value_[i][k];
      d.v[i] = u.sigma[k] * u.sigma[k];
    } else if (u.Q(k, k) > 0.0F) {
      d.v[i] = 1.0 / double(u.Q(k, k));
      d.y[i] = s_[i][k] * d.v[i];
    }
  }
  return d;
}

std::vector<ComponentData> FleetScores::sums(const Eigen::MatrixXd& weights) const {
  std::vector<ComponentData> all(weights.cols(), nothing());
  std::vector<Eigen::MatrixXf> own;  // the weights in the order of each layout
  for (const std::vector<int>& columns : columns_) {
    const auto end = columns.begin() + std::ptrdiff_t(effects_);
    own.emplace_back(
        Eigen::MatrixXf::Zero(std::count_if(columns.begin(), end, [](int k) { return k >= 0; }), weights.cols()));
    for (std::size_t c = 0; c < effects_; ++c)
      if (columns[c] >= 0) own.back().row(columns[c]) = weights.row(c).cast<float>();
  }
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const Eigen::MatrixXf& W = own[layout_[i]];
    const Eigen::MatrixXf QW = members_[i]->statistics.Q * W;
    const Eigen::VectorXd Q = W.cwiseProduct(QW).colwise().sum().transpose().cast<double>();
    const Eigen::VectorXd s = W.cast<double>().transpose() * s_[i];
    for (Eigen::Index k = 0; k < Q.size(); ++k) {
      if (!(Q[k] > 0.0)) continue;
      all[k].v[i] = 1.0 / Q[k];
      all[k].y[i] = s[k] / Q[k];
    }
  }
  return all;
}

Eigen::MatrixXd FleetScores::information() const {
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(effects_, effects_);
  for (std::size_t i = 0; i < members_.size(); ++i)
    for (std::size_t a = 0; a < effects_; ++a) {
      const int k = column(i, a);
      for (std::size_t b = 0; k >= 0 && b < effects_; ++b)
        if (const int l = column(i, b); l >= 0) sum(a, b) += double(members_[i]->statistics.Q(k, l));
    }
  return sum;
}

void FleetScores::subtract(std::size_t member, std::size_t component, double value) {
  const int k = column(member, component);
  if (k < 0) return;
  if (is_parameter(component)) {
    value_[member][k] -= value;
    return;
  }
  const UnitStatistics& u = members_[member]->statistics;
  explained_ += value * (2.0 * s_[member][k] - value * double(u.Q(k, k)));
  s_[member] -= u.Q.col(k).cast<double>() * value;
  value_[member] += u.moves.col(k).cast<double>() * value;
}

Eigen::VectorXd column_of(const FleetScores& scores, const Hypothesis& h) {
  Eigen::VectorXd x(scores.size());
  for (std::size_t i = 0; i < scores.size(); ++i) x[i] = at(scores, h, i);
  return x;
}

Eigen::MatrixXd level_columns(const FleetScores& scores, int factor) {
  if (factor < 0) return Eigen::MatrixXd::Ones(scores.size(), 1);
  Eigen::MatrixXd X = Eigen::MatrixXd::Zero(scores.size(), scores.levels(factor).size());
  for (std::size_t i = 0; i < scores.size(); ++i) X(i, scores.level_of(factor)[i]) = 1.0;
  return X;
}

Hypotheses all_hypotheses(const FleetScores& scores, const std::vector<std::string>& factors) {
  Hypotheses h;
  h.constant.list.push_back({});
  for (int f = 0; f < std::ssize(factors); ++f) {
    const int count = int(scores.levels(f).size());
    for (int level = 0; level < count; ++level) {
      if (count > 1) h.constant.list.push_back({f, level, FleetShape::constant, 0.0});
      if (factors[f] == "month") continue;
      for (const double day : begins(scores, f, level))
        for (const FleetShape shape : {FleetShape::step, FleetShape::ramp})
          h.shapes.list.push_back({f, level, shape, day});
    }
  }
  for (HypothesisList* l : {&h.constant, &h.shapes}) {
    l->X.resize(scores.size(), l->list.size());
    for (std::size_t k = 0; k < l->list.size(); ++k) l->X.col(k) = column_of(scores, l->list[k]);
  }
  return h;
}

Component::Component(ComponentData the_data, const Eigen::MatrixXd& beside, bool others)
    : data(std::move(the_data)), from_others(others), weights(data, 0.0) {
  const Eigen::MatrixXd X = used(data, beside);
  data.v.array() += recording_variance(data);
  degrees = units_of(data) - double(X.cols());
  if (X.cols() > 0 && degrees >= 1.0) weights = UnitWeights(data, unit_variance(data, X));
}

std::vector<FleetEstimate> Component::test(const Eigen::MatrixXd& X) const {
  Eigen::VectorXd score = weights.product(X, data.y), information = weights.diagonal(X);
  const Eigen::VectorXd whole = information;
  if (from_others) {
    const Eigen::MatrixXd one = Eigen::MatrixXd::Ones(X.rows(), 1);
    const Eigen::VectorXd with_one = weights.product(X, one);
    const double ones = weights.diagonal(one)[0];
    score -= with_one * (weights.product(one, data.y)(0, 0) / ones);
    information -= with_one.cwiseAbs2() / ones;
  }
  std::vector<FleetEstimate> estimates(X.cols());
  for (Eigen::Index k = 0; k < X.cols(); ++k)
    if (whole[k] > 0.0 && information[k] > 1e-9 * whole[k])
      estimates[k] = {score[k] / information[k], 1.0 / std::sqrt(information[k]), score[k] / std::sqrt(information[k])};
  return estimates;
}

Component component_of(const FleetScores& scores, std::size_t c, int factor) {
  return {scores.data(c), level_columns(scores, factor), scores.is_parameter(c)};
}

}  // namespace turncal
