#include "calib/fleet/fleet_diagnosis.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/diagnosis/diagnosis_limits.h"
#include "calib/fleet/fleet_scores.h"
#include "calib/statistics/distributions.h"
#include "calib/statistics/linear_algebra.h"
#include "calib/statistics/median.h"

namespace turncal {
namespace {

constexpr int most_begins = 24;            // of a step or ramp that are tried
constexpr std::size_t least_of_shape = 8;  // recordings at a level before a change in time is looked for
constexpr double interval_95 = 3.84;       // of z^2

std::string effect_of(const std::string& component) { return component.substr(0, component.find('.')); }

double log10_p(double z, double degrees, double tests) {
  const double p = f_tail(z * z, 1.0, std::max(degrees, 1.0));
  // Beyond what a double holds: the tail of the normal distribution.
  const double tail = p > 1e-290 ? std::log10(p) : -(z * z) / (2.0 * std::log(10.0));
  return tail + std::log10(tests);
}

// What is common: x of every recording, and what it is called.
struct Hypothesis {
  int factor = -1;  // -1: all
  int level = 0;
  FleetShape shape = FleetShape::constant;
  double begin_day = 0.0;
};

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

Eigen::VectorXd column(const FleetScores& scores, const Hypothesis& h) {
  Eigen::VectorXd x(static_cast<Eigen::Index>(scores.size()));
  for (std::size_t i = 0; i < scores.size(); ++i) x[static_cast<Eigen::Index>(i)] = at(scores, h, i);
  return x;
}

Eigen::MatrixXd indicators(const FleetScores& scores, int factor) {
  const auto rows = static_cast<Eigen::Index>(scores.size());
  if (factor < 0) return Eigen::MatrixXd::Ones(rows, 1);
  const std::vector<int>& level = scores.level_of(static_cast<std::size_t>(factor));
  const auto count = static_cast<Eigen::Index>(scores.levels(static_cast<std::size_t>(factor)).size());
  Eigen::MatrixXd X = Eigen::MatrixXd::Zero(rows, count);
  for (Eigen::Index i = 0; i < rows; ++i) X(i, level[static_cast<std::size_t>(i)]) = 1.0;
  return X;
}

// Of those of the columns that have data.
Eigen::MatrixXd used(const ComponentData& data, const Eigen::MatrixXd& X) {
  std::vector<int> columns;
  for (Eigen::Index k = 0; k < X.cols(); ++k)
    if ((X.col(k).array().abs() / data.v.array()).sum() > 0.0) columns.push_back(static_cast<int>(k));
  return X(Eigen::all, columns);
}

struct Estimate {
  double value = 0.0, sigma = 0.0, z = 0.0;
};

// One component, ready for any x: data and the scatter of units.
struct Component {
  Component(ComponentData the_data, const Eigen::MatrixXd& beside, bool others)
      : data(std::move(the_data)), from_others(others), weights(data, 0.0) {
    const Eigen::MatrixXd X = used(data, beside);
    const auto says = static_cast<double>((data.v.array() < std::numeric_limits<double>::infinity()).count());
    degrees = says - static_cast<double>(X.cols());
    if (X.cols() == 0 || degrees < 1.0) return;
    variance = unit_variance(data, X);
    weights = UnitWeights(data, variance);
  }
  ComponentData data;
  double variance = 0.0;
  bool from_others = false;  // a parameter: from the mean of those without x
  double degrees = 0.0;
  UnitWeights weights;

  // Of each column by itself.
  std::vector<Estimate> test(const Eigen::MatrixXd& X) const {
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
};

Component component_of(const FleetScores& scores, std::size_t c, int factor) {
  return {scores.data(c), indicators(scores, factor), scores.is_parameter(c)};
}

std::vector<double> begins(const FleetScores& scores, std::size_t factor, int level) {
  std::vector<double> days;
  for (std::size_t i = 0; i < scores.size(); ++i)
    if (scores.level_of(factor)[i] == level && std::isfinite(scores.member(i).day))
      days.push_back(scores.member(i).day);
  if (days.size() < 2 * least_of_shape) return {};
  std::sort(days.begin(), days.end());
  std::vector<double> result;
  for (int k = 1; k <= most_begins; ++k) {  // between recordings, some on either side
    const std::size_t i =
        std::clamp<std::size_t>(days.size() * static_cast<std::size_t>(k) / (most_begins + 1), 2, days.size() - 3);
    const double day = 0.5 * (days[i - 1] + days[i]);
    if (days[i] > days[i - 1] && (result.empty() || day > result.back())) result.push_back(day);
  }
  return result;
}

struct Found {
  std::size_t component = 0;
  Hypothesis hypothesis;
  Estimate estimate;
  double log10_p = 0.0;
};

// Every hypothesis, and its x as a column.
struct HypothesisList {
  std::vector<Hypothesis> list;
  Eigen::MatrixXd X;
};
struct Hypotheses {
  HypothesisList constant, shapes;
};
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
      l->X.col(static_cast<Eigen::Index>(k)) = column(scores, l->list[k]);
  }
  return h;
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
    X.col(k) = column(scores, h);
  }
  const std::vector<Estimate> profile = component.test(X);
  for (std::size_t k = 0; k < days.size(); ++k)
    if (std::abs(profile[k].z) > std::abs(found.estimate.z))
      found.estimate = profile[k], found.hypothesis.begin_day = days[k];
  const double least = found.estimate.z * found.estimate.z - interval_95;
  effect.begin_day = effect.begin_low = effect.begin_high = found.hypothesis.begin_day;
  for (std::size_t k = 0; k < days.size(); ++k) {
    const double day = days[k];
    if (profile[k].z * profile[k].z < least) continue;
    effect.begin_low = std::min(effect.begin_low, day);
    effect.begin_high = std::max(effect.begin_high, day + (last - first) / points);
  }
}

void apply(FleetScores& scores, const Found& found, double value) {
  for (std::size_t i = 0; i < scores.size(); ++i)
    if (const double x = at(scores, found.hypothesis, i); x != 0.0) scores.take_off(i, found.component, value * x);
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

struct Selected {
  Found found;
  FleetEffect effect;
};

// Of effects already chosen: each again beside the others.
void settle(FleetScores& scores, std::vector<Selected>& chosen) {
  for (int round = 0; round < 3; ++round)
    for (Selected& s : chosen) {
      apply(scores, s.found, -s.found.estimate.value);
      s.found.estimate = component_of(scores, s.found.component, s.found.hypothesis.factor)
                             .test(column(scores, s.found.hypothesis))
                             .front();
      apply(scores, s.found, s.found.estimate.value);
    }
}

std::vector<Selected> select(FleetScores& scores, const FleetOptions& options, bool with_shapes, FleetDiagnosis& d) {
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
    effect.recordings = static_cast<std::size_t>((column(scores, found.hypothesis).array() != 0.0).count());
    if (changes) date_it(scores, found, effect);
    apply(scores, found, found.estimate.value);
    chosen.push_back({found, effect});
    settle(scores, chosen);
  }
  return chosen;
}

struct Deviation {
  std::size_t member = 0, component = 0;
  double value = 0.0, sigma = 0.0, z = 0.0;
};

double median_of(std::vector<double> values) { return values.empty() ? 0.0 : median(values); }

// Of every recording, from what is common to it: its worst component. Not of parameters, which have no zero.
std::vector<Deviation> worst_deviations(const FleetScores& scores) {
  std::vector<Deviation> worst(scores.size());
  for (std::size_t c = 0; c < scores.effects(); ++c) {
    const ComponentData d = scores.data(c);
    std::vector<double> away, sigma;
    for (Eigen::Index i = 0; i < d.y.size(); ++i) {
      if (!(d.v[i] < std::numeric_limits<double>::infinity())) continue;
      away.push_back(std::abs(d.y[i]));
      sigma.push_back(d.v[i]);
    }
    if (away.size() < 4) continue;
    const double scatter = 1.4826 * median_of(away);
    const double more = std::max(0.0, scatter * scatter - median_of(sigma));
    for (Eigen::Index i = 0; i < d.y.size(); ++i) {
      const double s = std::sqrt(d.v[i] + more), z = d.y[i] / s;
      Deviation& w = worst[static_cast<std::size_t>(i)];
      if (std::isfinite(s) && std::abs(z) > std::abs(w.z)) w = {static_cast<std::size_t>(i), c, d.y[i], s, z};
    }
  }
  return worst;
}

std::vector<Deviation> set_units_aside(FleetScores& scores, const FleetOptions& options) {
  std::vector<Deviation> all;
  const double limit =
      chi_square_1_limit(options.unit_false_alarm / static_cast<double>(scores.size() * scores.effects()));
  for (int round = 0; round < options.max_of_unit; ++round) {
    bool any = false;
    for (const Deviation& w : worst_deviations(scores)) {
      if (w.z * w.z < limit) continue;
      scores.take_off(w.member, w.component, w.value);
      scores.set_aside(w.member, w.component, true);
      all.push_back(w);
      any = true;
    }
    if (!any) break;
  }
  return all;
}

void restore(FleetScores& scores, const std::vector<Deviation>& units) {
  for (auto w = units.rbegin(); w != units.rend(); ++w) {
    scores.set_aside(w->member, w->component, false);
    scores.take_off(w->member, w->component, -w->value);
  }
}

void summarise(const FleetScores& scores, const FleetOptions& options, FleetDiagnosis& d) {
  std::vector<std::vector<int>> factors;
  for (std::size_t f = 0; f < options.factors.size(); ++f) factors.push_back(scores.level_of(f));
  for (std::size_t c = 0; c < scores.components().size(); ++c) {
    const Component one = component_of(scores, c, -1);
    ComponentSummary s;
    s.component = scores.components()[c];
    std::vector<double> sigmas;
    for (Eigen::Index i = 0; i < one.data.v.size(); ++i)
      if (one.data.v[i] < std::numeric_limits<double>::infinity()) sigmas.push_back(std::sqrt(one.data.v[i]));
    s.recordings = sigmas.size();
    s.one_unit = median_of(sigmas);
    if (s.recordings >= 3) {
      std::vector<double> variances = variance_components(one.data, factors);
      s.unit_scatter = std::sqrt(variances.front());
      for (std::size_t f = 0; f < factors.size(); ++f) s.factor_scatter.push_back(std::sqrt(variances[f + 1]));
      const Component whole(one.data, indicators(scores, -1), false);
      const Estimate mean = whole.test(indicators(scores, -1)).front();
      s.mean = mean.value, s.mean_sigma = mean.sigma;
    }
    for (std::size_t f = 0; f < factors.size(); ++f) {
      std::vector<ComponentLevel> levels;
      for (const Estimate& e :
           component_of(scores, c, static_cast<int>(f)).test(indicators(scores, static_cast<int>(f))))
        levels.push_back({e.value, e.sigma, e.z});
      s.levels.push_back(std::move(levels));
    }
    d.components.push_back(std::move(s));
  }
}

// What is left at each level, in directions that do not share their noise: sum of z^2 ~ chi-square.
void test_what_is_left(const FleetScores& scores, const FleetOptions& options, FleetDiagnosis& d) {
  if (scores.effects() == 0) return;
  const Eigen::MatrixXd Q = scores.information();
  const Eigen::VectorXd scale = Q.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * Q * scale.asDiagonal());
  constexpr double floor = 0.01;
  struct Level {
    double square = 0.0, degrees = 0.0;
  };
  std::vector<std::vector<Level>> sums(options.factors.size());
  double tries = 0.0;
  for (std::size_t f = 0; f < sums.size(); ++f) {
    sums[f].resize(scores.levels(f).size());
    tries += static_cast<double>(sums[f].size());
  }
  const Eigen::Index directions = (eigen.values.array() > floor).count();
  for (const ComponentData& data : scores.sums(scale.asDiagonal() * eigen.vectors.rightCols(directions))) {
    for (std::size_t f = 0; f < sums.size(); ++f) {
      const Component direction(data, indicators(scores, static_cast<int>(f)), false);
      const std::vector<Estimate> estimates = direction.test(indicators(scores, static_cast<int>(f)));
      for (std::size_t level = 0; level < sums[f].size(); ++level) {
        const Estimate& e = estimates[level];
        if (!(e.sigma > 0.0)) continue;
        sums[f][level].square += e.z * e.z;
        sums[f][level].degrees += 1.0;
      }
    }
  }
  for (std::size_t f = 0; f < sums.size(); ++f)
    for (std::size_t level = 0; level < sums[f].size(); ++level) {
      const double p = std::log10(std::max(chi_square_tail(sums[f][level].square, sums[f][level].degrees), 1e-300)) +
                       std::log10(tries);
      if (p >= d.lack_of_fit_log10_p && !d.lack_of_fit_at.empty()) continue;
      d.lack_of_fit_log10_p = std::min(p, 0.0);
      d.lack_of_fit_at = options.factors[f] + " " + scores.levels(f)[level];
    }
}

}  // namespace

const char* to_string(FleetShape shape) {
  switch (shape) {
    case FleetShape::constant: return "constant";
    case FleetShape::step: return "step";
    case FleetShape::ramp: return "ramp";
  }
  return "?";
}

FleetDiagnosis diagnose_fleet(const std::vector<FleetMember>& members, const FleetOptions& options) {
  FleetScores scores(members, options.factors.size());
  FleetDiagnosis d;
  for (std::size_t f = 0; f < options.factors.size(); ++f) d.levels.push_back(scores.levels(f));
  // Units that stand out hide what is common, and may pass for it; what is common makes all units of a station stand out. So one is
  // looked for beside the other until nothing changes, and first of all what is common and does not change.
  std::vector<Selected> chosen = select(scores, options, false, d);
  std::vector<Deviation> units = set_units_aside(scores, options);
  for (int round = 0; round < 4; ++round) {
    for (const Selected& s : chosen) apply(scores, s.found, -s.found.estimate.value);
    chosen = select(scores, options, true, d);
    restore(scores, units);
    std::vector<Deviation> again = set_units_aside(scores, options);
    const bool same = again.size() == units.size() &&
                      std::equal(again.begin(), again.end(), units.begin(), [](const Deviation& a, const Deviation& b) {
                        return a.member == b.member && a.component == b.component;
                      });
    units = std::move(again);
    if (same) break;
  }
  settle(scores, chosen);
  for (const Selected& s : chosen) {
    FleetEffect effect = s.effect;
    effect.value = s.found.estimate.value;
    effect.sigma = s.found.estimate.sigma;
    effect.z = s.found.estimate.z;
    d.effects.push_back(std::move(effect));
  }
  for (const Deviation& w : units)
    d.units.push_back({scores.given(w.member), scores.components()[w.component], w.value, w.sigma, w.z});
  summarise(scores, options, d);
  test_what_is_left(scores, options, d);
  return d;
}

std::string cause_at_station(const std::string& component) {
  struct Cause {
    const char* begin;
    const char* text;
  };
  static constexpr Cause causes[] = {{"earth_rate", "the latitude of the station, or a table that turns by itself"},
                                     {"sample_period", "the clock that counts the samples"},
                                     {"gyro_magnetic", "a magnetic field at the fixture"},
                                     {"gyro_accel_flexure", "a fixture that bends"},
                                     {"accel_size_effect", "where on the fixture units are mounted"},
                                     {"post_rotation_relaxation", "a table that settles after a turn"},
                                     {"accel_rectification", "a table that shakes while it turns"},
                                     {"accel_creep", "a fixture that gives way under load"},
                                     {"gyro_bias_temperature", "how the station heats the units"},
                                     {"accel_bias_temperature", "how the station heats the units"},
                                     {"gyro_warm_up", "how long units are on before the run"},
                                     {"accel_warm_up", "how long units are on before the run"},
                                     {"gyro_scale_warm_up", "how long units are on before the run"},
                                     {"accel_scale_warm_up", "how long units are on before the run"},
                                     {"gyro_bias_drift", "temperature of the station during the run"},
                                     {"accel_bias_drift", "temperature of the station during the run"},
                                     {"parameter a11", "gravity of the site"},
                                     {"parameter a22", "gravity of the site"},
                                     {"parameter a33", "gravity of the site"},
                                     {"parameter n", "the clock that counts the samples, or how units are mounted"},
                                     {"parameter N", "the latitude of the station, or a magnetic field"},
                                     {"parameter A", "vibration at the station"}};
  for (const Cause& cause : causes)
    if (component.starts_with(cause.begin)) return cause.text;
  return {};
}

}  // namespace turncal
