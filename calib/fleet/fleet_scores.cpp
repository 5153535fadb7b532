#include "calib/fleet/fleet_scores.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "calib/model/limits.h"

namespace turncal {
namespace {

constexpr int most_begins = 24;  // of a step or ramp that are tried
constexpr std::size_t least_of_shape = fleet_limits.least_of_shape;

double at(const FleetScores& scores, const Hypothesis& h, std::size_t i) {
  if (h.factor >= 0 && scores.level_of(h.factor)[i] != h.level) return 0.0;
  const double since = scores.member(i).day - h.begin_day;
  switch (h.shape) {
    case FleetShape::constant: return 1.0;
    case FleetShape::step: return since >= 0.0 ? 1.0 : 0.0;
    case FleetShape::ramp: return since > 0.0 ? since : 0.0;
  }
  return 0.0;
}

// Of those of the columns that have data.
Eigen::MatrixXd used(const ComponentData& data, const Eigen::MatrixXd& X) {
  std::vector<Eigen::Index> columns;
  for (Eigen::Index k = 0; k < X.cols(); ++k)
    if ((X.col(k).array().abs() / data.v.array()).sum() > 0.0) columns.push_back(k);
  return X(Eigen::all, columns);
}

// How many units say something.
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
  std::sort(days.begin(), days.end());
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
  std::stable_sort(given_.begin(), given_.end(),
                   [&](std::size_t a, std::size_t b) { return members[a].unit < members[b].unit; });
  std::map<std::string, int> place;
  std::map<std::vector<std::string>, std::size_t> layouts;
  for (const std::size_t i : given_) {
    const UnitStatistics& u = members[i].statistics;
    members_.push_back(&members[i]);
    s_.push_back(u.s);
    value_.push_back(u.value);
    for (const std::string& key : u.columns)
      if (place.emplace(key, static_cast<int>(components_.size())).second) components_.push_back(key);
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
      level = static_cast<int>(levels_[f].size());
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
      d.v[i] = 1.0 / static_cast<double>(u.Q(k, k));
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
        if (const int l = column(i, b); l >= 0) sum(a, b) += static_cast<double>(members_[i]->statistics.Q(k, l));
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
  explained_ += value * (2.0 * s_[member][k] - value * static_cast<double>(u.Q(k, k)));
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
    const int count = static_cast<int>(scores.levels(f).size());
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
  degrees = units_of(data) - static_cast<double>(X.cols());
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
