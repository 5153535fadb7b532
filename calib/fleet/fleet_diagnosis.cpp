#include "calib/fleet/fleet_diagnosis.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/fleet/fleet_selection.h"
#include "calib/model/limits.h"
#include "calib/statistics/distributions.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

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

double unit_limit(const FleetScores& scores, const FleetOptions& options) {
  return chi_square_1_limit(options.unit_false_alarm / static_cast<double>(scores.size() * scores.effects()));
}

std::vector<Deviation> set_units_aside(FleetScores& scores, const FleetOptions& options) {
  std::vector<Deviation> all;
  const double limit = unit_limit(scores, options);
  for (int round = 0; round < options.max_of_unit; ++round) {
    bool any = false;
    for (const Deviation& w : worst_deviations(scores)) {
      if (w.z * w.z < limit) continue;
      scores.subtract(w.member, w.component, w.value);
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
    scores.subtract(w->member, w->component, -w->value);
  }
}

struct Explanation {
  std::vector<Selected> chosen;
  std::vector<Deviation> units;
};

// Units that stand out hide what is common, and may pass for it; what is common makes all units of a station stand out. So one is
// looked for beside the other until nothing changes, and first of all what is common: without what changes with time, or with it.
Explanation search(FleetScores& scores, const FleetOptions& options, bool with_shapes, FleetDiagnosis& d) {
  std::vector<Selected> chosen = select_common(scores, options, with_shapes, d);
  std::vector<Deviation> units = set_units_aside(scores, options);
  const bool settled = with_shapes && units.empty();  // the same would be selected again
  for (int round = 0; round < 4 && !settled; ++round) {
    put_back(scores, chosen);
    chosen = select_common(scores, options, true, d);
    restore(scores, units);
    std::vector<Deviation> again = set_units_aside(scores, options);
    const bool same = again.size() == units.size() &&
                      std::equal(again.begin(), again.end(), units.begin(), [](const Deviation& a, const Deviation& b) {
                        return a.member == b.member && a.component == b.component;
                      });
    units = std::move(again);
    if (same) break;
  }
  return {std::move(chosen), std::move(units)};
}

// What an explanation takes off chi-square, less what each part of it would have to take off to be believed by itself. Parameters
// have no chi-square, and what they do follows the effects: they do not count.
double worth(const Explanation& e, const FleetScores& scores, const FleetOptions& options, const FleetDiagnosis& d) {
  const auto effects = std::count_if(e.chosen.begin(), e.chosen.end(),
                                     [&](const Selected& s) { return !scores.is_parameter(s.found.component); });
  return scores.explained() - static_cast<double>(e.units.size()) * unit_limit(scores, options) -
         static_cast<double>(effects) * chi_square_1_limit(options.false_alarm / static_cast<double>(d.tests));
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
      const Component whole(one.data, level_columns(scores, -1), false);
      const Estimate mean = whole.test(level_columns(scores, -1)).front();
      s.mean = mean.value, s.mean_sigma = mean.sigma;
    }
    for (std::size_t f = 0; f < factors.size(); ++f) {
      std::vector<ComponentLevel> levels;
      for (const Estimate& e :
           component_of(scores, c, static_cast<int>(f)).test(level_columns(scores, static_cast<int>(f))))
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
  struct Level {
    double square = 0.0, degrees = 0.0;
  };
  std::vector<std::vector<Level>> sums(options.factors.size());
  double tries = 0.0;
  for (std::size_t f = 0; f < sums.size(); ++f) {
    sums[f].resize(scores.levels(f).size());
    tries += static_cast<double>(sums[f].size());
  }
  const Eigen::Index directions = (eigen.values.array() > fleet_limits.open_direction).count();
  for (const ComponentData& data : scores.sums(scale.asDiagonal() * eigen.vectors.rightCols(directions))) {
    for (std::size_t f = 0; f < sums.size(); ++f) {
      const Component direction(data, level_columns(scores, static_cast<int>(f)), false);
      const std::vector<Estimate> estimates = direction.test(level_columns(scores, static_cast<int>(f)));
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
  Explanation best = search(scores, options, true, d);
  // Units may pass for what changes with time, and the end of a steep ramp for units: the other way round as well.
  if (!best.units.empty()) {
    FleetScores other_scores(members, options.factors.size());
    Explanation other = search(other_scores, options, false, d);
    if (worth(other, other_scores, options, d) > worth(best, scores, options, d) - options.shape_margin) {
      scores = std::move(other_scores);
      best = std::move(other);
    }
  }
  auto& [chosen, units] = best;
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
  if (options.summary) summarise(scores, options, d);
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
