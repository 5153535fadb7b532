// The prediction against what the estimator says of a measured recording, against the errors it makes on the rig, and on
// sequences that leave parameters undetermined.
#include "calib/prediction/predict.h"

#include "tests/test.h"

#include <Eigen/Dense>

#include "calib/joint/joint_estimate.h"
#include "calib/joint/score_algebra.h"
#include "calib/prediction/planned_motion.h"
#include "calib/statistics/numerics.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/jobs/preflight.h"
#include "tests/rig_recorder.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"

namespace turncal {
namespace {

const std::string clean_folder = TURNCAL_SOURCE_DIR "/../shared/data/recordings/clean";

PlannedMotion motion_of(const Sequence& sequence) {
  PlanLimits limits;
  limits.settle_s = 0.5;
  return planned_motion(sequence, make_plan(sequence, limits));
}

RecordingInfo rig_info() {
  Rig rig(perfect_rig_config());
  return rig_recording_info(rig);
}

Prediction predict_rig(const Sequence& sequence, const PredictOptions& options = {}) {
  return predict(rig_info(), motion_of(sequence), options);
}

const Prediction& of_fourteen_steps() {
  static const Prediction prediction = predict_rig(fourteen_steps());
  return prediction;
}

// Steps `first` to `last` of the method.
Sequence steps_of_the_method(std::size_t first, std::size_t last) {
  Sequence sequence = fourteen_steps();
  sequence.steps = {sequence.steps.begin() + std::ptrdiff_t(first - 1), sequence.steps.begin() + std::ptrdiff_t(last)};
  sequence.start_deg = sequence.steps.front().initial_deg;
  std::erase_if(sequence.steps.front().items, [](const SequenceItem& item) { return item.positioning; });
  return sequence;
}

// All fourteen steps with dwells of a tenth of their length and turns three times as fast: 14 minutes.
Sequence shortened_method() {
  Sequence sequence = fourteen_steps();
  for (Step& step : sequence.steps)
    for (SequenceItem& item : step.items) {
      item.dwell.samples /= 10;
      item.move.rate_degps *= 3.0;
      item.move.acceleration_degps2 *= 3.0;
    }
  return sequence;
}

NoiseModel noise_of_rig() {  // the defaults of both: 0.002 deg/sqrt(h), 8 ug/sqrt(Hz)
  NoiseModel noise;
  noise.accel_pulse_mps = 0.0005;
  return noise;
}

RigConfig rig_with_walks_only(std::uint64_t seed) {
  RigConfig config = default_rig_config();  // random parameters, 3' table errors, quantised pulses
  config.seed = seed;
  config.noise.gyro_bias_instability_degph = 0.0;
  config.noise.accel_bias_instability_ug = 0.0;
  return config;
}

std::vector<std::string> undetermined_keys(const std::vector<bool>& determined) {
  std::vector<std::string> keys;
  for (std::size_t k = 0; k < parameter_keys.size(); ++k)
    if (parameter_is_free[k] && !determined[k]) keys.emplace_back(parameter_keys[k]);
  return keys;
}

// Sigmas that another implementation of the same estimate reached, rounded up. a_ij: per unit of a, which on that unit is 3 % off 1.
void expect_promised(const ParameterVector& sigma) {
  ParameterVector limit;
  limit << 0.0021, 0.0030, 0.0021, 3.0e-7, 2.3e-7, 2.9e-7, 3.6e-7, 1.1e-6, 1.0e-6, 1.2e-6, 5.2e-7, 7.5e-7, 1.9e-6,
      8.2e-7, 3.7e-7, 3.1e-7, 1.1e-6, 1.9e-6, 0.0, 2.3e-7, 9.7e-7, 0.0, 0.0, 2.9e-7;
  for (const int k : free_parameters()) {
    EXPECT_LE(sigma[k], limit[k]) << parameter_keys[k];
    EXPECT_GT(sigma[k], 0.7 * limit[k]) << parameter_keys[k] << ": too good to be true";
  }
}

TEST(Predict, FourteenStepsKeepTheirPromise) {
  ASSERT_TRUE(of_fourteen_steps().valid);
  expect_promised(of_fourteen_steps().sigma);
  EXPECT_TRUE(undetermined_keys(of_fourteen_steps().determined).empty());
}

TEST(Predict, AgreesWithTheEstimateOnARecordingOfAnotherSimulator) {
  if (!std::filesystem::exists(clean_folder)) GTEST_SKIP() << clean_folder << " is not there";
  const JointResult r = joint_estimate(compress_folder(clean_folder));  // noise fitted to the data
  ASSERT_TRUE(r.converged) << r.message;
  EXPECT_TRUE(r.faults.empty());
  EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
  expect_promised(r.sigma);
  const ParameterVector error = to_vector(r.parameters) - must(read_truth(clean_folder + "/truth.conf"));
  for (const int k : r.free) {
    EXPECT_NEAR(of_fourteen_steps().sigma[k] / r.sigma[k], 1.0, 0.10) << parameter_keys[k];
    EXPECT_LT(std::abs(error[k]), 3.5 * r.sigma[k]) << parameter_keys[k];
  }
}

// What the estimate of a run on the rig says of itself, which JointConditions holds to the errors that it makes.
TEST(Predict, IsTheCovarianceOfARunOnTheRig) {
  const Sequence sequence = shortened_method();
  const RigRecording made = record_on_rig(sequence, rig_with_walks_only(1000));
  PredictOptions of_unit;
  of_unit.unit = made.truth;
  const Prediction p = predict_rig(sequence, of_unit);
  JointOptions options;
  options.noise = noise_of_rig();
  const JointResult r = joint_estimate(made.recording, options);
  ASSERT_TRUE(r.converged) << r.message;
  ASSERT_EQ(p.free, r.free);
  const auto correlation = [](const Eigen::MatrixXd& covariance) {
    const Eigen::VectorXd inverse_sigma = covariance.diagonal().cwiseSqrt().cwiseInverse();
    return Eigen::MatrixXd(inverse_sigma.asDiagonal() * covariance * inverse_sigma.asDiagonal());
  };
  for (const int k : p.free) EXPECT_NEAR(p.sigma[k] / r.sigma[k], 1.0, 0.02) << parameter_keys[k];
  EXPECT_LT((correlation(p.covariance) - correlation(r.covariance)).cwiseAbs().maxCoeff(), 0.05);
}

TEST(Predict, SigmaGoesWithTheNoise) {
  const Sequence sequence = shortened_method();
  RecordingInfo info = rig_info();
  info.accel_increment = IncrementKind::physical;  // no quantisation: every noise can be doubled
  PredictOptions options;
  const Prediction once = predict(info, motion_of(sequence), options);
  options.noise.angle_random_walk *= 2.0;
  options.noise.velocity_random_walk *= 2.0;
  const Prediction twice = predict(info, motion_of(sequence), options);
  for (const int k : once.free) EXPECT_NEAR(twice.sigma[k] / once.sigma[k], 2.0, 0.01) << k;
  options.noise.gyro_bias_instability_radps = 0.01 * radps_per_degph;
  const Prediction wandering = predict(info, motion_of(sequence), options);
  EXPECT_GT(wandering.sigma[0], 1.05 * twice.sigma[0]);
}

// One turn there and back about the north axis sees neither heading changes nor the other axes.
TEST(Predict, NamesWhatOneStepLeavesUndetermined) {
  const Sequence step_2 = steps_of_the_method(2, 2);
  const Prediction p = predict_rig(step_2);
  ASSERT_TRUE(p.valid);
  EXPECT_TRUE(p.determined[6]);  // n11: what the step is for
  // nothing turned about y or z, x never left the horizontal
  const auto expect_lost = [](const std::vector<bool>& determined) {
    for (const int k : {10, 14, 15, 17, 3}) EXPECT_FALSE(determined[std::size_t(k)]) << parameter_keys[std::size_t(k)];
  };
  expect_lost(p.determined);
  EXPECT_GE(p.undetermined.size(), 8u);

  // A recording of it says the same, but for n11: the axis of the table is not quite the unit's, and n12 and n13, known to a per cent
  // beforehand, move n11 by a thousandth of that, twenty times the sigma which it would have without them.
  const RigRecording made = record_on_rig(step_2, rig_with_walks_only(5));
  JointOptions options;
  options.noise = noise_of_rig();
  const JointResult estimate = joint_estimate(made.recording, options);
  EXPECT_TRUE(estimate.converged) << estimate.message;
  EXPECT_FALSE(estimate.determined[6]);
  EXPECT_LT(std::abs(estimate.parameters.n(0, 0) - made.truth.n(0, 0)), 1e-4);
  expect_lost(estimate.determined);
  ASSERT_FALSE(estimate.undetermined.empty());
  for (const Undetermined& u : estimate.undetermined) EXPECT_FALSE(u.combination.empty());
  for (const int k : free_parameters()) {
    const std::string_view key = parameter_keys[std::size_t(k)];
    EXPECT_TRUE(p.determined[std::size_t(k)] || p.sigma[k] == 0.0) << key << " has no sigma to print";
    EXPECT_TRUE(estimate.determined[std::size_t(k)] || estimate.sigma[k] == 0.0) << key << " has no sigma to print";
  }
}

// Without steps 2 to 14 nothing turns about the vertical: n12 stays open, and what it could still move by more than its own
// sigma is not printed as known (A01 through a part of a thousandth, say).
TEST(Predict, ASigmaThatIsPrintedHoldsWhateverTheUndeterminedIs) {
  const RecordingInfo info = rig_info();
  for (const std::size_t last : {1u, 2u, 3u}) {
    const Parameters unit = typical_unit(info);
    JointOptions options;
    options.start = unit;
    options.noise = noise_of_rig();
    options.look_for_faults = false;
    const auto r = joint_estimate(planned_recording(info, motion_of(steps_of_the_method(1, last)), unit), options);
    // The same information with nothing known beforehand but the plausible ranges.
    const Eigen::VectorXd ranges = r.ranges(r.free);
    Eigen::MatrixXd A = r.last.information(r.free, r.free);
    A.diagonal() += ranges.cwiseAbs2().cwiseInverse();
    const Eigen::VectorXd balance = A.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd inverse = (balance.asDiagonal() * A * balance.asDiagonal()).inverse();
    for (std::size_t i = 0; i < r.free.size(); ++i) {
      const int k = r.free[i];
      const double whole = std::sqrt(inverse(i, i)) * balance[i];
      EXPECT_TRUE(!r.determined[k] || whole < 1.13 * r.sigma[k]) << parameter_keys[k] << " after step " << last;
    }
    EXPECT_EQ(r.determined[7], last == 3) << "n12 after step " << last;
    EXPECT_EQ(undetermined_keys(r.determined).empty(), last == 3);
  }
}

// The first four steps suffice for all 21, at two to three times the sigma: the turns between the positions and the velocity
// carried through them tell what the closed form needs steps 5 to 14 for. The estimate from them alone holds.
TEST(Predict, FourStepsDetermineAllAndTheEstimateAgrees) {
  const Sequence four = steps_of_the_method(1, 4);
  const Prediction p = predict_rig(four);
  EXPECT_TRUE(undetermined_keys(p.determined).empty());
  const ParameterVector more = p.sigma.cwiseQuotient(of_fourteen_steps().sigma);
  for (const int k : p.free) EXPECT_TRUE(more[k] > 1.05 && more[k] < 6.0) << parameter_keys[k] << " " << more[k];
  const RigRecording made = record_on_rig(four, rig_with_walks_only(7));
  const JointResult estimate = joint_estimate(made.recording);
  ASSERT_TRUE(estimate.converged);
  EXPECT_TRUE(undetermined_keys(estimate.determined).empty());
  EXPECT_TRUE(estimate.faults.empty());
  EXPECT_LT(nees(estimate, made.truth), chi_square_21_one_in_1000);
}

// Check values from an independent estimator (one sigma, x y z), temperature rising 6 C with 40 min; 15 % for its grid of
// dwells. Aliases are those the physics has: at 1 g the square is the absolute value.
TEST(Predict, EffectsAreSeenAsSharplyAsAnIndependentEstimatorSays) {
  PredictOptions options;
  options.effects = true;
  options.temperature = TemperatureProfile{.rise_c = 6.0, .tau_s = 2400.0};
  const Prediction p = predict_rig(fourteen_steps(), options);
  const auto find = [](const Prediction& of, const std::string& key) {
    return *std::ranges::find_if(of.effects, [&](const auto& e) { return e.column.key() == key; });
  };
  constexpr std::pair<const char*, double> checks[] = {
      {"accel_second_order.x", 0.97},      {"accel_second_order.y", 0.82},     {"accel_second_order.z", 0.91},
      {"accel_scale_asymmetry.x", 0.95},   {"accel_bias_temperature.x", 0.15}, {"accel_bias_temperature.y", 0.09},
      {"accel_scale_temperature.z", 0.18}, {"accel_bias_drift.x", 0.55},       {"accel_bias_drift.y", 0.25},
      {"gyro_scale_asymmetry.x", 0.38},    {"gyro_scale_asymmetry.y", 0.54},   {"gyro_bias_temperature.x", 0.0012},
      {"gyro_bias_drift.y", 0.0067},       {"earth_rate.north", 0.002},        {"earth_rate.up", 0.013}};
  for (const auto& [key, sigma] : checks) {
    EXPECT_NEAR(find(p, key).sigma / sigma, 1.0, 0.15) << key;
    EXPECT_NEAR(find(p, key).detectable, 5.0 * find(p, key).sigma, 1e-12);
    EXPECT_TRUE(find(p, key).visible) << key;
  }
  EXPECT_EQ(find(p, "accel_second_order.y").aliases, std::vector<std::string>{"accel_scale_asymmetry"});
  EXPECT_EQ(find(p, "accel_third_order.x").aliases, std::vector<std::string>{"accel_odd_quadratic"});
  EXPECT_TRUE(find(p, "accel_delay.tau").aliases.empty());

  // Dwells at 45 degrees tell square and absolute value apart; other rates show the gyros' nonlinearity.
  const Prediction extended = predict_rig(must_read_sequence("extended.seq"), options);
  EXPECT_TRUE(find(extended, "accel_second_order.x").aliases.empty());
  EXPECT_LT(find(extended, "gyro_rate_nonlinearity.y").sigma, 0.01 * find(p, "gyro_rate_nonlinearity.y").sigma);
}

TEST(Predict, AnEffectThatNothingExcitesIsNotVisible) {
  PredictOptions options;
  options.effects = true;
  const Prediction p = predict_rig(steps_of_the_method(13, 13), options);  // one long dwell
  for (const PredictedEffect& e : p.effects) {
    if (e.column.entry->name == "gyro_scale_asymmetry" || e.column.entry->name == "accel_delay") {
      EXPECT_FALSE(e.visible) << e.column.key() << " " << e.detectable;
      EXPECT_TRUE(e.aliases.empty());
    }
    EXPECT_FALSE(e.column.entry->needs_temperature) << e.column.key();
  }
}

// ---- planned motion ----

// The planned recording against the rig, which shares no model code with it and is held to numbers worked by hand itself.

// Block for block what a rig without table errors and noise delivers, of a unit with errors, on all axes, out of plane, with triangular moves and fast ones.
TEST(PlannedMotion, IsWhatAnErrorlessRigDelivers) {
  const Result<Sequence> crooked = good(parse_sequence(
      "format = 1\nname = crooked\nrate_degps = 30\nacceleration_degps2 = 60\n"
      "step 1\n  initial H 45 P 35 R -20\n  align 400\n  rotate H +90\n  rotate P -2\n  dwell 250\n  rotate R +200 "
      "rate 50\n"
      "  rotate H -3.3 acceleration 7\n  dwell 250\n  rotate P +180\n  dwell 250\n",
      "crooked.seq"));
  RigConfig config = noise_free(perfect_rig_config());
  Parameters unit = typical_unit(rig_info());
  unit.N0_degph = {0.05, -0.08, 0.11};
  unit.n(0, 1) = 1.3e-3, unit.n(2, 0) = -0.7e-3, unit.n(1, 1) += 2e-4;
  unit.a(0, 0) = 1.03, unit.a(1, 2) = 6e-4;
  for (std::size_t k = 0; k < config.truth.size(); ++k) config.truth[k] = to_vector(unit)[int(k)];
  Rig rig(config);
  const RecordingInfo info = rig_recording_info(rig);
  for (const Sequence& sequence : {must_read_sequence("short_demo.seq"), *crooked}) {
    const CompressedRecording made = record_on_rig(sequence, config).recording;
    const CompressedRecording planned = planned_recording(info, motion_of(sequence), unit);
    ASSERT_EQ(planned.blocks.size(), made.blocks.size()) << sequence.name;
    EXPECT_EQ(planned.samples, made.samples);
    ASSERT_EQ(planned.segments.size(), made.segments.size());
    for (std::size_t k = 0; k < planned.segments.size(); ++k) {
      EXPECT_EQ(planned.segments[k].kind, made.segments[k].kind) << k;
      EXPECT_EQ(planned.segments[k].end_sample, made.segments[k].end_sample) << k;
      EXPECT_NEAR(planned.segments[k].roll_deg, made.segments[k].roll_deg, 1e-9) << k;
    }
    EXPECT_TRUE(planned.events.empty());
    for (std::size_t k = 0; k < planned.blocks.size(); ++k) {
      const Block& p = planned.blocks[k];
      const Block& m = made.blocks[k];
      ASSERT_EQ(p.samples, m.samples) << sequence.name << " block " << k;
      ASSERT_EQ(p.segment, m.segment);
      EXPECT_EQ(p.whole_second, m.whole_second);
      // Counts: 1e-6 of a gyro pulse is 5e-12 rad; 1e-5 of an accelerometer's is 5e-9 m/s, a tenth of what two-point Gauss
      // may miss of g/2 a t^3 in the sample in which an acceleration of a = 60 deg/s^2 begins.
      ASSERT_LT((p.gyro - m.gyro).norm(), 1e-6) << sequence.name << " block " << k;
      ASSERT_LT((p.accel - m.accel).norm(), 1e-5) << sequence.name << " block " << k;
      ASSERT_LT((p.gyro_time - m.gyro_time).norm(), 1e-6);
      ASSERT_LT((p.accel_time - m.accel_time).norm(), 1e-6);
      ASSERT_LT((p.coning - m.coning).norm(), 1e-3);  // pulses squared, of sums up to 1e7
      // A sum of products: the accelerometer's 1e-5 pulses beside the pulses of the gyros over the block.
      ASSERT_LT((p.sculling - m.sculling).norm(), 1e-3 + 1e-5 * p.gyro.norm());
    }
  }
}

TEST(PlannedMotion, HardAccelerationIsNoGlitch) {
  const Sequence hard =
      must(parse_sequence("format = 1\nname = hard\nrate_degps = 400\nacceleration_degps2 = 4000\n"
                          "step 1\n  initial H 0 P 0 R 0\n  align 400\n  rotate P +90\n  dwell 400\n",
                          "hard.seq"));
  EXPECT_TRUE(planned_recording(rig_info(), motion_of(hard), start_parameters(rig_info())).events.empty());
}

TEST(PlannedMotion, TemperatureRisesAsTold) {
  PlannedMotion motion;
  motion.items = {{.samples = 200000, .dwell_kind = SegmentKind::still}};
  CompressedRecording recording = planned_recording(rig_info(), motion, start_parameters(rig_info()));
  EXPECT_FALSE(recording.info.has_temperature);
  EXPECT_TRUE(std::isnan(recording.mean_temperature_c));
  recording = planned_recording(rig_info(), motion, start_parameters(rig_info()), TemperatureProfile{20.0, 6.0, 400.0});
  EXPECT_TRUE(recording.info.has_temperature);
  // The second that ends at 400 s: 20 + 6 (1 - exp(-399.5/400)).
  EXPECT_NEAR(recording.blocks[399].temperature_c, 20.0 + 6.0 * (1.0 - std::exp(-399.4975 / 400.0)), 1e-4);
}

}  // namespace
}  // namespace turncal
