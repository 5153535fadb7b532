// What the unit reads at rest, by hand, and how pulses are counted.
//
// Site of every number here: latitude 29.53 deg, g = 9.7914 m/s^2. Earth rate: north 7.292115e-5 cos L = 6.3448528e-5
// rad/s = 13.0871984 deg/h, up 7.292115e-5 sin L = 3.5941319e-5 rad/s = 7.4134292 deg/h. 1 deg/h = 1 arcsec/s.
// A sample lasts 5 ms; nominal pulses are 0.932920 arcsec and 0.0005 m/s, so that 1 deg/h is 0.005/0.93292 pulses a
// sample (north 0.0701411, up 0.0397324) and g is 9.7914 * 0.005 / 0.0005 = 97.914 pulses a sample.
#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_sensors.h"

namespace turncal {
namespace {

constexpr double north = 0.0701410537, up = 0.0397323948, gravity = 97.914;

struct RestCase {
  const char* name;
  double heading_deg, pitch_deg, roll_deg;
  Triple gyro, accel;  // pulses a sample
};

class RigAtRest : public testing::TestWithParam<RestCase> {};

TEST_P(RigAtRest, ReadsEarthRateAndGravity) {
  RigConfig config = perfect_rig_config();
  config.table.power_on_deg = {GetParam().heading_deg, GetParam().pitch_deg, GetParam().roll_deg};
  Rig rig(config);
  const ImuSample sample = next_sample(rig);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(sample.gyro[i], GetParam().gyro[i], 1e-9) << "gyro " << i;
    EXPECT_NEAR(sample.accel[i], GetParam().accel[i], 1e-9) << "accelerometer " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Attitudes, RigAtRest,
    testing::Values(
        RestCase{"level_north", 0, 0, 0, {north, up, 0}, {0, gravity, 0}},         // x north, y up, z east
        RestCase{"level_west", -90, 0, 0, {0, up, north}, {0, gravity, 0}},        // x west, z north
        RestCase{"level_east", 90, 0, 0, {0, up, -north}, {0, gravity, 0}},        // x east, z south
        RestCase{"nose_up", 0, 90, 0, {up, -north, 0}, {gravity, 0, 0}},           // x up, y south
        RestCase{"nose_down", 0, -90, 0, {-up, north, 0}, {-gravity, 0, 0}},       // x down, y north
        RestCase{"right_side_down", 0, 0, 90, {north, 0, -up}, {0, 0, -gravity}},  // z down, y east
        RestCase{"upside_down", 0, 0, 180, {north, -up, 0}, {0, -gravity, 0}},
        RestCase{"west_left_down", -90, 0, -90, {0, -north, up}, {0, 0, gravity}},  // z up, y south: step 4 and 9
        // P = 30: x is 30 deg above north: earth rate on x cos 30 * north + sin 30 * up, on y -sin 30 north + cos 30
        // up.
        RestCase{"thirty", 0, 30, 0, {0.0806101317, -0.0006612636, 0}, {48.957, 84.7960113861, 0}},
        RestCase{"turned_once_more", 360, 0, -360, {north, up, 0}, {0, gravity, 0}}),
    [](const auto& tested) { return std::string(tested.param.name); });

// n = {{0.9331, 0.002, 0}, {0, 0.9325, 0}, ...}, N01 = 0.1 deg/h:
//   y: 7.4134292 * 0.005 / 0.9325 = 0.0397502904 pulses
//   x: (13.0871984 * 0.005 + 0.1 * 0.005 - 0.002 * 0.0397502904) / 0.9331 = 0.0705781709 pulses
// a = {{1, 7e-4, 0}, {0, 1.02, 0}, ...}, A02 = 0.004 g:
//   y: (9.7914 + 0.004 * 9.80665) * 0.005 / (1.02 * 0.0005) = 96.3786921569,  x: -7e-4 * 96.3786921569 = -0.0674650845
TEST(RigSensors, CountsInvertTheParameterEquations) {
  RigConfig config = perfect_rig_config();
  config.truth[0] = 0.1;      // N01
  config.truth[4] = 0.004;    // A02
  config.truth[6] = 0.9331;   // n11
  config.truth[7] = 0.002;    // n12
  config.truth[10] = 0.9325;  // n22
  config.truth[16] = 7e-4;    // a12
  config.truth[19] = 1.02;    // a22
  Rig rig(config);
  const ImuSample sample = next_sample(rig);
  EXPECT_NEAR(sample.gyro[0], 0.0705781709, 1e-9);
  EXPECT_NEAR(sample.gyro[1], 0.0397502904, 1e-9);
  EXPECT_NEAR(sample.accel[0], -0.0674650845, 1e-9);
  EXPECT_NEAR(sample.accel[1], 96.3786921569, 1e-9);
  EXPECT_EQ(rig.truth()[16], 7e-4);
}

// base tilted about east by 3' = 8.7266e-4 rad: x rises by it.
TEST(RigSensors, BaseTiltIsFelt) {
  RigConfig config = perfect_rig_config();
  config.table_errors.tilt_east_arcmin = 3.0;
  Rig rig(config);
  EXPECT_NEAR(rig.attitude_nb()[3], 8.72664e-4, 1e-9);
}

TEST(RigSensors, QuantisedSumStaysWithinAPulseOfTheRealSum) {
  for (const RigQuantisation quantisation : {RigQuantisation::floor, RigQuantisation::round}) {
    RigConfig real = default_rig_config();
    real.quantisation = RigQuantisation::off;
    RigConfig counted = real;
    counted.quantisation = quantisation;
    Rig real_rig(real), counted_rig(counted);
    Triple gyro_difference{}, accel_difference{};
    for (Rig* rig : {&real_rig, &counted_rig}) rig->command_move(Axis::roll, 100.0, 10.0, 10.0);
    for (int i = 0; i < 5000; ++i) {
      const ImuSample a = next_sample(real_rig), b = next_sample(counted_rig);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(b.gyro[axis], std::floor(b.gyro[axis]));
        EXPECT_EQ(b.accel[axis], std::floor(b.accel[axis]));
        gyro_difference[axis] += a.gyro[axis] - b.gyro[axis];
        accel_difference[axis] += a.accel[axis] - b.accel[axis];
        const double low = quantisation == RigQuantisation::floor ? 0.0 : -0.5;
        for (double difference : {gyro_difference[axis], accel_difference[axis]}) {
          ASSERT_GE(difference, low - 1e-7) << i;
          ASSERT_LT(difference, low + 1.0 + 1e-7) << i;
        }
      }
    }
  }
}

// T = 24 + 6 (1 - exp(-t/2400)): 24.000 at first, after 2400 s 24 + 6 * 0.6321206 = 27.7927.
TEST(RigSensors, TemperatureIsRecordedToAThousandth) {
  Rig rig(default_rig_config());
  std::vector<ImuSample> samples(480001);
  rig.advance(samples);
  EXPECT_EQ(samples.front().temperature_c, 24.000f);
  EXPECT_EQ(samples.back().temperature_c, 27.793f);
}

TEST(RigTruth, DrawsDependOnTheSeedAndOnNothingElse) {
  RigConfig one = default_rig_config(), two = default_rig_config(), keyed = default_rig_config();
  two.seed = 2;
  keyed.truth[3] = 0.0;
  keyed.table_errors.north_arcmin = 0.0;
  keyed.noise.gyro_random_walk_deg_per_rt_h = 0.0;
  EXPECT_EQ(Rig(one).truth(), Rig(one).truth());
  EXPECT_NE(Rig(one).truth(), Rig(two).truth());
  std::array<double, 24> expected = Rig(one).truth();
  expected[3] = 0.0;
  EXPECT_EQ(Rig(keyed).truth(), expected);
  auto errors = Rig(one).table_errors();
  for (auto& [name, value] : errors)
    if (name == "north_arcmin") value = 0.0;
  EXPECT_EQ(Rig(keyed).table_errors(), errors);
}

// c = 2 ug/C and 100 ppm/C referred to 24 C, moved to 27 C: A02 takes up 6 ug and the row 300 ppm; the two rigs' units
// are the same unit, so the counts must be the same.
TEST(RigTruth, TruthAtAnotherReferenceTemperatureIsTheSameUnit) {
  RigConfig config = default_rig_config();
  config.noise = perfect_rig_config().noise;
  config.quantisation = RigQuantisation::off;
  config.effects.accel_bias_temperature[1] = 2.0;
  config.effects.gyro_bias_temperature[0] = 0.01;
  Rig rig(config);
  const std::array<double, 24> moved = rig.truth_at_reference(27.0);
  EXPECT_NEAR(moved[4] - rig.truth()[4], 6e-6, 1e-15);
  EXPECT_NEAR(moved[0] - rig.truth()[0], 0.03, 1e-15);
  RigConfig other = config;
  other.temperature.reference_c = 27.0;
  for (std::size_t i = 0; i < 24; ++i) other.truth[i] = moved[i];
  Rig same(other);
  const ImuSample a = next_sample(rig), b = next_sample(same);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(a.gyro[i], b.gyro[i], 1e-13);
    EXPECT_NEAR(a.accel[i], b.accel[i], 1e-12);
  }
  config.effects.gyro_scale_temperature[0] = 100.0;
  EXPECT_NEAR(Rig(config).truth_at_reference(27.0)[6] * 1.0003, Rig(config).truth()[6], 1e-15);
}

}  // namespace
}  // namespace turncal
