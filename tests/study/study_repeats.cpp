// Which effects of a unit repeat from one recording to the next, and which another effect imitates (docs/accuracy.md): every recording turned
// by hand is fitted twice, with the effect alone and with slow changes of the gyros beside it.
//
//   study_repeats EFFECT RECORDING...      recordings as `turncal segment` leaves them; units by their serial
// Of each component y_i of recording i of a unit, sigma_i its sigma: y_i = b_unit + d_i + e_i, d_i ~ N(0, s^2) what does not repeat (of all
// units together, by restricted likelihood), e_i ~ N(0, sigma_i^2). It repeats where b_unit / sigma is beyond one in a hundred of all
// components (Bonferroni; Student's t). A line each: model, unit, component, recordings, b, sigma, t, recordings that show it by
// themselves (z > 3.9), with a sign other than b, 1 where it repeats.
#include <cmath>
#include <cstdio>
#include <map>

#include "calib/fleet/fleet_scores.h"
#include "calib/model/effects.h"
#include "calib/rests/rest_model.h"
#include "calib/statistics/numerics.h"
#include "orchestrator/jobs/calibration_job.h"

namespace turncal {
namespace {

struct One {
  double value = 0.0, sigma = 0.0;
};
using ByUnit = std::map<std::string, std::vector<std::vector<One>>>;  // of each component, of each recording

void judge(const char* model, const EffectEntry& effect, const ByUnit& by_unit) {
  const auto components = effect.components.size();
  const double tests = double(by_unit.size() * components);
  for (std::size_t c = 0; c < components; ++c) {
    const std::string key = std::string(effect.name) + "." + std::string(effect.components[c]);
    ComponentData data;
    std::vector<double> y, v;
    int level = 0;
    std::vector<int> of;
    for (const auto& [unit, all] : by_unit) {
      for (const One& one : all[c]) {
        y.push_back(one.value), v.push_back(one.sigma * one.sigma);
        of.push_back(level);
        data.unit.push_back(
            int(data.unit.size()));  // nothing in common: what scatters does from recording to recording
      }
      ++level;
    }
    const auto count = Eigen::Index(y.size());
    data.y = Eigen::Map<Eigen::VectorXd>(y.data(), count);
    data.v = Eigen::Map<Eigen::VectorXd>(v.data(), count);
    Eigen::MatrixXd X = Eigen::MatrixXd::Zero(count, level);
    for (Eigen::Index i = 0; i < count; ++i) X(i, of[std::size_t(i)]) = 1.0;
    const double scatter = unit_variance(data, X);
    const UnitWeights weights(data, scatter);
    const Eigen::VectorXd information = weights.diagonal(X), score = weights.product(X, data.y);
    level = 0;
    for (const auto& [unit, all] : by_unit) {
      const double b = score[level] / information[level], t = score[level] / std::sqrt(information[level]);
      int shown = 0, against = 0;
      for (const One& one : all[c]) {
        const bool shows = std::abs(one.value) > 3.9 * one.sigma;
        shown += shows;
        against += shows && one.value * b < 0.0;
      }
      const double p = f_tail(t * t, 1.0, double(count - X.cols())) * tests;
      std::printf("%s %s %s %zu %.1f %.1f %.1f %d %d %d\n", model, unit.c_str(), key.c_str(), all[c].size(), b,
                  1.0 / std::sqrt(information[level]), t, shown, against, p < 0.01);
      ++level;
    }
    std::printf("# %s %s: scatter from recording to recording %.1f\n", model, key.c_str(), std::sqrt(scatter));
  }
}

std::vector<EffectColumn> columns_of(const EffectEntry& effect, double tau_s = 0.0) {
  std::vector<EffectColumn> columns;
  for (std::size_t c = 0; c < effect.components.size(); ++c)
    columns.push_back({.entry = &effect, .component = int(c), .tau_s = tau_s});
  return columns;
}

int run(const EffectEntry& effect, char** paths, int count) {
  std::vector<EffectColumn> alone = columns_of(effect), beside = alone;
  // Slow changes of any shape, near enough: linear, and three settling times.
  for (const EffectColumn& c : columns_of(*find_effect("gyro_bias_drift"))) beside.push_back(c);
  for (const double tau_s : {60.0, 240.0, 960.0})
    for (const EffectColumn& c : columns_of(*find_effect("gyro_warm_up"), tau_s)) beside.push_back(c);
  for (const auto& [model, columns] : {std::pair{"alone", alone}, std::pair{"beside_drift", beside}}) {
    ByUnit by_unit;
    for (int k = 0; k < count; ++k) {
      const Result<LoadedRecording> recording = load_recording(paths[k]);
      if (!recording) {
        std::fprintf(stderr, "%s\n", recording.error().message.c_str());
        return 1;
      }
      const RestData data = make_rest_data(recording->data);
      const Result<RestFit> fit = fit_rests(data, make_effect_model(columns, {recording->data.info.latitude_deg}, 0.0));
      if (!fit || !fit->converged) {
        std::printf("# %s %s: not fitted: %s\n", model, paths[k], (fit ? fit->message : fit.error().message).c_str());
        continue;
      }
      std::vector<std::vector<One>>& all = by_unit[recording->data.info.unit_serial];
      all.resize(effect.components.size());
      for (std::size_t c = 0; c < all.size(); ++c) {
        const auto at = Eigen::Index(c);
        const One one{fit->effect_values[at], fit->sigma[parameter_count + at]};
        if (one.sigma > 0.0) all[c].push_back(one);
      }
    }
    judge(model, effect, by_unit);
  }
  return 0;
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  const turncal::EffectEntry* const effect = argc > 2 ? turncal::find_effect(argv[1]) : nullptr;
  if (!effect) {
    std::fprintf(stderr, "usage: study_repeats EFFECT RECORDING...\n");
    return 1;
  }
  return turncal::run(*effect, argv + 2, argc - 2);
}
