// The sensitivities that run_filter() carries for the parameters and for every effect of the catalogue, against differences of
// its own chi-square: d chi2 / dp = 2 sum N' S^-1 nu, d2 chi2 / dp2 = 2 sum N' S^-1 N (Gauss-Newton: the data are noise-free
// and the parameters near the truth, so what is dropped is small). The second difference also holds what a parameter does to
// the gains and to the first levelling, which the columns leave out: 0.5 % of the information, 1.4 % for a warm-up of 60 s.
#include <gtest/gtest.h>

#include <cmath>

#include "calib/joint/joint_estimate.h"
#include "calib/joint/joint_filter.h"
#include "calib/model/effects.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

struct Bench {
  RigRecording made;
  std::vector<EffectColumn> columns;
  EffectModel effects;
  FilterSetup setup;
};

// Twelve-state noise, a few effects in force, parameters off by some sigma: everything the columns can depend on.
Bench bench(double instability) {
  RigConfig config = noise_free(default_rig_config());
  config.seed = 5;
  config.temperature.rise_c = 6.0;
  Bench b{record_on_rig(must_read_sequence("short_demo.seq"), config), {}, {}, {}};
  b.columns = catalogue_columns(b.made.recording.info);
  b.effects = make_effect_model(b.columns, {b.made.recording.info.latitude_deg}, b.made.recording.mean_temperature_c);
  b.setup.noise.accel_pulse_mps = config.accel_pulse_mps;
  b.setup.noise.gyro_bias_instability_radps = instability * 5e-9;
  b.setup.noise.accel_bias_instability_mps2 = instability * 1e-5;
  return b;
}

double chi_square(const Bench& b, const ParameterVector& parameters, const EffectModel& effects) {
  FilterSetup setup = b.setup;
  setup.with_columns = false;
  return run_filter(b.made.recording, from_vector(parameters), effects, setup).chi_square;
}

void compare(const Bench& b) {
  // A place a tenth of a sigma from the minimum in every column: what hardly shows here (an error of the earth rate) is linear no further.
  ParameterVector parameters = to_vector(b.made.truth);
  const FilterResult at_truth = run_filter(b.made.recording, b.made.truth, b.effects, b.setup);
  EffectModel effects = b.effects;
  const Eigen::Index n = parameter_count + effects.columns;
  ASSERT_EQ(at_truth.information.rows(), n);
  const Eigen::VectorXd sigma = at_truth.information.diagonal().cwiseSqrt().cwiseInverse();
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(sigma[k] < 1e100)) continue;
    const double off = (k % 2 == 0 ? 0.1 : -0.06) * sigma[k];
    (k < parameter_count ? parameters[k] : effects.values[k - parameter_count]) += off;
  }
  const FilterResult here = run_filter(b.made.recording, from_vector(parameters), effects, b.setup);
  const double centre = chi_square(b, parameters, effects);
  int looked_at = 0;
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!(sigma[k] < 1e100)) continue;  // a column that nothing excites here
    const double h = sigma[k];
    const auto at = [&](double step) {
      ParameterVector p = parameters;
      EffectModel e = effects;
      (k < parameter_count ? p[k] : e.values[k - parameter_count]) += step;
      return chi_square(b, p, e);
    };
    const double plus = at(h);
    const double minus = at(-h);
    const std::string name = k < parameter_count
                                 ? std::string(parameter_keys[static_cast<std::size_t>(k)])
                                 : b.columns[static_cast<std::size_t>(k - parameter_count)].key() + " " +
                                       std::to_string(b.columns[static_cast<std::size_t>(k - parameter_count)].tau_s);
    // In units in which the information of each column is 1.
    EXPECT_NEAR((plus - minus) / (4.0 * h) * sigma[k], here.gradient[k] * sigma[k], 2e-3 * std::sqrt(here.chi_square))
        << name;
    EXPECT_NEAR((plus - 2.0 * centre + minus) / (2.0 * h * h) * sigma[k] * sigma[k],
                here.information(k, k) * sigma[k] * sigma[k], 0.02)
        << name;
    ++looked_at;
  }
  EXPECT_GT(looked_at, 24 + 60);
}

TEST(JointJacobian, SixStates) { compare(bench(0.0)); }
TEST(JointJacobian, TwelveStates) { compare(bench(1.0)); }

}  // namespace
}  // namespace turncal
