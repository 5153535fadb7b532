#include "calib/fleet/fleet_scores.h"

#include <algorithm>
#include <limits>
#include <map>

namespace turncal {
namespace {

constexpr double says_nothing = std::numeric_limits<double>::infinity();

}  // namespace

FleetScores::FleetScores(const std::vector<FleetMember>& members, std::size_t factors) {
  for (std::size_t i = 0; i < members.size(); ++i) given_.push_back(i);
  std::stable_sort(given_.begin(), given_.end(),
                   [&](std::size_t a, std::size_t b) { return members[a].unit < members[b].unit; });
  for (const std::size_t i : given_) {
    members_.push_back(&members[i]);
    s_.push_back(members[i].statistics.s);
    value_.push_back(members[i].statistics.value);
  }
  std::map<std::string, int> place;
  std::map<std::vector<std::string>, std::size_t> layouts;
  for (const FleetMember* m : members_) {
    for (const std::string& key : m->statistics.columns)
      if (place.emplace(key, static_cast<int>(components_.size())).second) components_.push_back(key);
    layout_.push_back(layouts.emplace(m->statistics.columns, layouts.size()).first->second);
  }
  effects_ = components_.size();
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[static_cast<std::size_t>(k)])
      components_.push_back("parameter " + std::string(parameter_keys[static_cast<std::size_t>(k)]));
  columns_.assign(layouts.size(), std::vector<int>(components_.size(), -1));
  for (const auto& [keys, layout] : layouts)
    for (std::size_t k = 0; k < keys.size(); ++k)
      columns_[layout][static_cast<std::size_t>(place[keys[k]])] = static_cast<int>(k);
  for (std::vector<int>& columns : columns_)
    for (int k = 0, at = static_cast<int>(effects_); k < parameter_count; ++k)
      if (parameter_is_free[static_cast<std::size_t>(k)]) columns[static_cast<std::size_t>(at++)] = k;

  for (std::size_t f = 0; f < factors; ++f) {
    std::vector<std::string> names;
    for (const FleetMember* m : members_) names.push_back(m->level[f]);
    std::sort(names.begin(), names.end());
    names.erase(std::unique(names.begin(), names.end()), names.end());
    std::vector<int> of;
    for (const FleetMember* m : members_)
      of.push_back(static_cast<int>(std::lower_bound(names.begin(), names.end(), m->level[f]) - names.begin()));
    levels_.push_back(std::move(names));
    level_of_.push_back(std::move(of));
  }
  for (std::size_t i = 0; i < members_.size(); ++i)
    unit_of_.push_back(i == 0 ? 0 : unit_of_.back() + (members_[i]->unit == members_[i - 1]->unit ? 0 : 1));
  aside_.assign(members_.size(), std::vector<char>(components_.size(), 0));
}

ComponentData FleetScores::data(std::size_t component) const {
  const auto count = static_cast<Eigen::Index>(members_.size());
  ComponentData d{Eigen::VectorXd::Zero(count), Eigen::VectorXd::Constant(count, says_nothing), unit_of_};
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const int k = column(i, component);
    if (k < 0 || aside_[i][component]) continue;
    const UnitStatistics& u = members_[i]->statistics;
    const auto at = static_cast<Eigen::Index>(i);
    if (is_parameter(component)) {
      if (!(u.sigma[k] > 0.0)) continue;
      d.y[at] = value_[i][k];
      d.v[at] = u.sigma[k] * u.sigma[k];
    } else if (u.Q(k, k) > 0.0F) {
      d.v[at] = 1.0 / static_cast<double>(u.Q(k, k));
      d.y[at] = s_[i][k] * d.v[at];
    }
  }
  return d;
}

std::vector<ComponentData> FleetScores::sums(const Eigen::MatrixXd& weights) const {
  const auto count = static_cast<Eigen::Index>(members_.size());
  const ComponentData empty{Eigen::VectorXd::Zero(count), Eigen::VectorXd::Constant(count, says_nothing), unit_of_};
  std::vector<ComponentData> all(static_cast<std::size_t>(weights.cols()), empty);
  std::vector<Eigen::MatrixXf> own;  // the weights in the order of each layout
  for (const std::vector<int>& columns : columns_) {
    const auto rows = std::count_if(columns.begin(), columns.begin() + static_cast<std::ptrdiff_t>(effects_),
                                    [](int k) { return k >= 0; });
    own.emplace_back(Eigen::MatrixXf::Zero(rows, weights.cols()));
    for (std::size_t c = 0; c < effects_; ++c)
      if (columns[c] >= 0) own.back().row(columns[c]) = weights.row(static_cast<Eigen::Index>(c)).cast<float>();
  }
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const UnitStatistics& u = members_[i]->statistics;
    const Eigen::MatrixXf& W = own[layout_[i]];
    const Eigen::MatrixXf QW = u.Q * W;
    const Eigen::VectorXd Q = W.cwiseProduct(QW).colwise().sum().transpose().cast<double>();
    const Eigen::VectorXd s = W.cast<double>().transpose() * s_[i];
    for (Eigen::Index k = 0; k < Q.size(); ++k) {
      if (!(Q[k] > 0.0)) continue;
      all[static_cast<std::size_t>(k)].v[static_cast<Eigen::Index>(i)] = 1.0 / Q[k];
      all[static_cast<std::size_t>(k)].y[static_cast<Eigen::Index>(i)] = s[k] / Q[k];
    }
  }
  return all;
}

Eigen::MatrixXd FleetScores::information() const {
  const auto count = static_cast<Eigen::Index>(effects_);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(count, count);
  for (std::size_t i = 0; i < members_.size(); ++i)
    for (Eigen::Index a = 0; a < count; ++a) {
      const int k = column(i, static_cast<std::size_t>(a));
      if (k < 0) continue;
      for (Eigen::Index b = 0; b < count; ++b)
        if (const int l = column(i, static_cast<std::size_t>(b)); l >= 0)
          sum(a, b) += static_cast<double>(members_[i]->statistics.Q(k, l));
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

}  // namespace turncal
