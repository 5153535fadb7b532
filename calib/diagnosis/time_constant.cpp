#include "calib/diagnosis/time_constant.h"

#include <algorithm>
#include <cmath>

#include "calib/diagnosis/holdout.h"
#include "calib/joint/score_algebra.h"

namespace turncal {
namespace {

constexpr int points = 17;  // of a grid: an eighth of its width, where the parabola of the likelihood holds

struct Profile {
  std::vector<double> chi_square;       // with each time constant, over the same constant
  std::vector<Eigen::VectorXd> change;  // of the free parameters and effects
};

bool of(const EffectColumn& column, const std::string& name) { return column.entry->name == name; }

Profile profile(const DiagnosisModel& m, const std::string& name, const std::vector<double>& taus_s) {
  std::vector<int> own;
  std::vector<EffectColumn> columns;
  for (std::size_t k = 0; k < m.current.effects.size(); ++k)
    if (of(m.current.effects[k].column, name)) own.push_back(static_cast<int>(k));
  for (const double tau_s : taus_s)
    for (const int k : own) {
      columns.push_back(m.current.effects[static_cast<std::size_t>(k)].column);
      columns.back().tau_s = tau_s;
    }
  const EffectModel model = effect_model_of(m.current, m.recording.info.latitude_deg, columns);
  FilterSetup setup = m.current.setup;
  setup.narrow_columns = 0;
  const FilterResult pass = run_filter(m.recording, m.current.parameters, model, setup);
  Eigen::VectorXd ranges(parameter_count + model.columns);
  ranges.head(m.current.ranges.size()) = m.current.ranges;
  for (std::size_t k = 0; k < columns.size(); ++k)
    ranges[m.current.ranges.size() + static_cast<Eigen::Index>(k)] = absurd_magnitude(*columns[k].entry);
  // Without the effect.
  Eigen::VectorXd taken_off = Eigen::VectorXd::Zero(pass.gradient.size());
  for (const int k : own) taken_off[parameter_count + k] = -model.values[k];
  const Eigen::VectorXd gradient = pass.gradient + pass.information * taken_off;
  Profile result;
  for (std::size_t t = 0; t < taus_s.size(); ++t) {
    std::vector<int> subset = m.current.free;
    for (std::size_t k = 0; k < own.size(); ++k)
      std::replace(subset.begin(), subset.end(), parameter_count + own[k],
                   parameter_count + static_cast<int>(m.current.effects.size() + t * own.size() + k));
    const SubsetSolution solution = solve_subset(pass.information, gradient, subset, ranges);
    double fall = 0.0;
    for (std::size_t i = 0; i < subset.size(); ++i)
      fall += gradient[subset[i]] * solution.step[static_cast<Eigen::Index>(i)];
    result.chi_square.push_back(fall);
    result.change.push_back(solution.step);
  }
  return result;
}

std::vector<double> grid(double from_s, double to_s) {
  std::vector<double> taus_s;
  for (int k = 0; k < points; ++k) taus_s.push_back(from_s * std::pow(to_s / from_s, k / (points - 1.0)));
  return taus_s;
}

std::size_t best_of(const Profile& p) {
  return static_cast<std::size_t>(std::min_element(p.chi_square.begin(), p.chi_square.end()) - p.chi_square.begin());
}

double shortest(const EffectEntry& entry) { return 0.5 * entry.taus_s.front(); }
double longest(const EffectEntry& entry) { return 2.0 * entry.taus_s.back(); }

std::vector<std::string> timed(const DiagnosisModel& m) {
  std::vector<std::string> names;
  for (const std::string& name : names_of(m.chosen))
    if (!find_effect(name)->taus_s.empty()) names.push_back(name);
  return names;
}

}  // namespace

void find_time_constants(DiagnosisModel& m) {
  for (const std::string& name : timed(m)) {
    const EffectEntry& entry = *find_effect(name);
    double from_s = shortest(entry), to_s = longest(entry);
    for (int pass = 0; pass < 3; ++pass) {
      const std::vector<double> taus_s = grid(from_s, to_s);
      const Profile p = profile(m, name, taus_s);
      const std::size_t best = best_of(p);
      std::vector<EffectColumn> chosen = m.chosen;
      for (EffectColumn& column : chosen)
        if (of(column, name)) column.tau_s = taus_s[best];
      JointResult again = m.fit(chosen, m.current, &m.current.noise);
      if (!again.converged) break;
      m.chosen = std::move(chosen);
      m.current = std::move(again);
      from_s = taus_s[best > 0 ? best - 1 : 0];
      to_s = taus_s[std::min(best + 1, taus_s.size() - 1)];
    }
  }
}

std::vector<OpenTime> open_times(const DiagnosisModel& m) {
  std::vector<OpenTime> all;
  for (const std::string& name : timed(m)) {
    const EffectEntry& entry = *find_effect(name);
    double tau_s = 0.0;
    for (const EffectColumn& column : m.chosen)
      if (of(column, name)) tau_s = column.tau_s;
    double from_s = shortest(entry), to_s = longest(entry);
    OpenTime open{name, tau_s, 0.0, {}};
    // Once over all that it may be, then over what the data leave of that.
    for (int pass = 0; pass < 3; ++pass) {
      std::vector<double> taus_s = grid(from_s, to_s);
      taus_s.push_back(tau_s);
      Profile p = profile(m, name, taus_s);
      const Eigen::VectorXd here = p.change.back();
      const double least = *std::min_element(p.chi_square.begin(), p.chi_square.end());
      double sum = 0.0, square = 0.0;
      std::vector<double> weights;
      std::size_t first = points, last = 0;
      for (std::size_t k = 0; k < points; ++k) {
        weights.push_back(std::exp(-0.5 * (p.chi_square[k] - least)));
        sum += weights[k];
        square += weights[k] * std::pow(std::log(taus_s[k] / tau_s), 2);
        if (p.chi_square[k] - least > 20.0) continue;  // 4.5 sigma
        first = std::min(first, k);
        last = k;
      }
      if (sum > 0.0) open.log_sigma = std::sqrt(square / sum);
      open.shifts.clear();
      for (std::size_t k = 0; k < points && sum > 0.0; ++k)
        open.shifts.emplace_back(std::sqrt(weights[k] / sum) * (p.change[k] - here));
      if (first == points) {  // between two points of the grid
        const double step = std::pow(to_s / from_s, 1.0 / (points - 1.0));
        from_s = std::max(shortest(entry), tau_s / step);
        to_s = std::min(longest(entry), tau_s * step);
        continue;
      }
      from_s = taus_s[first > 0 ? first - 1 : 0];
      to_s = taus_s[std::min(last + 1, static_cast<std::size_t>(points - 1))];
    }
    all.push_back(std::move(open));
  }
  return all;
}

}  // namespace turncal
