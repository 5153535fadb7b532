// Units whose parameters depend on temperature as drawn, and the legs that a campaign would make of them: truth plus an error with the
// covariance of one recording of the rig. What the algebra of calib/thermal makes of legs, apart from how well real recordings keep to theirs.
#pragma once

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "calib/statistics/numerics.h"
#include "calib/thermal/thermal_model.h"
#include "tests/rig_recorder.h"

namespace turncal {

struct LegNoise {
  std::vector<int> free;
  Eigen::MatrixXd covariance, root;
  ParameterVector value, sigma = ParameterVector::Zero();
};

inline const LegNoise& leg_noise() {
  static const LegNoise noise = [] {
    const JointResult e = joint_estimate(record_on_rig(must_read_sequence("fourteen_step.seq"), RigConfig{}).recording);
    LegNoise n{e.free, e.covariance, {}, to_vector(e.parameters)};
    const SymmetricEigen eigen = symmetric_eigen(e.covariance);
    n.root = eigen.vectors * eigen.values.cwiseMax(0.0).cwiseSqrt().asDiagonal();
    for (std::size_t k = 0; k < e.free.size(); ++k)
      n.sigma[e.free[k]] = std::sqrt(e.covariance(Eigen::Index(k), Eigen::Index(k)));
    return n;
  }();
  return noise;
}

// Sizes in the sigma of a leg, over half of the range.
struct DrawnThermal {
  double size = 0.0;     // of each order of a parameter that has it: log-uniform from 0.1 to 10 times this; 0: none has
  double effects = 0.0;  // share of the parameters with a rate term, and with hysteresis
  double effect_size = 20.0;
  bool loop = false;        // the hysteresis closes at the ends
  double lag_h = 0.0;       // the sensors are that far behind the thermometer
  double ramp = 4.0;        // C/h, of every third leg
  double switch_on = 0.0;   // of biases
  double wave = 0.0;        // no polynomial: sin of this many radians over half of the range
  double wave_share = 0.3;  // of the parameters
  int temperatures = 9;
  bool down = true;  // and back, without the hottest
};

struct DrawnUnit {
  double low_c = -40.0, high_c = 60.0;
  std::vector<std::array<double, 4>> c =
      std::vector<std::array<double, 4>>(parameter_count);  // of powers of t, -1 to 1
  std::vector<int> order = std::vector<int>(parameter_count, 0);
  ParameterVector rate = ParameterVector::Zero(), hysteresis = rate, wave = rate;  // a C/h; half the difference
  double wave_radians = 0.0, lag_h = 0.0;
  bool loop = false;
  ParameterVector at(double temperature_c, double r = 0.0, int direction = 0) const {
    const double t = 2.0 * (temperature_c - r * lag_h - low_c) / (high_c - low_c) - 1.0;
    ParameterVector p = leg_noise().value;
    for (int k = 0; k < parameter_count; ++k) {
      const auto& a = c[std::size_t(k)];
      p[k] += ((a[3] * t + a[2]) * t + a[1]) * t + a[0] + wave[k] * std::sin(wave_radians * t) + rate[k] * r +
              hysteresis[k] * direction * (loop ? 1.0 - t * t : 1.0);
    }
    return p;
  }
};

struct DrawnCampaign {
  DrawnUnit unit;
  std::vector<ThermalLeg> legs;
  std::vector<ThermalLeg> held_out;  // at other temperatures in the range, at rest in temperature
};

inline DrawnCampaign drawn_campaign(std::uint64_t seed, const DrawnThermal& d) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const LegNoise& noise = leg_noise();
  DrawnCampaign made;
  DrawnUnit& unit = made.unit;
  unit.lag_h = d.lag_h, unit.loop = d.loop, unit.wave_radians = d.wave;
  const auto sized = [&](double size) {
    return size * std::pow(10.0, 2.0 * uniform(random) - 1.0) * (uniform(random) < 0.5 ? -1.0 : 1.0);
  };
  for (const int k : noise.free) {
    const double u = uniform(random);
    const int order = d.size == 0.0 ? 0 : u < 0.3 ? 0 : u < 0.6 ? 1 : u < 0.8 ? 2 : 3;
    unit.order[std::size_t(k)] = order;
    for (int n = 1; n <= order; ++n) unit.c[std::size_t(k)][std::size_t(n)] = sized(d.size) * noise.sigma[k];
    if (uniform(random) < d.effects)
      unit.rate[k] = (uniform(random) < 0.5 ? -1.0 : 1.0) * d.effect_size * noise.sigma[k] / 4.0;
    if (uniform(random) < d.effects)
      unit.hysteresis[k] = (uniform(random) < 0.5 ? -1.0 : 1.0) * d.effect_size * noise.sigma[k];
    if (d.wave > 0.0 && uniform(random) < d.wave_share) unit.wave[k] = sized(d.size) * noise.sigma[k];
  }
  const auto leg_at = [&](double temperature_c, double rate, int direction, int number) {
    ThermalLeg leg{"leg " + std::to_string(number),         temperature_c,    rate,      direction, number,
                   unit.at(temperature_c, rate, direction), noise.covariance, noise.free};
    const Eigen::VectorXd e =
        noise.root * Eigen::VectorXd::NullaryExpr(noise.root.cols(), [&] { return normal(random); });
    for (std::size_t k = 0; k < noise.free.size(); ++k) leg.value[noise.free[k]] += e[Eigen::Index(k)];
    for (int k = 0; k < 6; ++k) leg.value[k] += normal(random) * d.switch_on * noise.sigma[k];
    return leg;
  };
  const double step = (unit.high_c - unit.low_c) / (d.temperatures - 1);
  int number = 0;
  for (int n = 0; n < d.temperatures; ++n) {
    const double r = n % 3 == 1 ? d.ramp : 0.3 * normal(random);  // every third on a ramp
    made.legs.push_back(leg_at(unit.low_c + n * step, r, n == 0 ? 0 : 1, ++number));
  }
  for (int n = d.temperatures - 2; d.down && n >= 0; --n) {
    const double r = n % 3 == 0 ? -d.ramp : 0.3 * normal(random);
    made.legs.push_back(leg_at(unit.low_c + n * step, r, -1, ++number));
  }
  for (int n = 0; n < 8; ++n)
    made.held_out.push_back(leg_at(unit.low_c + (n + 0.5) * (unit.high_c - unit.low_c) / 8.0, 0.0, 0, ++number));
  return made;
}

// What a fit of many campaigns comes to. Claims: terms that are said_from probable; of those, false ones. Errors of values at the held-out
// temperatures over their sigmas.
struct ThermalScore {
  int campaigns = 0;
  double nees = 0.0;          // mean of e' C^-1 e / 21 over held-out temperatures
  double coefficients = 0.0;  // of single coefficients that are said, mean of (e / sigma)^2
  double said_coefficients = 0.0;
  int said[3] = {}, wrong[3] = {}, there[3] = {};  // orders, rate, hysteresis
  double held_out = 0.0, noise = 0.0;              // squares in sigmas of the leg and switch-on
  double switch_on = 0.0;                          // estimated over true sigma, mean of squares
  double lag_said = 0.0, lag = 0.0;                // campaigns; error over sigma, sum of squares
  void add(const DrawnCampaign& made, const ThermalModel& model, const DrawnThermal& d) {
    ++campaigns;
    lag_said += model.lag >= said_from ? 1.0 : 0.0;
    if (model.lag > 0.0) lag += std::pow((model.lag_h() - d.lag_h) / model.lag_sigma_h(), 2);
    const auto square = [](double x) { return x * x; };
    double of_nees = 0.0;
    for (const ThermalLeg& leg : made.held_out) {
      const ThermalPoint point = evaluate(model, leg.temperature_c);
      const ParameterVector e = point.value - made.unit.at(leg.temperature_c);
      const Eigen::VectorXd scale = leg_noise().sigma(leg.free).cwiseInverse();
      const Eigen::MatrixXd C = scale.asDiagonal() * point.covariance(leg.free, leg.free) * scale.asDiagonal();
      const Eigen::VectorXd x = scale.cwiseProduct(e(leg.free));
      of_nees += x.dot(solve_symmetric(C, x)) / double(leg.free.size());
      for (const int k : leg.free) {
        const double own = square(leg_noise().sigma[k]) * (k < 6 ? 1.0 + square(d.switch_on) : 1.0);
        held_out += square(point.value[k] - leg.value[k]) / own;
        noise += 1.0;
      }
    }
    nees += of_nees / double(made.held_out.size());
    const double half = 0.5 * (made.unit.high_c - made.unit.low_c);
    for (std::size_t j = 0; j < model.parameters.size(); ++j) {
      const ThermalParameter& p = model.parameters[j];
      const auto k = std::size_t(p.key);
      const bool has_wave = made.unit.wave[p.key] != 0.0;
      const int order = made.unit.order[k];
      there[0] += order, said[0] += p.said_order();
      if (!has_wave) wrong[0] += std::max(0, p.said_order() - order);
      const bool rate = p.rate >= said_from, hysteresis = p.hysteresis >= said_from;
      there[1] += made.unit.rate[p.key] != 0.0, said[1] += rate,
          wrong[1] += rate && made.unit.rate[p.key] == 0.0 && !has_wave;
      there[2] += made.unit.hysteresis[p.key] != 0.0, said[2] += hysteresis;
      wrong[2] += hysteresis && made.unit.hysteresis[p.key] == 0.0;
      if (has_wave) continue;
      for (int n = 1; n <= std::min(p.said_order(), order); ++n) {
        // About the middle of the range, where the powers of t are those of T - T_ref.
        const double truth = made.unit.c[k][std::size_t(n)] / std::pow(half, n);
        coefficients += square((model.coefficient(j, n) - truth) / model.sigma(j, n));
        said_coefficients += 1.0;
      }
      if (rate && made.unit.rate[p.key] != 0.0) {
        coefficients +=
            square((model.coefficient(j, thermal_rate) - made.unit.rate[p.key]) / model.sigma(j, thermal_rate));
        said_coefficients += 1.0;
      }
      if (p.key < 6 && d.switch_on > 0.0)
        switch_on += square(p.switch_on / (d.switch_on * leg_noise().sigma[p.key])) / 6.0;
    }
  }
};

}  // namespace turncal
