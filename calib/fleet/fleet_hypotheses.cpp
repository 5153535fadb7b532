#include "calib/fleet/fleet_hypotheses.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include "calib/model/limits.h"

namespace turncal {
namespace {

constexpr int most_begins = 24;  // of a step or ramp that are tried
constexpr std::size_t least_of_shape = fleet_limits.least_of_shape;

double at(const FleetScores& scores, const Hypothesis& h, std::size_t i) {
  if (h.factor >= 0 && scores.level_of(static_cast<std::size_t>(h.factor))[i] != h.level) return 0.0;
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
  std::vector<int> columns;
  for (Eigen::Index k = 0; k < X.cols(); ++k)
    if ((X.col(k).array().abs() / data.v.array()).sum() > 0.0) columns.push_back(static_cast<int>(k));
  return X(Eigen::all, columns);
}

// How many units say something.
double units_of(const ComponentData& data) {
  double units = 0.0;
  for (std::size_t i = 0; i < data.unit.size();) {
    const int unit = data.unit[i];
    bool says = false;
    for (; i < data.unit.size() && data.unit[i] == unit; ++i)
      says |= std::isfinite(data.v[static_cast<Eigen::Index>(i)]);
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
  for (int k = 0; k < most_begins; ++k) {
    const std::size_t i = least_of_shape + between * static_cast<std::size_t>(k) / (most_begins - 1);
    const double day = 0.5 * (days[i - 1] + days[i]);
    if (days[i] > days[i - 1] && (result.empty() || day > result.back())) result.push_back(day);
  }
  return result;
}

}  // namespace

Eigen::VectorXd column_of(const FleetScores& scores, const Hypothesis& h) {
  Eigen::VectorXd x(static_cast<Eigen::Index>(scores.size()));
  for (std::size_t i = 0; i < scores.size(); ++i) x[static_cast<Eigen::Index>(i)] = at(scores, h, i);
  return x;
}

Eigen::MatrixXd level_columns(const FleetScores& scores, int factor) {
  const auto rows = static_cast<Eigen::Index>(scores.size());
  if (factor < 0) return Eigen::MatrixXd::Ones(rows, 1);
  const std::vector<int>& level = scores.level_of(static_cast<std::size_t>(factor));
  const auto count = static_cast<Eigen::Index>(scores.levels(static_cast<std::size_t>(factor)).size());
  Eigen::MatrixXd X = Eigen::MatrixXd::Zero(rows, count);
  for (Eigen::Index i = 0; i < rows; ++i) X(i, level[static_cast<std::size_t>(i)]) = 1.0;
  return X;
}

Hypotheses all_hypotheses(const FleetScores& scores, const FleetOptions& options) {
  Hypotheses h;
  h.constant.list.push_back({});
  for (std::size_t f = 0; f < options.factors.size(); ++f) {
    const int count = static_cast<int>(scores.levels(f).size());
    for (int level = 0; level < count; ++level) {
      if (count > 1) h.constant.list.push_back({static_cast<int>(f), level, FleetShape::constant, 0.0});
      if (options.factors[f] == "month") continue;
      for (const double day : begins(scores, f, level))
        for (const FleetShape shape : {FleetShape::step, FleetShape::ramp})
          h.shapes.list.push_back({static_cast<int>(f), level, shape, day});
    }
  }
  for (HypothesisList* l : {&h.constant, &h.shapes}) {
    l->X.resize(static_cast<Eigen::Index>(scores.size()), static_cast<Eigen::Index>(l->list.size()));
    for (std::size_t k = 0; k < l->list.size(); ++k)
      l->X.col(static_cast<Eigen::Index>(k)) = column_of(scores, l->list[k]);
  }
  return h;
}

Component::Component(ComponentData the_data, const Eigen::MatrixXd& beside, bool others)
    : data(std::move(the_data)), from_others(others), weights(data, 0.0) {
  const Eigen::MatrixXd X = used(data, beside);
  data.v.array() += recording_variance(data);
  degrees = units_of(data) - static_cast<double>(X.cols());
  if (X.cols() == 0 || degrees < 1.0) return;
  variance = unit_variance(data, X);
  weights = UnitWeights(data, variance);
}
std::vector<Estimate> Component::test(const Eigen::MatrixXd& X) const {
  Eigen::VectorXd score = weights.product(X, data.y), information = weights.diagonal(X);
  const Eigen::VectorXd whole = information;
  if (from_others) {
    const Eigen::MatrixXd one = Eigen::MatrixXd::Ones(X.rows(), 1);
    const Eigen::VectorXd with_one = weights.product(X, one);
    const double ones = weights.diagonal(one)[0];
    score -= with_one * (weights.product(one, data.y)(0, 0) / ones);
    information -= with_one.cwiseAbs2() / ones;
  }
  std::vector<Estimate> estimates;
  for (Eigen::Index k = 0; k < X.cols(); ++k)
    if (whole[k] > 0.0 && information[k] > 1e-9 * whole[k])
      estimates.push_back(
          {score[k] / information[k], 1.0 / std::sqrt(information[k]), score[k] / std::sqrt(information[k])});
    else
      estimates.push_back({});
  return estimates;
}

Component component_of(const FleetScores& scores, std::size_t c, int factor) {
  return {scores.data(c), level_columns(scores, factor), scores.is_parameter(c)};
}

}  // namespace turncal
