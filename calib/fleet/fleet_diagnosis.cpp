#include "calib/fleet/fleet_diagnosis.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/fleet/fleet_scores.h"
#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

// ---- what is common to recordings: forward selection (1 and 2 of the header) ----

struct Found {
  std::size_t component = 0;
  Hypothesis hypothesis;
  FleetEstimate estimate;
  double log10_p = std::numeric_limits<double>::infinity();
};

struct Selected {
  Found found;
  FleetEffect effect;
};

std::string effect_of(const std::string& component) { return component.substr(0, component.find('.')); }

double log10_p(double z, double degrees) {
  const double p = f_tail(z * z, 1.0, std::max(degrees, 1.0));
  // Below the range of a double: the tail of the normal distribution.
  return p > 1e-290 ? std::log10(p) : -(z * z) / (2.0 * std::log(10.0));
}

// The best constant and the best change in time of one component.
struct BestOf {
  Found constant, shape;
};
BestOf best_of(const FleetScores& scores, const Hypotheses& hypotheses, std::size_t c, int factors) {
  BestOf best;
  // Tests each factor's hypotheses beside the unit scatter that all its levels leave; those of all units with the first factor.
  for (int f = factors == 0 ? -1 : 0; f < factors; ++f) {
    const Component component = component_of(scores, c, f);
    if (component.degrees < 3.0) continue;
    const auto look = [&](const HypothesisList& l, Found& found) {
      const std::vector<FleetEstimate> estimates = component.test(l.X);
      for (std::size_t k = 0; k < l.list.size(); ++k) {
        const Hypothesis& h = l.list[k];
        if (h.factor < 0 ? f > 0 || scores.is_parameter(c) : h.factor != f) continue;
        const double p = log10_p(estimates[k].z, component.degrees);
        if (p < found.log10_p) found = {c, h, estimates[k], p};
      }
    };
    look(hypotheses.constant, best.constant);
    look(hypotheses.shapes, best.shape);
  }
  return best;
}

// Sets the 95 % interval of the beginning, by the profile of z^2 over days.
void date_it(const FleetScores& scores, Found& found, FleetEffect& effect) {
  const Component component = component_of(scores, found.component, found.hypothesis.factor);
  double first = std::numeric_limits<double>::infinity(), last = -first;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const double day = scores.member(i).day;
    if (scores.level_of(found.hypothesis.factor)[i] != found.hypothesis.level || !std::isfinite(day)) continue;
    first = std::min(first, day);
    last = std::max(last, day);
  }
  constexpr int points = 400;
  std::vector<double> days;
  Eigen::MatrixXd X(scores.size(), points);
  Hypothesis h = found.hypothesis;
  for (int k = 0; k < points; ++k) {
    h.begin_day = first + (last - first) * k / points;
    days.push_back(h.begin_day);
    X.col(k) = column_of(scores, h);
  }
  const std::vector<FleetEstimate> profile = component.test(X);
  for (std::size_t k = 0; k < days.size(); ++k)
    if (std::abs(profile[k].z) > std::abs(found.estimate.z))
      found.estimate = profile[k], found.hypothesis.begin_day = days[k];
  const double least = found.estimate.z * found.estimate.z - fleet_limits.interval;
  effect.begin_day = effect.begin_low = effect.begin_high = found.hypothesis.begin_day;
  for (std::size_t k = 0; k < days.size(); ++k) {
    if (profile[k].z * profile[k].z < least) continue;
    effect.begin_low = std::min(effect.begin_low, days[k]);
    effect.begin_high = std::max(effect.begin_high, days[k] + (last - first) / points);
  }
}

void apply(FleetScores& scores, const Found& found, double value) {
  const Eigen::VectorXd x = column_of(scores, found.hypothesis);
  for (std::size_t i = 0; i < scores.size(); ++i)
    if (x[i] != 0.0) scores.subtract(i, found.component, value * x[i]);
}

// Returns other effects that explain about as much in this place, by the scores before it was removed.
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
      const Hypothesis& h = other->hypothesis;
      const bool here = h.factor == found.hypothesis.factor && h.level == found.hypothesis.level;
      if (other->estimate.z * other->estimate.z < least || (same && here)) continue;
      std::string text = same ? scores.components()[c] : name;
      if (!here && h.factor < 0) text += " of all";
      if (!here && h.factor >= 0) text += " of " + factors[h.factor] + " " + scores.levels(h.factor)[h.level];
      if (std::ranges::find(rivals, text) == rivals.end()) rivals.push_back(text);
    }
  }
  return rivals;
}

// Estimates each chosen effect again beside the others.
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

// On return the effects found are removed from the scores, and d.tests is set.
std::vector<Selected> select_common(FleetScores& scores, const std::vector<std::string>& factors, bool with_shapes,
                                    FleetDiagnosis& d) {
  std::vector<Selected> chosen;
  const Hypotheses hypotheses = all_hypotheses(scores, factors);
  const std::size_t components = scores.components().size();
  const std::size_t constants = components * hypotheses.constant.list.size();
  const std::size_t shapes = components * hypotheses.shapes.list.size();
  d.tests = constants + shapes;
  const double limit = std::log10(0.5 * fleet_limits.false_alarm);
  while (std::ssize(chosen) < fleet_limits.most_effects) {
    std::vector<BestOf> best;
    for (std::size_t c = 0; c < components; ++c) best.push_back(best_of(scores, hypotheses, c, int(factors.size())));
    const auto strongest = [&](auto member, std::size_t tests) {
      Found found = *std::ranges::min_element(best, [&](const BestOf& a, const BestOf& b) {
        return (a.*member).log10_p < (b.*member).log10_p;
      }).*member;
      found.log10_p += std::log10(double(tests));
      return found;
    };
    const Found constant = strongest(&BestOf::constant, constants);
    const Found shape = strongest(&BestOf::shape, std::max(shapes, components));
    const bool changes =
        with_shapes && shape.log10_p < limit &&
        shape.estimate.z * shape.estimate.z > constant.estimate.z * constant.estimate.z + fleet_limits.shape_margin;
    Found found = changes ? shape : constant;
    if (found.log10_p >= limit) break;
    FleetEffect effect;
    effect.component = scores.components()[found.component];
    if (const int f = found.hypothesis.factor; f >= 0) {
      effect.factor = factors[f];
      effect.level = scores.levels(f)[found.hypothesis.level];
    }
    effect.shape = found.hypothesis.shape;
    effect.log10_p = found.log10_p;
    effect.rivals = rivals_of(scores, best, found, factors);
    effect.recordings = (column_of(scores, found.hypothesis).array() != 0.0).count();
    if (changes) date_it(scores, found, effect);
    apply(scores, found, found.estimate.value);
    chosen.push_back({found, effect});
    settle(scores, chosen);
  }
  return chosen;
}

// ---- units that stand out (3) ----

struct Deviation {
  std::size_t member = 0, component = 0;
  FleetEstimate estimate;
};

double median_of(std::vector<double> values) { return values.empty() ? 0.0 : median(values); }

// Returns the worst component of every recording, as its deviation from what is common; not of parameters, whose zero is unknown.
std::vector<Deviation> worst_deviations(const FleetScores& scores) {
  std::vector<Deviation> worst(scores.size());
  for (std::size_t c = 0; c < scores.effects(); ++c) {
    const ComponentData d = scores.data(c);
    std::vector<double> away, variance;
    for (Eigen::Index i = 0; i < d.y.size(); ++i) {
      if (!std::isfinite(d.v[i])) continue;
      away.push_back(std::abs(d.y[i]));
      variance.push_back(d.v[i]);
    }
    if (away.size() < 4) continue;
    const double scatter = 1.4826 * median_of(away);
    const double more = std::max(0.0, scatter * scatter - median_of(variance));
    for (std::size_t i = 0; i < worst.size(); ++i) {
      const double s = std::sqrt(d.v[i] + more), z = d.y[i] / s;
      if (std::isfinite(s) && std::abs(z) > std::abs(worst[i].estimate.z)) worst[i] = {i, c, {d.y[i], s, z}};
    }
  }
  return worst;
}

double unit_limit(const FleetScores& scores) {
  return chi_square_1_limit(fleet_limits.unit_false_alarm / double(scores.size() * scores.effects()));
}

std::vector<Deviation> set_units_aside(FleetScores& scores) {
  std::vector<Deviation> all;
  const double limit = unit_limit(scores);
  for (int round = 0; round < fleet_limits.most_of_unit; ++round) {
    const std::size_t before = all.size();
    for (const Deviation& w : worst_deviations(scores)) {
      if (w.estimate.z * w.estimate.z < limit) continue;
      scores.subtract(w.member, w.component, w.estimate.value);
      scores.set_aside(w.member, w.component, true);
      all.push_back(w);
    }
    if (all.size() == before) break;
  }
  return all;
}

struct Explanation {
  std::vector<Selected> chosen;
  std::vector<Deviation> units;
};

// Units that stand out hide common effects and can imitate them; a common effect makes all units of a station stand
// out. So the two searches alternate until nothing changes. Common effects come first, with changes in time or without.
Explanation search(FleetScores& scores, const std::vector<std::string>& factors, bool with_shapes, FleetDiagnosis& d) {
  std::vector<Selected> chosen = select_common(scores, factors, with_shapes, d);
  std::vector<Deviation> units = set_units_aside(scores);
  const bool settled = with_shapes && units.empty();  // the same would be selected again
  for (int round = 0; round < 4 && !settled; ++round) {
    for (const Selected& s : chosen) apply(scores, s.found, -s.found.estimate.value);
    chosen = select_common(scores, factors, true, d);
    for (auto w = units.rbegin(); w != units.rend(); ++w) {
      scores.set_aside(w->member, w->component, false);
      scores.subtract(w->member, w->component, -w->estimate.value);
    }
    std::vector<Deviation> again = set_units_aside(scores);
    const bool same = std::equal(
        again.begin(), again.end(), units.begin(), units.end(),
        [](const Deviation& a, const Deviation& b) { return a.member == b.member && a.component == b.component; });
    units = std::move(again);
    if (same) break;
  }
  return {std::move(chosen), std::move(units)};
}

// Returns the fall of chi-square by an explanation, less what each of its parts must reach to be significant by itself.
// Parameters do not count: they have no chi-square, and follow the effects.
double worth(const Explanation& e, const FleetScores& scores, const FleetDiagnosis& d) {
  const auto effects =
      std::ranges::count_if(e.chosen, [&](const Selected& s) { return !scores.is_parameter(s.found.component); });
  return scores.explained() - double(e.units.size()) * unit_limit(scores) -
         double(effects) * chi_square_1_limit(fleet_limits.false_alarm / double(d.tests));
}

void summarise(const FleetScores& scores, int count, FleetDiagnosis& d) {
  std::vector<std::vector<int>> factors;
  for (int f = 0; f < count; ++f) factors.push_back(scores.level_of(f));
  for (std::size_t c = 0; c < scores.components().size(); ++c) {
    const Component one = component_of(scores, c, -1);
    ComponentSummary s;
    s.component = scores.components()[c];
    std::vector<double> sigmas;
    for (const double v : one.data.v)
      if (std::isfinite(v)) sigmas.push_back(std::sqrt(v));
    s.one_unit = median_of(sigmas);
    if (sigmas.size() >= 3) {
      const std::vector<double> variances = variance_components(one.data, factors);
      s.unit_scatter = std::sqrt(variances.front());
      for (int f = 0; f < count; ++f) s.factor_scatter.push_back(std::sqrt(variances[f + 1]));
    }
    for (int f = 0; f < count; ++f) s.levels.push_back(component_of(scores, c, f).test(level_columns(scores, f)));
    d.components.push_back(std::move(s));
  }
}

// Tests what is left at each level, in directions with independent noise: sum of z^2 ~ chi-square.
void test_what_is_left(const FleetScores& scores, const std::vector<std::string>& factors, FleetDiagnosis& d) {
  if (scores.effects() == 0) return;
  const Eigen::MatrixXd Q = scores.information();
  const Eigen::VectorXd scale = Q.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * Q * scale.asDiagonal());
  const Eigen::Index directions = (eigen.values.array() > fleet_limits.open_direction).count();
  const std::vector<ComponentData> sums = scores.sums(scale.asDiagonal() * eigen.vectors.rightCols(directions));
  double tries = 0.0;
  for (const std::vector<std::string>& levels : d.levels) tries += double(levels.size());
  for (int f = 0; f < std::ssize(factors); ++f) {
    const Eigen::MatrixXd X = level_columns(scores, f);
    Eigen::ArrayXd square = Eigen::ArrayXd::Zero(X.cols()), degrees = square;
    for (const ComponentData& data : sums) {
      const std::vector<FleetEstimate> estimates = Component(data, X, false).test(X);
      for (std::size_t level = 0; level < estimates.size(); ++level) {
        if (!(estimates[level].sigma > 0.0)) continue;
        square[level] += estimates[level].z * estimates[level].z;
        degrees[level] += 1.0;
      }
    }
    for (Eigen::Index level = 0; level < X.cols(); ++level) {
      const double p = std::log10(std::max(chi_square_tail(square[level], degrees[level]), 1e-300)) + std::log10(tries);
      if (p >= d.lack_of_fit_log10_p && !d.lack_of_fit_at.empty()) continue;
      d.lack_of_fit_log10_p = std::min(p, 0.0);
      d.lack_of_fit_at = factors[f] + " " + scores.levels(f)[level];
    }
  }
}

}  // namespace

const char* to_string(FleetShape shape) {
  static constexpr const char* names[] = {"constant", "step", "ramp"};
  return names[std::size_t(shape)];
}

FleetDiagnosis diagnose_fleet(const std::vector<FleetMember>& members, const FleetOptions& options) {
  const std::vector<std::string>& factors = options.factors;
  FleetScores scores(members, factors.size());
  FleetDiagnosis d;
  for (std::size_t f = 0; f < factors.size(); ++f) d.levels.push_back(scores.levels(f));
  Explanation best = search(scores, factors, true, d);
  // Units that stand out can imitate a change in time, and the end of a steep ramp such units: the other order is tried as well.
  if (!best.units.empty()) {
    FleetScores other_scores(members, factors.size());
    Explanation other = search(other_scores, factors, false, d);
    if (worth(other, other_scores, d) > worth(best, scores, d) - fleet_limits.shape_margin) {
      scores = std::move(other_scores);
      best = std::move(other);
    }
  }
  settle(scores, best.chosen);
  for (Selected& s : best.chosen) {
    static_cast<FleetEstimate&>(s.effect) = s.found.estimate;
    d.effects.push_back(std::move(s.effect));
  }
  for (const Deviation& w : best.units)
    d.units.push_back({w.estimate, scores.given(w.member), scores.components()[w.component]});
  if (options.summary) summarise(scores, int(factors.size()), d);
  test_what_is_left(scores, factors, d);
  return d;
}

std::string cause_at_station(const std::string& component) {
  struct Cause {
    std::vector<std::string> begins;
    const char* text;
  };
  static const Cause causes[] = {
      {{"earth_rate"}, "the latitude of the station, or a table that turns by itself"},
      {{"sample_period"}, "the clock that counts the samples"},
      {{"gyro_magnetic"}, "a magnetic field at the fixture"},
      {{"gyro_accel_flexure"}, "a fixture that bends"},
      {{"accel_size_effect"}, "where on the fixture units are mounted"},
      {{"post_rotation_relaxation"}, "a table that settles after a turn"},
      {{"accel_rectification"}, "a table that shakes while it turns"},
      {{"accel_creep"}, "a fixture that gives way under load"},
      {{"gyro_bias_temperature", "accel_bias_temperature"}, "how the station heats the units"},
      {{"gyro_warm_up", "accel_warm_up", "gyro_scale_warm_up", "accel_scale_warm_up"},
       "how long units are on before the run"},
      {{"gyro_bias_drift", "accel_bias_drift"}, "temperature of the station during the run"},
      {{"parameter a11", "parameter a22", "parameter a33"}, "gravity of the site"},
      {{"parameter n"}, "the clock that counts the samples, or how units are mounted"},
      {{"parameter N"}, "the latitude of the station, or a magnetic field"},
      {{"parameter A"}, "vibration at the station"}};
  for (const Cause& cause : causes)
    for (const std::string& begin : cause.begins)
      if (component.starts_with(begin)) return cause.text;
  return {};
}

}  // namespace turncal
