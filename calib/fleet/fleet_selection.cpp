#include "calib/fleet/fleet_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/model/limits.h"
#include "calib/statistics/distributions.h"

namespace turncal {
namespace {

std::string effect_of(const std::string& component) { return component.substr(0, component.find('.')); }

double log10_p(double z, double degrees, double tests) {
  const double p = f_tail(z * z, 1.0, std::max(degrees, 1.0));
  // Beyond what a double holds: the tail of the normal distribution.
  const double tail = p > 1e-290 ? std::log10(p) : -(z * z) / (2.0 * std::log(10.0));
  return tail + std::log10(tests);
}

// The best of both kinds of one component.
struct BestOf {
  Found constant, shape;
};
BestOf best_of(const FleetScores& scores, const Hypotheses& hypotheses, std::size_t c, std::size_t factors) {
  BestOf best;
  best.constant.log10_p = best.shape.log10_p = std::numeric_limits<double>::infinity();
  // Each factor's hypotheses beside the scatter of units that all its levels leave; those of all with the first factor's.
  for (int f = factors == 0 ? -1 : 0; f < static_cast<int>(factors); ++f) {
    const Component component = component_of(scores, c, f);
    if (component.degrees < 3.0) continue;
    const auto look = [&](const HypothesisList& l, Found& found) {
      const std::vector<Estimate> estimates = component.test(l.X);
      for (std::size_t k = 0; k < l.list.size(); ++k) {
        const Hypothesis& h = l.list[k];
        if (h.factor < 0 ? f > 0 || scores.is_parameter(c) : h.factor != f) continue;
        const double p = log10_p(estimates[k].z, component.degrees, 1.0);
        if (p < found.log10_p) found = {c, h, estimates[k], p};
      }
    };
    look(hypotheses.constant, best.constant);
    look(hypotheses.shapes, best.shape);
  }
  return best;
}

// 95 % of when it began, by the profile of z^2 over days.
void date_it(const FleetScores& scores, Found& found, FleetEffect& effect) {
  const Component component = component_of(scores, found.component, found.hypothesis.factor);
  double first = std::numeric_limits<double>::infinity(), last = -first;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    if (scores.level_of(static_cast<std::size_t>(found.hypothesis.factor))[i] != found.hypothesis.level ||
        !std::isfinite(scores.member(i).day))
      continue;
    first = std::min(first, scores.member(i).day);
    last = std::max(last, scores.member(i).day);
  }
  constexpr int points = 400;
  std::vector<double> days;
  Eigen::MatrixXd X(static_cast<Eigen::Index>(scores.size()), points);
  Hypothesis h = found.hypothesis;
  for (int k = 0; k < points; ++k) {
    h.begin_day = first + (last - first) * k / points;
    days.push_back(h.begin_day);
    X.col(k) = column_of(scores, h);
  }
  const std::vector<Estimate> profile = component.test(X);
  for (std::size_t k = 0; k < days.size(); ++k)
    if (std::abs(profile[k].z) > std::abs(found.estimate.z))
      found.estimate = profile[k], found.hypothesis.begin_day = days[k];
  const double least = found.estimate.z * found.estimate.z - fleet_limits.interval;
  effect.begin_day = effect.begin_low = effect.begin_high = found.hypothesis.begin_day;
  for (std::size_t k = 0; k < days.size(); ++k) {
    const double day = days[k];
    if (profile[k].z * profile[k].z < least) continue;
    effect.begin_low = std::min(effect.begin_low, day);
    effect.begin_high = std::max(effect.begin_high, day + (last - first) / points);
  }
}

void apply(FleetScores& scores, const Found& found, double value) {
  const Eigen::VectorXd x = column_of(scores, found.hypothesis);
  for (std::size_t i = 0; i < scores.size(); ++i)
    if (const double own = x[static_cast<Eigen::Index>(i)]; own != 0.0)
      scores.subtract(i, found.component, value * own);
}

// Other effects that would do about as well where this one is, with the scores from before it was taken off.
std::vector<std::string> rivals_of(const FleetScores& scores, const std::vector<BestOf>& best, const Found& found,
                                   const std::vector<std::string>& factors) {
  std::vector<std::string> rivals;
  const double least = found.estimate.z * found.estimate.z - SelectionLimits{}.bic_margin;
  const std::string own = effect_of(scores.components()[found.component]);
  for (std::size_t c = 0; c < best.size(); ++c) {
    const std::string name = effect_of(scores.components()[c]);
    const bool same = c == found.component;
    if (!same && name == own) continue;
    for (const Found* other : {&best[c].constant, &best[c].shape}) {
      if (other->estimate.z * other->estimate.z < least) continue;
      const Hypothesis& h = other->hypothesis;
      const bool here = h.factor == found.hypothesis.factor && h.level == found.hypothesis.level;
      if (same && here) continue;
      std::string text = same ? scores.components()[c] : name;
      if (!here) {
        const auto f = static_cast<std::size_t>(std::max(h.factor, 0));
        text +=
            h.factor < 0 ? " of all" : " of " + factors[f] + " " + scores.levels(f)[static_cast<std::size_t>(h.level)];
      }
      if (std::find(rivals.begin(), rivals.end(), text) == rivals.end()) rivals.push_back(text);
    }
  }
  return rivals;
}

}  // namespace

void settle(FleetScores& scores, std::vector<Selected>& chosen) {
  for (int round = 0; round < 3; ++round)
    for (Selected& s : chosen) {
      apply(scores, s.found, -s.found.estimate.value);
      s.found.estimate = component_of(scores, s.found.component, s.found.hypothesis.factor)
                             .test(column_of(scores, s.found.hypothesis))
                             .front();
      apply(scores, s.found, s.found.estimate.value);
    }
}

void put_back(FleetScores& scores, const std::vector<Selected>& chosen) {
  for (const Selected& s : chosen) apply(scores, s.found, -s.found.estimate.value);
}

std::vector<Selected> select_common(FleetScores& scores, const FleetOptions& options, bool with_shapes,
                                    FleetDiagnosis& d) {
  std::vector<Selected> chosen;
  const Hypotheses hypotheses = all_hypotheses(scores, options);
  const double count = static_cast<double>(scores.components().size());
  const double constants = count * static_cast<double>(hypotheses.constant.list.size());
  const double shapes = count * static_cast<double>(std::max<std::size_t>(hypotheses.shapes.list.size(), 1));
  d.tests = static_cast<std::size_t>(constants) + hypotheses.shapes.list.size() * scores.components().size();
  const double limit = std::log10(0.5 * options.false_alarm);
  while (static_cast<int>(chosen.size()) < options.max_effects) {
    std::vector<BestOf> best;
    for (std::size_t c = 0; c < scores.components().size(); ++c)
      best.push_back(best_of(scores, hypotheses, c, options.factors.size()));
    const auto strongest = [&](auto member) {
      return *std::min_element(best.begin(), best.end(), [&](const BestOf& a, const BestOf& b) {
        return (a.*member).log10_p < (b.*member).log10_p;
      }).*member;
    };
    Found constant = strongest(&BestOf::constant), shape = strongest(&BestOf::shape);
    constant.log10_p += std::log10(constants);
    shape.log10_p += std::log10(shapes);
    const bool changes =
        with_shapes && shape.log10_p < limit &&
        shape.estimate.z * shape.estimate.z > constant.estimate.z * constant.estimate.z + options.shape_margin;
    Found found = changes ? shape : constant;
    if (found.log10_p >= limit) break;
    FleetEffect effect;
    effect.component = scores.components()[found.component];
    if (found.hypothesis.factor >= 0) {
      const auto f = static_cast<std::size_t>(found.hypothesis.factor);
      effect.factor = options.factors[f];
      effect.level = scores.levels(f)[static_cast<std::size_t>(found.hypothesis.level)];
    }
    effect.shape = found.hypothesis.shape;
    effect.log10_p = found.log10_p;
    effect.rivals = rivals_of(scores, best, found, options.factors);
    effect.recordings = static_cast<std::size_t>((column_of(scores, found.hypothesis).array() != 0.0).count());
    if (changes) date_it(scores, found, effect);
    apply(scores, found, found.estimate.value);
    chosen.push_back({found, effect});
    settle(scores, chosen);
  }
  return chosen;
}

}  // namespace turncal
