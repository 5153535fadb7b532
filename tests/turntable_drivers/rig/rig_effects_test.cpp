// Size and sign of every effect on one sample, by hand.
//
// At rest: g = 9.80665 m/s^2 so that f is in g; P = 30 deg unless said otherwise: f = (0.5, 0.8660254, 0) g, earth rate
// in body axes (cos 30 * 13.0871984 + sin 30 * 7.4134292, -sin 30 * 13.0871984 + cos 30 * 7.4134292, 0) =
// (15.0405610, -0.1233812, 0) deg/h; field (cos 30 * 0.34 - sin 30 * 0.36, -sin 30 * 0.34 - cos 30 * 0.36, -0.015) =
// (0.1144486, -0.4817691, -0.015) gauss. Effects of temperature: T - T_ref = 5 C. Sample 72 000 has its middle at
// 360.0025 s = 0.1000007 h.
#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {
namespace {

constexpr double degph = 3.14159265358979323846 / 180.0 / 3600.0;  // rad/s
constexpr double ug = 9.80665e-6;                                  // m/s^2

struct Reading {
  Triple gyro_degph{}, accel_ug{};
};

RigConfig base_config(double pitch_deg) {
  RigConfig config = perfect_rig_config();
  config.site.gravity_mps2 = 9.80665;
  config.table.power_on_deg[1] = pitch_deg;
  config.temperature.rise_c = 0.0;
  config.temperature.reference_c = config.temperature.start_c - 5.0;
  return config;
}

using Prepare = std::function<void(Rig&)>;

// Reading of one sample after `prepare`.
Reading read_after(const RigConfig& config, const Prepare& prepare) {
  Rig rig(config);
  prepare(rig);
  const ImuSample sample = next_sample(rig);
  Reading reading;
  for (std::size_t i = 0; i < 3; ++i) {
    reading.gyro_degph[i] = sample.gyro[i] * 0.932920 / 0.005;  // arcsec/s
    reading.accel_ug[i] = sample.accel[i] * 0.0005 / 0.005 / ug;
  }
  return reading;
}

Reading difference(const RigConfig& with, const RigConfig& without, const Prepare& prepare) {
  Reading a = read_after(with, prepare), b = read_after(without, prepare);
  for (std::size_t i = 0; i < 3; ++i) {
    a.gyro_degph[i] -= b.gyro_degph[i];
    a.accel_ug[i] -= b.accel_ug[i];
  }
  return a;
}

void pass(Rig& rig, std::size_t samples) {
  std::vector<ImuSample> out(samples);
  if (samples > 0) rig.advance(out);
}

void expect_near(const Reading& reading, const Triple& gyro_degph, const Triple& accel_ug, double relative = 1e-6) {
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(reading.gyro_degph[i], gyro_degph[i], relative * std::abs(gyro_degph[i]) + 2e-7) << "gyro " << i;
    EXPECT_NEAR(reading.accel_ug[i], accel_ug[i], relative * std::abs(accel_ug[i]) + 2e-6) << "accelerometer " << i;
  }
}

struct EffectCase {
  const char* key;
  double value;
  double pitch_deg;
  Triple gyro_degph, accel_ug;
  std::size_t after_samples = 0;
};

class RigEffectAtRest : public testing::TestWithParam<EffectCase> {};

TEST_P(RigEffectAtRest, HasItsSizeAndSign) {
  const EffectCase& c = GetParam();
  const RigConfig without = base_config(c.pitch_deg);
  RigConfig with = without;
  double* value = find_effect(with.effects, c.key);
  ASSERT_NE(value, nullptr);
  *value = c.value;
  expect_near(difference(with, without, [&](Rig& rig) { pass(rig, c.after_samples); }), c.gyro_degph, c.accel_ug);
  ASSERT_EQ(Rig(with).truth_effects().size(), 1u);
  EXPECT_EQ(Rig(with).truth_effects()[0], std::make_pair(std::string(c.key), c.value));
}

INSTANTIATE_TEST_SUITE_P(
    Catalogue, RigEffectAtRest,
    testing::Values(
        EffectCase{"accel_second_order.x", 10, 30, {}, {2.5, 0, 0}},  // 10 * 0.5^2
        EffectCase{"accel_second_order.x", 10, -30, {}, {2.5, 0, 0}},
        EffectCase{"accel_second_order.y", 10, 30, {}, {0, 7.5, 0}},  // 10 * 0.75
        EffectCase{"accel_scale_asymmetry.x", 10, 30, {}, {5, 0, 0}},
        EffectCase{"accel_scale_asymmetry.x", 10, -30, {}, {5, 0, 0}},
        EffectCase{"accel_odd_quadratic.x", 10, -30, {}, {-2.5, 0, 0}},         // 10 * -0.5 * 0.5
        EffectCase{"accel_third_order.x", 10, -30, {}, {-1.25, 0, 0}},          // 10 * -0.125
        EffectCase{"accel_cross_coupling.y_xy", 10, 30, {}, {0, 4.330127, 0}},  // 10 * 0.5 * 0.8660254
        EffectCase{"accel_cross_coupling.z_xy", 10, -30, {}, {0, 0, -4.330127}},
        EffectCase{"accel_bias_temperature.z", 2, 30, {}, {0, 0, 10}},         // 2 * 5
        EffectCase{"accel_scale_temperature.y", 2, 30, {}, {0, 8.660254, 0}},  // 2 * 5 * 0.8660254
        EffectCase{"accel_bias_drift.x", 100, 30, {}, {10.000069, 0, 0}, 72000},
        EffectCase{"gyro_g_sensitivity.zx", 0.2, 30, {0, 0, 0.1}, {}},  // 0.2 * 0.5
        EffectCase{"gyro_g_sensitivity.xy", 0.2, 30, {0.1732051, 0, 0}, {}},
        EffectCase{"gyro_scale_asymmetry.y", 1e6, 30, {0, 0.1233812, 0}, {}},  // abs(-0.1233812)
        EffectCase{"gyro_bias_temperature.x", 0.01, 30, {0.05, 0, 0}, {}},
        EffectCase{"gyro_scale_temperature.x", 1e4, 30, {0.7520281, 0, 0}, {}},  // 1e-2 * 5 * 15.0405610
        EffectCase{"gyro_bias_drift.z", 1, 30, {0, 0, 0.1000007}, {}, 72000},
        EffectCase{"gyro_warm_up.x", 0.1, 30, {0.0740817, 0, 0}, {}, 72000},  // 0.1 exp(-360.0025/1200)
        EffectCase{"gyro_magnetic.xy", 0.01, 30, {-0.0048177, 0, 0}, {}},     // 0.01 * -0.4817691
        EffectCase{"gyro_magnetic.yx", 0.01, 30, {0, 0.0011445, 0}, {}},
        EffectCase{"gyro_magnetic.zz", 0.01, 30, {0, 0, -0.00015}, {}},
        EffectCase{"earth_rate.north", 0.02, 30, {0.0173205, -0.01, 0}, {}},
        EffectCase{"earth_rate.up", 0.02, 30, {0.01, 0.0173205, 0}, {}},
        // E f = (0, 0, 3600 arcsec/g * 0.5 g = 8.7266463e-3 rad); (E f) x w = (-8.7266e-3 * -0.1233812, 8.7266e-3 *
        // 15.0405610, 0)
        EffectCase{"gyro_accel_flexure.zx", 3600, 30, {0.0010767, 0.1312537, 0}, {}}),
    [](const auto& tested) {
      std::string name = tested.param.key;
      for (char& c : name)
        if (c == '.') c = '_';
      return name + (tested.param.pitch_deg < 0 ? "_nose_down" : "_nose_up");
    });

// The unit warms up by 6 (1 - exp(-t/2400)) C: at 360.0025 s by 9 exp(-0.15) C/h. On a chamber's ramp the thermometer's own steps say the rate.
TEST(RigEffects, OfTheTemperaturesRate) {
  RigConfig without = base_config(30);
  without.temperature.rise_c = 6.0;
  RigConfig with = without;
  *find_effect(with.effects, "gyro_bias_temperature_rate.y") = 0.01;
  *find_effect(with.effects, "accel_bias_temperature_rate.z") = 2.0;
  const double warming = 9.0 * std::exp(-360.0025 / 2400.0);
  expect_near(difference(with, without, [](Rig& rig) { pass(rig, 72000); }), {0, 0.01 * warming, 0},
              {0, 0, 2.0 * warming});
  without.temperature.rise_c = with.temperature.rise_c = 0.0;
  double before_c = 0.0, after_c = 0.0;
  const Reading on_ramp = difference(with, without, [&](Rig& rig) {
    rig.command_chamber(60.0, 1.0, true);
    pass(rig, 120000);
    before_c = rig.temperature_c();
    pass(rig, 200);
    after_c = rig.temperature_c();
  });
  const double rising = 3600.0 * (after_c - before_c);
  EXPECT_GT(rising, 30.0);
  expect_near(on_ramp, {0, 0.01 * rising, 0}, {0, 0, 2.0 * rising}, 2e-3);
}

TEST(RigEffects, EveryKeyOfTheCatalogueExists) {
  EXPECT_EQ(rig_effect_keys().size(), 16u * 3u + 5u * 9u + 1u + 2u);
  RigEffects effects;
  for (const std::string& key : rig_effect_keys()) EXPECT_NE(find_effect(effects, key), nullptr) << key;
  EXPECT_EQ(find_effect(effects, "accel_second_order.w"), nullptr);
  EXPECT_EQ(find_effect(effects, "accel_second_order"), nullptr);
}

// In motion. The pitch axis starts at -5 deg (or +5) and passes 0 after 1 s at +10 deg/s (-10), where w = (0, 0,
// +-0.1745329) rad/s and f = (0, 1, 0) g; during the first second its acceleration is 0.1745329 rad/s^2.
Reading turning(const char* key, double value, bool forward, std::size_t sample) {
  const RigConfig without = base_config(forward ? -5.0 : 5.0);
  RigConfig with = without;
  *find_effect(with.effects, key) = value;
  return difference(with, without, [&](Rig& rig) {
    rig.command_move(Axis::pitch, forward ? 85.0 : -85.0, 10.0, 10.0);
    pass(rig, sample);
  });
}

TEST(RigEffects, InMotionTheyHaveTheirSizeAndSign) {
  const struct {
    const char* key;
    double value;
    bool forward;
    std::size_t sample;
    Triple gyro_degph, accel_ug;
    double relative;
  } cases[] = {
      // tau (w x f) = 1e-3 * 0.1745329 z x (1 g) y = -1e-3 * 0.1745329 g x = -174.5329 ug. In the mean over the sample P is 0.025 deg and
      // f_x = 4.3633e-4 g: w_z f_x = 0.07615 ug on y; the earth's rate gives w_x f_y = 6.34485e-5 * 1e-3 g on z.
      {"accel_delay.tau", 1.0, true, 200, {}, {-174.5329, 0.0761544, 0.0634485}, 1e-5},
      {"accel_delay.tau", 1.0, false, 200, {}, {174.5329, 0.0761544, 0.0634485}, 1e-5},
      // On the circle: -w^2 r = -0.0304617 * 0.1 m = -3.046174e-3 m/s^2 = -310.6234 ug; earth rate adds 2 w_z W_z = 0 at H = 0.
      {"accel_size_effect.x_rx", 100.0, true, 200, {}, {-310.6234, 0, 0}, 1e-5},
      // y accelerometer 0.1 m ahead: w' x r = 0.1745329 z x 0.1 x = +0.01745329 m/s^2 y = 1779.7406 ug, with the sign of the motion; and the
      // cross products of w_z with the earth rate, 2e-5 of it.
      {"accel_size_effect.y_rx", 100.0, true, 50, {}, {0, 1779.7406, 0}, 1e-4},
      {"accel_size_effect.y_rx", 100.0, false, 50, {}, {0, -1779.7406, 0}, 1e-4},
      // 5e-6 * 0.1745329 rad/s = 8.726646e-7 rad/s = 0.18 deg/h both ways
      {"gyro_scale_asymmetry.z", 5.0, true, 200, {0, 0, 0.18}, {}, 1e-6},
      {"gyro_scale_asymmetry.z", 5.0, false, 200, {0, 0, 0.18}, {}, 1e-6},
      // 50e-6 * 0.1745329 rad/s at 10 deg/s = 8.726646e-6 rad/s = 1.8 deg/h with the sign of the rate
      {"gyro_rate_nonlinearity.z", 50.0, true, 200, {0, 0, 1.8}, {}, 1e-6},
      {"gyro_rate_nonlinearity.z", 50.0, false, 200, {0, 0, -1.8}, {}, 1e-6}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.key);
    expect_near(turning(c.key, c.value, c.forward, c.sample), c.gyro_degph, c.accel_ug, c.relative);
  }
}

// 10 ug/g on y with f_y = 1 g: nothing before the first motion and during it, then 10 exp(-t/5). The move of 10 deg
// lasts 2 s: sample 400 begins where it ends, its middle is 2.5 ms later: 10 exp(-0.0005) = 9.995 ug; 5 s later 3.677
// ug.
TEST(RigEffects, RelaxationFollowsTheEndOfAMotion) {
  const RigConfig without = base_config(-10.0);
  RigConfig with = without;
  *find_effect(with.effects, "post_rotation_relaxation.y") = 10.0;
  const auto at = [&](std::size_t sample) {
    return difference(with, without,
                      [&](Rig& rig) {
                        pass(rig, 1000);
                        rig.command_move(Axis::pitch, 0.0, 10.0, 10.0);
                        pass(rig, sample);
                      })
        .accel_ug[1];
  };
  EXPECT_EQ(difference(with, without, [](Rig& rig) { pass(rig, 100); }).accel_ug[1], 0.0);
  EXPECT_EQ(at(100), 0.0);
  EXPECT_NEAR(at(400), 9.9950012, 1e-5);
  EXPECT_NEAR(at(1400), 9.9950012 * std::exp(-1.0), 1e-5);
}

TEST(RigEffects, OutsideTheCatalogue) {
  const RigConfig without = base_config(30.0);
  RigConfig with = without;
  with.outside.gyro_bias_step = {2, 10.0, 0.05};
  with.outside.accel_bias_step = {0, 20.0, 7.0};
  expect_near(difference(with, without, [](Rig& rig) { pass(rig, 1999); }), {}, {});
  expect_near(difference(with, without, [](Rig& rig) { pass(rig, 2000); }), {0, 0, 0.05}, {});
  expect_near(difference(with, without, [](Rig& rig) { pass(rig, 4000); }), {0, 0, 0.05}, {7, 0, 0});

  with = without;
  with.outside.gyro_angle_periodic = {1, Axis::pitch, 2, 0.1, 30.0};  // 0.1 sin(2 * 30 + 30) = 0.1
  expect_near(difference(with, without, [](Rig&) {}), {0, 0.1, 0}, {});

  with = without;
  with.outside.accel_time_periodic = {1, 8.0, 20.0, 0.0};  // at 5.0025 s of 20 s: 8 cos(0.045 deg)
  expect_near(difference(with, without, [](Rig& rig) { pass(rig, 1000); }), {}, {0, 8.0, 0}, 1e-5);
  expect_near(difference(with, without, [](Rig& rig) { pass(rig, 3000); }), {}, {0, -8.0, 0}, 1e-5);
}

// x remembers which way it was last beyond 0.5 g: P = 0 (nothing yet), then up, back to 0: +, then down, back to 0: -.
TEST(RigEffects, HysteresisRemembersTheLastWayUp) {
  const RigConfig without = base_config(0.0);
  RigConfig with = without;
  with.outside.accel_hysteresis = {0, 20.0};
  const auto after = [&](std::vector<double> targets_deg) {
    return difference(with, without,
                      [&](Rig& rig) {
                        for (double target_deg : targets_deg) {
                          rig.command_move(Axis::pitch, target_deg, 50.0, 100.0);
                          pass(rig, 1200);
                        }
                      })
        .accel_ug[0];
  };
  EXPECT_NEAR(after({0}), 0.0, 1e-6);
  EXPECT_NEAR(after({29, 0}), 0.0, 1e-6);
  EXPECT_NEAR(after({45, 0}), 20.0, 1e-6);
  EXPECT_NEAR(after({45, -45, 0}), -20.0, 1e-6);
}

}  // namespace
}  // namespace turncal
