// Rows of the catalogue against formulas of their own: what is laid on a recording (tests/disturbance.h) is computed in another way
// than the row computes it, and the joint estimate with the row in its model must find it.
#include "calib/joint/joint_estimate.h"
#include "tests/disturbance.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

constexpr double start_c = 24.0, rise_c = 6.0, warm_s = 2400.0;

const RigRecording& base() {
  static const RigRecording made = [] {
    RigConfig config = default_rig_config();
    config.seed = 71;
    config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
    config.temperature = {.start_c = start_c, .rise_c = rise_c, .tau_s = warm_s, .reference_c = {}};
    return record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  }();
  return made;
}

struct Row {
  const char* name;
  int component;
  double tau;
  double value;
  Disturbance added;  // of one unit
};

JointResult fit_with(const CompressedRecording& recording, const EffectColumn& effect) {
  JointOptions options;
  options.fit_bias_instability = false;
  options.effects = {effect};
  return joint_estimate(recording, options);
}

// The answer of a first-order lag to start + rise (1 - exp(-t/warm)), in closed form.
double lagged_c(double t, double lag_s) {
  return start_c + rise_c * (1.0 - (warm_s * std::exp(-t / warm_s) - lag_s * std::exp(-t / lag_s)) / (warm_s - lag_s));
}

// By the trapezoidal rule over the middles of blocks.
Disturbance wave(int axis) {
  return on_gyro(axis, [axis, angle = 0.0, time_s = 1e9, rate = 0.0](const DisturbedMoment& m) mutable {
    const double of_axis = m.rate_radps[axis];
    angle = m.time_s < time_s ? 0.0 : angle + 0.5 * (m.time_s - time_s) * (rate + of_axis);
    time_s = m.time_s;
    rate = of_axis;
    return degph * std::sin(4.0 * 0.277 * angle);
  });
}

TEST(EffectCatalogue, EachRowFindsWhatAnotherFormulaAdded) {
  const double mean_c = base().recording.mean_temperature_c;
  const auto faded = [](const DisturbedMoment& m) { return std::pow(0.5, m.time_s / (960.0 * std::log(2.0))); };
  const auto risen = [](const DisturbedMoment& m) {  // C/h
    return 3600.0 * rise_c / warm_s * std::exp(-m.time_s / warm_s);
  };
  const Row rows[] = {
      {"gyro_scale_warm_up", 0, 960.0, 30.0,
       on_gyro(0, [=](const DisturbedMoment& m) { return 1e-6 * m.rate_radps[0] * faded(m); })},
      {"gyro_scale_drift", 1, 0.0, 15.0,
       on_gyro(1, [](const DisturbedMoment& m) { return m.rate_radps[1] * m.time_s / 3.6e9; })},
      {"accel_scale_warm_up", 0, 960.0, 20.0,
       on_accel(0, [=](const DisturbedMoment& m) { return ug * m.force_g[0] * faded(m); })},
      {"accel_scale_drift", 1, 0.0, 8.0,
       on_accel(1, [](const DisturbedMoment& m) { return ug * m.force_g[1] * m.time_s / 3600.0; })},
      {"gyro_rate_third_order", 2, 0.0, 400.0,
       on_gyro(2, [](const DisturbedMoment& m) { return 32.828e-6 * std::pow(m.rate_radps[2], 3.0); })},
      {"gyro_wave_angle", 5, 0.0, 0.05, wave(2)},
      {"accel_creep", 1, 150.0, 20.0, accel_creep(1, 1.0, 150.0)},
      {"accel_rectification", 2, 0.0, 150.0,
       on_accel(2, [](const DisturbedMoment& m) { return m.rate_radps.norm() > 0.0087 ? ug : 0.0; })},
      {"gyro_g_squared", 1, 0.0, 0.08,  // x_yy
       on_gyro(0, [](const DisturbedMoment& m) { return degph * std::pow(m.force_g[1], 2.0); })},
      {"gyro_lock_in", 1, 5.0, 2.0,
       on_gyro(1, [](const DisturbedMoment& m) { return locked_in(m.rate_radps[1], 0.01, 5.0); })},
      {"gyro_lock_in", 3, 5.0, 2.0,  // of all
       [](const DisturbedMoment& m) {
         const auto locked = [](double rate) { return locked_in(rate, 0.01, 5.0); };
         return AddedReading{.gyro_radps = m.rate_radps.unaryExpr(locked)};
       }},
      {"gyro_bias_temperature_rate", 0, 0.0, 0.01,
       on_gyro(0, [=](const DisturbedMoment& m) { return degph * risen(m); })},
      {"accel_bias_temperature_rate", 1, 0.0, 1.0,
       on_accel(1, [=](const DisturbedMoment& m) { return ug * risen(m); })},
      {"gyro_bias_temperature_lag", 2, 300.0, 0.02,
       on_gyro(2, [=](const DisturbedMoment& m) { return degph * (lagged_c(m.time_s, 300.0) - mean_c); })},
      {"accel_bias_temperature_lag", 0, 1200.0, 3.0,
       on_accel(0, [=](const DisturbedMoment& m) { return ug * (lagged_c(m.time_s, 1200.0) - mean_c); })},
  };
  for (const Row& row : rows) {
    SCOPED_TRACE(testing::Message() << row.name << " " << row.component);
    CompressedRecording recording = base().recording;
    disturb(recording, base().truth, [&, one = row.added](const DisturbedMoment& m) {
      AddedReading added = one(m);
      added.gyro_radps *= row.value;
      added.accel_mps2 *= row.value;
      return added;
    });
    const JointResult fit = fit_with(recording, {find_effect(row.name), row.component, row.tau});
    ASSERT_TRUE(fit.converged) << fit.message;
    ASSERT_EQ(fit.effects.size(), 1u);
    const EstimatedEffect& found = fit.effects[0];
    EXPECT_GT(std::abs(row.value), 6.0 * found.sigma) << "the recording hardly shows it, sigma " << found.sigma;
    EXPECT_NEAR(found.value, row.value, 4.0 * found.sigma + 0.03 * std::abs(row.value));
    EXPECT_NEAR(fit.whiteness.level, 1.0, 0.1);
  }
}

// What a clock that is off does is the recording's own: turns and biases do not change, the earth's rate does.
TEST(EffectCatalogue, SamplePeriodIsSeenByTheEarthsRate) {
  constexpr double off = 2e-3;  // given 2000 ppm too long
  CompressedRecording recording = base().recording;
  recording.info.sample_period_s *= 1.0 + off;
  for (Block& block : recording.blocks) {
    block.duration_s *= 1.0 + off;
    block.gyro_time *= 1.0 + off;
    block.accel_time *= 1.0 + off;
  }
  const JointResult fit = fit_with(recording, {find_effect("sample_period"), 0, 0.0});
  ASSERT_TRUE(fit.converged) << fit.message;
  ASSERT_EQ(fit.effects.size(), 1u);
  EXPECT_NEAR(fit.effects[0].value, -1e6 * off, 3.5 * fit.effects[0].sigma);
  EXPECT_LT(fit.effects[0].sigma, 250.0);
  // All else that it does: the common scale of the accelerometers.
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(fit.parameters.a(k, k) / base().truth.a(k, k), 1.0 + off, 5e-6) << k;
}

TEST(EffectCatalogue, NamesAreUniqueAndRowsComplete) {
  for (const EffectEntry& entry : effect_catalogue()) {
    EXPECT_EQ(find_effect(entry.name), &entry);
    EXPECT_FALSE(entry.components.empty() || entry.term.empty() || entry.formula.empty() || entry.seen_by.empty())
        << entry.name;
  }
}

}  // namespace
}  // namespace turncal
