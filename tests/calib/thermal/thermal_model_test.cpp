// Parameters as functions of temperature: on legs drawn with a known covariance, sigmas that hold and terms that are there; and on recordings
// of the rig at five temperatures.
#include "calib/thermal/thermal_model.h"

#include <gtest/gtest.h>

#include "calib/evidence/statement.h"
#include "tests/calib/thermal/drawn_legs.h"
#include "tests/test.h"

namespace turncal {
namespace {

ThermalScore score_of(const DrawnThermal& drawn, std::uint64_t first, int campaigns) {
  ThermalScore score;
  for (std::uint64_t seed = first; seed < first + std::uint64_t(campaigns); ++seed) {
    const DrawnCampaign made = drawn_campaign(seed, drawn);
    const Result<ThermalModel> model = fit_thermal_model(made.legs, {.reference_c = 10.0, .hold_out = false});
    EXPECT_OK(model);
    if (model) score.add(made, *model, drawn);
  }
  return score;
}

// 12 campaigns of 17 legs: values at other temperatures within their sigmas (error^2 over variance in 0.8 to 1.2; 200 campaigns of
// study_thermal come to 0.95 to 1.1), an error of held-out legs within 1.2 of their own, terms found that are 20 sigma of a leg, and false
// ones below 3 %.
TEST(Thermal, OrdersRateHysteresisAndSwitchOnOverSeeds) {
  const ThermalScore score = score_of({.size = 20.0, .effects = 0.2, .switch_on = 3.0}, 5000, 12);
  EXPECT_NEAR(score.nees / score.campaigns, 1.0, 0.2);
  EXPECT_NEAR(score.coefficients / score.said_coefficients, 1.0, 0.25);
  EXPECT_LT(std::sqrt(score.held_out / score.noise), 1.2);
  for (const int k : {0, 1, 2}) EXPECT_LE(score.wrong[k], 0.03 * score.said[k]) << k;
  EXPECT_GT(score.said[0], 0.8 * score.there[0]);
  for (const int k : {1, 2}) EXPECT_GT(score.said[k], 0.9 * score.there[k]) << k;
  EXPECT_NEAR(std::sqrt(score.switch_on / score.campaigns), 1.0, 0.25);
}

// A hysteresis that closes at the ends of the range is none that is the same everywhere, and none of the rate.
TEST(Thermal, LoopsThatClose) {
  const ThermalScore score = score_of({.size = 20.0, .effects = 0.2, .loop = true}, 8000, 6);
  EXPECT_NEAR(score.nees / score.campaigns, 1.0, 0.3);
  EXPECT_EQ(score.wrong[1] + score.wrong[2], 0);
  EXPECT_GT(score.said[2], 0.9 * score.there[2]);
}

// A lag is one number of the unit: said of it, with a sigma that holds, and no rate or hysteresis of single parameters.
TEST(Thermal, OneLagOfAllParameters) {
  const ThermalScore score = score_of({.size = 20.0, .lag_h = 0.1, .ramp = 15.0, .temperatures = 5}, 9000, 6);
  EXPECT_EQ(score.lag_said, score.campaigns);
  EXPECT_LT(std::sqrt(score.lag / score.campaigns), 1.8);
  EXPECT_EQ(score.said[1] + score.said[2] + score.wrong[0], 0);
  EXPECT_LT(std::sqrt(score.held_out / score.noise), 1.2);
}

// On a ramp a scale factor is that of the moment when its axis turns; what the response says is what the rig's makes of it.
TEST(Thermal, ARampMovesEachParameterAsItsResponseSays) {
  RigConfig config = default_rig_config();
  config.temperature = {.start_c = 20.0, .rise_c = 24000.0, .tau_s = 800000.0, .reference_c = 29.13};  // its mean
  const auto recorded = [&] { return record_on_rig(must_read_sequence("short_demo.seq"), config).recording; };
  const JointResult before = joint_estimate(recorded());
  config.effects.gyro_scale_temperature = {1.0, 2.0, -1.5};
  const CompressedRecording ramp = recorded();
  const JointResult after = joint_estimate(ramp);
  ParameterVector slope = ParameterVector::Zero();
  slope(std::array{6, 10, 14}) << -1e-6, -2e-6, 1.5e-6;
  const ParameterVector expected =
                            response_to_temperature(ramp, after) * (slope.cwiseProduct(to_vector(before.parameters))),
                        moved = to_vector(after.parameters) - to_vector(before.parameters);
  for (const int k : after.free) EXPECT_NEAR(moved[k], expected[k], 2.0 * before.sigma[k]) << parameter_key(k);
  for (const int k : {6, 10, 14}) EXPECT_GT(std::abs(moved[k]), 6.0 * before.sigma[k]) << parameter_key(k);
}

// Legs that settled have one rate: what is left of it is no cause. One that disagrees with the others is named.
TEST(Thermal, ALegThatDisagreesAndRatesThatAreNone) {
  DrawnCampaign made = drawn_campaign(9, {.size = 20.0});
  for (ThermalLeg& leg : made.legs) leg.rate_c_per_h = 0.3 * leg.direction;
  const Result<ThermalModel> agree = fit_thermal_model(made.legs);
  ASSERT_OK(agree);
  EXPECT_LT(agree->holdout.worst_z, thermal_priors.disagrees_z);
  for (const ThermalParameter& p : agree->parameters) EXPECT_EQ(p.rate, 0.0);
  made.legs[6].value[14] += 20.0 * leg_noise().sigma[14];
  const Result<ThermalModel> off = fit_thermal_model(made.legs);
  ASSERT_OK(off);
  EXPECT_GT(off->holdout.worst_z, thermal_priors.disagrees_z);
  EXPECT_EQ(off->holdout.worst_leg, made.legs[6].name);
  EXPECT_EQ(off->holdout.worst_key, 14);
}

TEST(Thermal, NothingIsClaimedOfAUnitThatDoesNotChange) {
  const ThermalScore score = score_of({}, 6000, 10);
  EXPECT_LE(score.said[0] + score.said[1] + score.said[2], 3);  // of 10 x 21 x 5
  EXPECT_LT(std::sqrt(score.held_out / score.noise), 1.1);
}

// A wave that no cubic carries: said to be none, its values within their sigmas, and a cubic that says how far it is off.
TEST(Thermal, SmoothFunctionWhereNoPolynomialCarriesIt) {
  const DrawnThermal drawn{.size = 20.0, .wave = 4.0};
  const DrawnCampaign made = drawn_campaign(7, drawn);
  const Result<ThermalModel> model = fit_thermal_model(made.legs, {.hold_out = false});
  ASSERT_OK(model);
  ThermalScore score;
  score.add(made, *model, drawn);
  EXPECT_NEAR(score.nees, 1.0, 0.5);
  int waves = 0;
  for (std::size_t j = 0; j < model->parameters.size(); ++j) {
    const ThermalParameter& p = model->parameters[j];
    if (std::abs(made.unit.wave[p.key]) < 50.0 * leg_noise().sigma[p.key]) continue;
    ++waves;
    EXPECT_GT(p.smooth, said_from) << parameter_key(p.key);
    EXPECT_GT(off_its_cubic(*model, j), 5.0 * leg_noise().sigma[p.key]);
  }
  EXPECT_GT(waves, 0);
}

TEST(Thermal, PowersAreAboutTheReferenceAndCubicsGiveTheSameValues) {
  const DrawnCampaign made = drawn_campaign(3, {.size = 20.0});
  const Result<ThermalModel> about_5 = fit_thermal_model(made.legs, {.reference_c = 5.0, .hold_out = false}),
                             about_40 = fit_thermal_model(made.legs, {.reference_c = 40.0, .hold_out = false});
  ASSERT_OK(about_5);
  ASSERT_OK(about_40);
  for (const double t : {-40.0, -3.0, 5.0, 60.0}) {
    const ThermalPoint one = evaluate(*about_5, t), other = evaluate(*about_40, t);
    const double x = t - 40.0;
    for (std::size_t j = 0; j < about_5->parameters.size(); ++j) {
      const ThermalParameter& p = about_5->parameters[j];
      const double sigma = leg_noise().sigma[p.key];
      EXPECT_NEAR(one.value[p.key], other.value[p.key], 1e-6 * sigma);
      EXPECT_NEAR(one.covariance(p.key, p.key), other.covariance(p.key, p.key), 1e-5 * sigma * sigma);
      const auto c = [&](int order) { return about_40->coefficient(j, order); };
      EXPECT_NEAR(((c(3) * x + c(2)) * x + c(1)) * x + c(0), other.value[p.key],
                  off_its_cubic(*about_40, j) + 1e-6 * sigma);
    }
  }
  EXPECT_EQ(evaluate(*about_5, 61.0).value, evaluate(*about_5, 60.0).value);
}

// A leg that does not determine n12 gives what it knows of the others; what no leg determines is left out.
TEST(Thermal, ParametersThatSomeLegsDoNotDetermine) {
  DrawnCampaign made = drawn_campaign(4, {.size = 20.0});
  const auto forget = [](ThermalLeg& leg, int key) {
    std::vector<int> keep;
    for (std::size_t k = 0; k < leg.free.size(); ++k)
      if (leg.free[k] != key) keep.push_back(int(k));
    leg.covariance = Eigen::MatrixXd(leg.covariance(keep, keep));
    std::erase(leg.free, key);
    leg.value[key] = std::nan("");
  };
  for (std::size_t k = 0; k < made.legs.size(); ++k) {
    if (k < 3) forget(made.legs[k], 7);
    forget(made.legs[k], 11);
  }
  const Result<ThermalModel> model = fit_thermal_model(made.legs);
  ASSERT_OK(model);
  EXPECT_EQ(model->find(11), nullptr);
  ASSERT_NE(model->find(7), nullptr);
  EXPECT_SAYS(model->notes.front(), "n12 is determined by 14 of 17 legs");
  const double truth = made.unit.at(0.0)[7];
  const ThermalPoint point = evaluate(*model, 0.0);
  EXPECT_LT(std::abs(point.value[7] - truth), 4.0 * std::sqrt(point.covariance(7, 7)));
  EXPECT_EQ(model->holdout.legs, std::ssize(made.legs));
  for (const ThermalParameter& p : model->parameters)
    EXPECT_LT(p.left_out[1], 2.5 * p.left_out[2]) << parameter_key(p.key);
}

TEST(Thermal, FaultyLegsAreRefusedByName) {
  using Legs = std::vector<ThermalLeg>;
  const Legs good = drawn_campaign(1, {.size = 20.0}).legs;
  const struct {
    void (*change)(Legs&);
    const char* said;
  } faults[] = {{[](Legs& l) { l.clear(); }, "two temperatures"},
                {[](Legs& l) { l.resize(1); }, "1 leg at -40.00 C: expected legs at two temperatures"},
                {[](Legs& l) { std::ranges::for_each(l, [](ThermalLeg& leg) { leg.temperature_c = 20.0; }); },
                 "17 legs at 20.00"},
                {[](Legs& l) { l[2].temperature_c = std::nan(""); }, "leg 3: has no temperature"},
                {[](Legs& l) { l[2].value[0] = std::nan(""); }, "leg 3: N01 is not finite"},
                {[](Legs& l) { l[2].covariance(4, 4) = 0.0; }, "leg 3: the variance of A02"},
                {[](Legs& l) {
                   l[1].covariance.col(8) = l[1].covariance.col(7), l[1].covariance.row(8) = l[1].covariance.row(7);
                 },
                 "leg 2: its covariance is singular, at n1"}};
  for (const auto& [change, said] : faults) {
    Legs legs = good;
    change(legs);
    EXPECT_TRUE(fails(fit_thermal_model(legs), said));
  }
  EXPECT_TRUE(fails(fit_thermal_model(good, {.reference_c = 80.0}), "reference temperature 80 C"));
  Legs few = {good[0], good[8], good[9]};
  few[2].temperature_c = few[0].temperature_c;
  const Result<ThermalModel> two = fit_thermal_model(few);
  ASSERT_OK(two);
  EXPECT_EQ(two->most_order, 1);
  EXPECT_SAYS(two->notes.front(), "2 temperatures determine no order above 1");
}

// The rig at five temperatures, each a switch-on with noise of its own: gyro and accelerometer bias and scale factor that depend on it. What the
// rig was given comes back within 4 sigma, and no other parameter is said to depend on temperature.
TEST(Thermal, RigAtFiveTemperatures) {
  std::vector<ThermalLeg> legs;
  Parameters truth;
  for (int k = 0; k < 5; ++k) {
    RigConfig config = default_rig_config();
    config.seed = 31, config.noise_seed = 400 + k;
    config.temperature = {.start_c = -20.0 + 15.0 * k, .rise_c = 1.0, .tau_s = 2400.0, .reference_c = 10.0};
    config.effects.gyro_bias_temperature = {0.002, 0.0, 0.0};
    config.effects.accel_bias_temperature = {0.0, 5.0, 0.0};
    config.effects.accel_scale_temperature = {0.0, 0.0, 2.0};
    const RigRecording made = record_on_rig(must_read_sequence("forty_minutes.seq"), config);
    const JointResult e = joint_estimate(made.recording);
    ASSERT_TRUE(e.converged);
    legs.push_back({"leg " + std::to_string(k + 1), made.recording.mean_temperature_c, 0.0, 0, k,
                    to_vector(e.parameters), e.covariance, e.free});
    truth = made.truth;
  }
  const Result<ThermalModel> model = fit_thermal_model(legs, {.reference_c = 10.0});
  ASSERT_OK(model);
  // f = a counts - A0: what is added to the reading is A0, and a scale factor that reads 2 ppm more is made smaller.
  const std::pair<int, double> given[] = {{0, 0.002}, {4, 5e-6}, {23, -2e-6 * truth.a(2, 2)}};
  for (std::size_t j = 0; j < model->parameters.size(); ++j) {
    const ThermalParameter& p = model->parameters[j];
    const auto found = std::ranges::find(given, p.key, &std::pair<int, double>::first);
    if (found == std::end(given)) {
      EXPECT_EQ(p.said_order(), 0) << parameter_key(p.key);
      continue;
    }
    EXPECT_GE(p.said_order(), 1) << parameter_key(p.key);
    EXPECT_NEAR(model->coefficient(j, 1), found->second, 4.0 * model->sigma(j, 1)) << parameter_key(p.key);
    EXPECT_LT(p.left_out[1], 0.3 * p.left_out[0]) << parameter_key(p.key);
  }
}

}  // namespace
}  // namespace turncal
