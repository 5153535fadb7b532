// Rows of the catalogue against formulas of their own: what is laid on a recording (tests/disturbance.h) is computed in another way
// than the row computes it, and the joint estimate with the row in its model must find it.
#include "calib/joint/joint_estimate.h"
#include "tests/disturbance.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

using Eigen::Vector3d;

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
std::ostream& operator<<(std::ostream& out, const Row& row) { return out << row.name; }

double halved(double time_s, double half_life_s) { return std::pow(0.5, time_s / half_life_s); }

// The answer of a first-order lag to start + rise (1 - exp(-t/warm)), in closed form.
double lagged_c(double t, double lag_s) {
  return start_c + rise_c * (1.0 - (warm_s * std::exp(-t / warm_s) - lag_s * std::exp(-t / lag_s)) / (warm_s - lag_s));
}

// The sum of what every change of the force since the beginning still leaves.
Disturbance creep(int axis, double tau_s) {
  struct Change {
    double time_s, size_g;
  };
  return [axis, tau_s, changes = std::vector<Change>(), force = 0.0, time = 1e9](const DisturbedMoment& m) mutable {
    if (m.time_s < time) {
      changes.clear();
      force = m.force_g[axis];
    }
    time = m.time_s;
    if (std::abs(m.force_g[axis] - force) > 1e-3) {
      changes.push_back({m.time_s, m.force_g[axis] - force});
      force = m.force_g[axis];
    }
    double left = 0.0;
    for (const Change& c : changes) left += c.size_g * std::exp(-(m.time_s - c.time_s) / tau_s);
    return to_accel(axis, ug * left);
  };
}

// By the trapezoidal rule over the middles of blocks.
Disturbance wave(int axis) {
  return [axis, angle = 0.0, time_s = 1e9, rate = 0.0](const DisturbedMoment& m) mutable {
    const double of_axis = m.rate_radps[axis];
    angle = m.time_s < time_s ? 0.0 : angle + 0.5 * (m.time_s - time_s) * (rate + of_axis);
    time_s = m.time_s;
    rate = of_axis;
    return to_gyro(axis, degph * std::sin(4.0 * 0.277 * angle));
  };
}

class EffectRow : public ::testing::TestWithParam<Row> {};

TEST_P(EffectRow, FindsWhatAnotherFormulaAdded) {
  const Row& row = GetParam();
  CompressedRecording recording = base().recording;
  disturb(recording, base().truth, [&, one = row.added](const DisturbedMoment& m) mutable {
    AddedReading added = one(m);
    added.gyro_radps *= row.value;
    added.accel_mps2 *= row.value;
    return added;
  });
  JointOptions options;
  options.fit_bias_instability = false;
  options.effects = {{find_effect(row.name), row.component, row.tau}};
  const JointResult fit = joint_estimate(recording, options);
  ASSERT_TRUE(fit.converged) << fit.message;
  ASSERT_EQ(fit.effects.size(), 1u);
  const EstimatedEffect& found = fit.effects[0];
  EXPECT_GT(std::abs(row.value), 6.0 * found.sigma) << "the recording hardly shows it, sigma " << found.sigma;
  EXPECT_NEAR(found.value, row.value, 4.0 * found.sigma + 0.03 * std::abs(row.value));
  EXPECT_NEAR(fit.whiteness.level, 1.0, 0.1);
}

double mean_c() { return base().recording.mean_temperature_c; }

INSTANTIATE_TEST_SUITE_P(
    Catalogue, EffectRow,
    ::testing::Values(
        Row{"gyro_scale_warm_up", 0, 960.0, 30.0,
            [](const DisturbedMoment& m) {
              return to_gyro(0, 1e-6 * m.rate_radps[0] * halved(m.time_s, 960.0 * std::log(2.0)));
            }},
        Row{"gyro_scale_drift", 1, 0.0, 15.0,
            [](const DisturbedMoment& m) { return to_gyro(1, m.rate_radps[1] * m.time_s / 3.6e9); }},
        Row{"accel_scale_warm_up", 0, 960.0, 20.0,
            [](const DisturbedMoment& m) {
              return to_accel(0, ug * m.force_g[0] * halved(m.time_s, 960.0 * std::log(2.0)));
            }},
        Row{"accel_scale_drift", 1, 0.0, 8.0,
            [](const DisturbedMoment& m) { return to_accel(1, ug * m.force_g[1] * m.time_s / 3600.0); }},
        Row{"gyro_wave_angle", 5, 0.0, 0.05, wave(2)}, Row{"accel_creep", 1, 150.0, 20.0, creep(1, 150.0)},
        Row{"accel_rectification", 2, 0.0, 150.0,
            [](const DisturbedMoment& m) { return to_accel(2, m.rate_radps.norm() > 0.0087 ? ug : 0.0); }},
        Row{"gyro_g_squared", 1, 0.0, 0.08,  // x_yy
            [](const DisturbedMoment& m) { return to_gyro(0, degph * std::pow(m.force_g[1], 2.0)); }},
        Row{"gyro_lock_in", 1, 5.0, 2.0,
            [](const DisturbedMoment& m) {
              const double w = m.rate_radps[1], w0 = 5.0 * degph;
              return to_gyro(1, 0.01 * w * w0 * w0 / (w0 * w0 + w * w));
            }},
        Row{"gyro_lock_in", 3, 5.0, 2.0,
            [](const DisturbedMoment& m) {
              AddedReading added;
              for (int axis = 0; axis < 3; ++axis) {
                const double w = m.rate_radps[axis], w0 = 5.0 * degph;
                added.gyro_radps[axis] = 0.01 * w * w0 * w0 / (w0 * w0 + w * w);
              }
              return added;
            }},
        Row{"gyro_bias_temperature_rate", 0, 0.0, 0.01,
            [](const DisturbedMoment& m) {
              return to_gyro(0, degph * 3600.0 * rise_c / warm_s * std::exp(-m.time_s / warm_s));
            }},
        Row{"accel_bias_temperature_rate", 1, 0.0, 1.0,
            [](const DisturbedMoment& m) {
              return to_accel(1, ug * 3600.0 * rise_c / warm_s * std::exp(-m.time_s / warm_s));
            }},
        Row{"gyro_bias_temperature_lag", 2, 300.0, 0.02,
            [](const DisturbedMoment& m) { return to_gyro(2, degph * (lagged_c(m.time_s, 300.0) - mean_c())); }},
        Row{"accel_bias_temperature_lag", 0, 1200.0, 3.0,
            [](const DisturbedMoment& m) { return to_accel(0, ug * (lagged_c(m.time_s, 1200.0) - mean_c())); }}));

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
  JointOptions options;
  options.fit_bias_instability = false;
  options.effects = {{find_effect("sample_period"), 0, 0.0}};
  const JointResult fit = joint_estimate(recording, options);
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
