#include "calib/fleet/unit_statistics.h"

#include "imu_io/recordings/statistics_file.h"
#include "tests/fleet/drawn_fleet.h"
#include "tests/imu_io/recording_samples.h"
#include "tests/test.h"

namespace turncal {
namespace {

// An effect refitted from the sums is the one that the whole estimate finds, and moves the parameters as it does.
TEST(UnitStatistics, RefitsAsTheEstimateDoes) {
  RigConfig config;
  *find_effect(config.effects, "accel_second_order.x") = 12.0;
  const RigRecording made = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  const JointResult base = joint_estimate(made.recording);
  const UnitStatistics u = unit_statistics(made.recording, base);
  const int k = column_of(u, "accel_second_order.x");
  ASSERT_GE(k, 0);
  const double value = u.s[k] / u.Q(k, k);

  JointOptions options;
  for (const EffectColumn& c : catalogue_columns(made.recording.info))
    if (c.key() == "accel_second_order.x") options.effects = {c};
  options.noise = base.noise;
  const JointResult whole = joint_estimate(made.recording, options);
  const double sigma = whole.effects.front().sigma;
  EXPECT_NEAR(value, whole.effects.front().value, 0.1 * sigma);
  EXPECT_NEAR(1.0 / std::sqrt(u.Q(k, k)), sigma, 0.02 * sigma);
  EXPECT_GT(value, 5.0 * sigma);
  const ParameterVector refitted = u.value + u.moves.col(k).cast<double>() * value,
                        expected = to_vector(whole.parameters);
  for (int p = 0; p < parameter_count; ++p)
    if (whole.sigma[p] > 0.0) {
      EXPECT_NEAR(refitted[p], expected[p], 0.1 * whole.sigma[p]) << parameter_keys[static_cast<std::size_t>(p)];
    }
}

// Whatever the biases did between two recordings, of two walks, so that what one bias imitates in one it does not in the other.
TEST(UnitStatistics, OfSeveralRecordingsIsOfWhatTheyHaveInCommon) {
  RigConfig config;
  *find_effect(config.effects, "accel_second_order.x") = 12.0;
  const RigRecording first = record_on_rig(must_read_sequence("short_demo.seq"), config);
  config.noise_seed = 2;
  config.truth[1] = 0.3;    // N02, deg/h
  config.truth[3] = 0.002;  // A01, g
  const RigRecording second = record_on_rig(must_read_sequence("forty_minutes.seq"), config);
  const UnitStatistics one = unit_statistics(first.recording, joint_estimate(first.recording));
  const std::optional<UnitStatistics> both = unit_statistics({&first.recording, &second.recording});
  ASSERT_TRUE(both.has_value());
  const int k = column_of(one, "accel_second_order.x");
  ASSERT_EQ(column_of(*both, "accel_second_order.x"), k);
  EXPECT_GT(both->Q(k, k), 2.0 * one.Q(k, k));
  EXPECT_NEAR(both->s[k] / both->Q(k, k), 12.0, 4.0 / std::sqrt(both->Q(k, k)));
}

StatisticsFile example() {
  StatisticsFile s;
  s.file = test::make_parameter_file();
  s.file.unit_serial = "SN 1";
  s.file.add_further("record.station", "line 3");
  s.file.add_further("quality.covariance.N01", "1");
  s.statistics = statistics_of_one();
  return s;
}

TEST(StatisticsFile, ReadsWhatWasWritten) {
  const StatisticsFile s = example();
  const auto bytes = must(format_statistics(s));
  EXPECT_LE(bytes.size(), 100000U);
  const StatisticsFile read = must(parse_statistics(bytes, "f"));
  EXPECT_EQ(read.file.unit_serial, "SN 1");
  EXPECT_EQ(*find_further(read.file, "record.station"), "line 3");
  EXPECT_EQ(read.statistics.columns, s.statistics.columns);
  EXPECT_EQ(read.statistics.s, s.statistics.s);
  const Eigen::VectorXf scale = s.statistics.Q.diagonal().cwiseSqrt().cwiseInverse();
  EXPECT_LT((scale.asDiagonal() * (read.statistics.Q - s.statistics.Q) * scale.asDiagonal()).cwiseAbs().maxCoeff(),
            3e-7F);
  EXPECT_LT(((read.statistics.moves - s.statistics.moves).array() / s.statistics.moves.array().abs().max(1e-30F))
                .abs()
                .maxCoeff(),
            1.6e-5F);
}

TEST(StatisticsFile, RefusesWhatIsDamaged) {
  const auto bytes = must(format_statistics(example()));
  for (std::size_t at = 0; at < bytes.size(); at += 997) {
    auto damaged = bytes;
    damaged[at] ^= std::byte{0x10};
    EXPECT_FALSE(parse_statistics(damaged, "f").ok()) << at;
  }
  for (std::size_t length = 0; length < bytes.size(); length += 1009)
    EXPECT_FALSE(parse_statistics(std::span(bytes).first(length), "f").ok()) << length;
}

}  // namespace
}  // namespace turncal
