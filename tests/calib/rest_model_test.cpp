#include "calib/rests/rest_model.h"

#include "calib/model/effects.h"
#include "calib/rests/rest_units.h"
#include "tests/calib/hand_rotations.h"
#include "tests/test.h"

namespace turncal {
namespace {

EffectModel model_of(const char* name) {
  std::vector<EffectColumn> columns;
  const EffectEntry* entry = find_effect(name);
  for (int k = 0; k < int(entry->components.size()); ++k) columns.push_back({entry, k, 0.0});
  return make_effect_model(columns, Site{}, 0.0);
}

RestFit fitted(const HandRecording& p) { return *good(fit_rests(p.data, EffectModel{})); }

TEST(RestSystem, JacobianAgreesWithDifferences) {
  HandRecording p(HandPlan{.rests = 6, .rest_s = 3.0});
  p.recording.info.latitude_deg = 90.0;  // no horizontal earth rate: what is held fixed for it is in no column
  EffectModel effects = model_of("gyro_g_sensitivity");
  for (int k = 0; k < effects.columns; ++k) effects.values[k] = 40.0 * (k - 4);
  const Parameters at = p.hand.truth;
  const RestSystem system = make_rest_system(p.data, at, effects, true);
  for (int c = 0; c < rest_parameter_count + effects.columns; ++c) {
    const bool parameter = c < rest_parameter_count;
    ParameterVector low = to_vector(at), high = low;
    EffectModel effects_low = effects, effects_high = effects;
    const int index = parameter ? free_parameters()[c] : 0;
    const double h = parameter ? (index < 3 ? 1.0 : 1e-5) : 1.0;
    if (parameter) {
      low[index] -= h;
      high[index] += h;
    } else {
      effects_low.values[c - rest_parameter_count] -= h;
      effects_high.values[c - rest_parameter_count] += h;
    }
    const Eigen::VectorXd difference = (make_rest_system(p.data, from_vector(high), effects_high, false).residual -
                                        make_rest_system(p.data, from_vector(low), effects_low, false).residual) /
                                       (2.0 * h);
    // The residuals are white noise here: the terms held fixed (basis across gravity, creep) are worth a part in 10^3
    // of the column, and a g-sensitivity moves with the scale of the accelerometer it multiplies.
    EXPECT_LT((difference - system.jacobian.col(c)).norm(), 6e-3 * difference.norm()) << "column " << c;
  }
}

// Of all parameters of some fits; none may be beyond five.
struct ErrorsInSigmas {
  double sum = 0.0;
  int count = 0;
  const RestFit& add(const RestFit& fit, const Parameters& truth) {
    EXPECT_TRUE(fit.converged) << fit.message;
    const ParameterVector error = to_vector(fit.parameters) - to_vector(truth);
    for (const int k : free_parameters()) {
      EXPECT_LT(std::abs(error[k]), 5.0 * fit.sigma[k]) << parameter_keys[k];
      sum += std::pow(error[k] / fit.sigma[k], 2);
      ++count;
    }
    return fit;
  }
  double mean_square() const { return sum / count; }
};

// 210 squares with mean 1: sigma of the mean sqrt(2/210) = 0.1; the floors of ten small samples widen it to 0.15.
TEST(RestModel, FindsTheTruthWithinItsSigmas) {
  ErrorsInSigmas errors;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const HandRecording p(HandPlan{.seed = seed});
    EXPECT_TRUE(errors.add(fitted(p), p.hand.truth).undetermined.empty());
  }
  EXPECT_NEAR(errors.mean_square(), 1.0, 0.45);
}

// Gyros that feel the horizontal earth rate: without it the gyros at rest come to 9 times their noise, the direction after a turn to 3.
TEST(RestModel, TakesTheHorizontalEarthRateOff) {
  ErrorsInSigmas errors;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const HandRecording p(
        HandPlan{.gyro_noise_radps = 5e-5, .accel_noise_mps2 = 0.002, .seed = seed, .latitude_deg = 45.0 - 9.0 * seed});
    const RestFit fit = errors.add(fitted(p), p.hand.truth);
    for (const RestKind kind : {RestKind::gyro, RestKind::direction})
      EXPECT_LT(fit.white_ratio[std::size_t(kind)], 1.4) << seed;
  }
  EXPECT_NEAR(errors.mean_square(), 1.0, 0.45);
}

TEST(RestModel, StartsFarFromTheTruth) {
  // 30 % off in the gyros' scale, 15 % in the accelerometers': as if the counts had been taken for another unit.
  HandData hand = make_hand_data({});
  scale(hand, 1.3, 1.0 / 1.15);
  const RestFit fit = fitted(HandRecording(hand));
  ASSERT_TRUE(fit.converged) << fit.message;
  EXPECT_NEAR(fit.parameters.n(0, 0) * 1.3, hand.truth.n(0, 0), 2e-3);
  EXPECT_NEAR(fit.parameters.a(2, 2) / 1.15, hand.truth.a(2, 2), 1e-3);
  EXPECT_LT(fit.errors.direction_rms_rad, 2e-3);
}

TEST(RestModel, LeftOutErrorIsThatOfARefitWithoutTheRows) {
  const HandRecording p(HandPlan{.rests = 12});
  const RestFit fit = fitted(p);
  const RestSystem system = make_rest_system(p.data, fit.parameters, EffectModel{}, true);
  const Eigen::VectorXd weights = rest_weights(system, fit.floors);
  const Eigen::VectorXd predicted = left_out_residual(system, weights);
  // Leave leg 4 out by hand: one Gauss-Newton step without its two rows.
  std::vector<Eigen::Index> kept, left;
  for (Eigen::Index k = 0; k < system.residual.size(); ++k) {
    const auto row = std::size_t(k);
    (system.kind[row] == RestKind::direction && system.owner[row] == 4 ? left : kept).push_back(k);
  }
  ASSERT_EQ(left.size(), 2u);
  const Eigen::MatrixXd J = (weights.asDiagonal() * system.jacobian)(kept, Eigen::all);
  const Eigen::VectorXd r = weights.cwiseProduct(system.residual)(kept);
  const Eigen::VectorXd scale = J.colwise().norm().cwiseInverse();
  const Eigen::VectorXd step = scale.cwiseProduct((J * scale.asDiagonal()).colPivHouseholderQr().solve(-r));
  for (const Eigen::Index k : left)
    EXPECT_NEAR(predicted[k], system.residual[k] + system.jacobian.row(k).dot(step), 1e-6);
}

TEST(RestModel, NamesWhatIsNotDetermined) {
  // Turned about x alone, gravity stays in the y-z plane: the x accelerometer's scale and bias are not seen, nor what
  // the other two gyros, which do not turn, put into x. The x gyro's own scale is.
  const HandRecording p(HandPlan{.fixed_axis = Eigen::Vector3d::UnitX()});
  const Result<RestFit> fit = good(fit_rests(p.data, EffectModel{}));
  const auto named = [&](const char* key) {
    return std::ranges::find(fit->undetermined, key) != fit->undetermined.end();
  };
  for (const char* key : {"n12", "n13", "a11", "A01"}) EXPECT_TRUE(named(key)) << key;
  for (const char* key : {"n11", "a23", "A02", "N02"}) EXPECT_FALSE(named(key)) << key;
  for (const int k : free_parameters())
    EXPECT_EQ(std::isnan(fit->sigma[k]), named(std::string(parameter_keys[k]).c_str()));
  const HandRecording few(HandPlan{.rests = 3});
  EXPECT_TRUE(fails(fit_rests(few.data, EffectModel{}), "needs 4 rests"));
}

TEST(RestModel, LegWithLostSamplesIsSetAside) {
  HandData hand = make_hand_data({});
  const Segment& leg = hand.segments[5];
  ASSERT_EQ(leg.kind, SegmentKind::rotate);
  const auto lost = hand.samples.begin() + (leg.start_sample + leg.end_sample) / 2;
  hand.samples.erase(lost, lost + 7);
  const HandRecording p(hand);
  EXPECT_SAYS(p.data.legs[2].fault, "gap of 7 samples");
  EXPECT_TRUE(p.data.legs[1].fault.empty());
  ErrorsInSigmas().add(fitted(p), hand.truth);
}

}  // namespace
}  // namespace turncal
