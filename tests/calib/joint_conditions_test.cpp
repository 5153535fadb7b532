// What the joint estimate must not be impressed by: gaps in a turn, a wrong heading, a unit that still turns when the first
// dwell begins, coarse gyros that count pulses, a unit mounted another way. And what it must refuse in plain words.
#include "calib/joint/joint_estimate.h"
#include "calib/joint/linear_motion.h"
#include "calib/statistics/clipping.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

RigConfig usual_unit(std::uint64_t seed = 21) {
  RigConfig config = default_rig_config();
  config.seed = seed;
  config.noise_seed = 400 + seed;
  return config;
}

RigRecording record(const RigConfig& config) { return record_on_rig(must_read_sequence("fourteen_step.seq"), config); }

const RigRecording& usual_run() {
  static const RigRecording made = record(usual_unit());
  return made;
}

const JointResult& clean_estimate() {
  static const JointResult result = joint_estimate(usual_run().recording);
  return result;
}

std::size_t third_turn() {
  const Segments& segments = usual_run().recording.segments;
  int turns = 0;
  for (std::size_t k = 0; k < segments.size(); ++k)
    if (segments[k].kind == SegmentKind::rotate && ++turns == 3) return k;
  return 0;
}

// 15 ms to 10 s. The sigmas are those of the run with that turn set aside, and those of three samples hardly differ from none.
TEST(JointConditions, AGapCostsWhatItsTurnKnewAndNoMore) {
  const Segment turn = usual_run().recording.segments[third_turn()];
  JointResult without_turn = clean_estimate();
  const auto& blocks = usual_run().recording.blocks;
  const auto in_turn =
      std::ranges::find_if(blocks, [&](const Block& b) { return b.start_sample >= turn.start_sample + 100; });
  without_turn.setup.breaks = {{std::size_t(in_turn - blocks.begin()), 1.0, 1.0}};
  JointOptions aside;
  aside.faults_of = &without_turn;
  aside.noise = clean_estimate().noise;
  const ParameterVector expected = joint_estimate(usual_run().recording, aside).sigma;

  for (const std::int64_t lost : {3, 20, 60, 300, 2000}) {
    RigConfig config = usual_unit();
    const std::int64_t sample = (turn.start_sample + turn.end_sample - lost) / 2;
    config.faults.push_back({.kind = RigFaultKind::lost_sample, .sample = sample, .count = lost});
    const RigRecording made = record(config);
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << lost << ": " << r.message;
    EXPECT_TRUE(r.whiteness.white) << lost << ": " << r.whiteness.message;
    EXPECT_GE(r.faults.size(), 1u) << lost;
    EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000) << lost;
    EXPECT_NEAR(r.noise.angle_random_walk.x() / clean_estimate().noise.angle_random_walk.x(), 1.0, 0.1) << lost;
    const ParameterVector error = to_vector(r.parameters) - to_vector(made.truth);
    for (const int k : r.free) {
      const auto& key = parameter_keys[k];
      EXPECT_LT(std::abs(error[k]), 4.0 * r.sigma[k]) << lost << " " << key;
      EXPECT_LT(r.sigma[k], 1.1 * expected[k]) << lost << " " << key;
      if (lost == 3) {
        EXPECT_LT(r.sigma[k], 1.05 * clean_estimate().sigma[k]) << key;
        EXPECT_EQ(r.faults.front().action.find("set aside"), std::string::npos) << r.faults.front().action;
      }
    }
  }
}

// The heading that is given is one to begin the search at, and not even that.
TEST(JointConditions, AWrongHeadingCostsNothing) {
  for (const double wrong_deg : {0.25, 2.0, -5.0, 90.0, 180.0}) {
    CompressedRecording recording = usual_run().recording;
    for (Segment& segment : recording.segments) segment.heading_deg += wrong_deg;
    const JointResult r = joint_estimate(recording);
    ASSERT_TRUE(r.converged) << wrong_deg << ": " << r.message;
    EXPECT_TRUE(r.whiteness.white);
    const ParameterVector difference = to_vector(r.parameters) - to_vector(clean_estimate().parameters);
    for (const int k : r.free) {
      const auto& key = parameter_keys[k];
      EXPECT_LT(std::abs(difference[k]), 0.02 * r.sigma[k]) << wrong_deg << " " << key;
      EXPECT_NEAR(r.sigma[k] / clean_estimate().sigma[k], 1.0, 0.01) << wrong_deg << " " << key;
    }
  }
}

// 20 deg in the first 5 s of the first alignment: the estimate begins where the unit rests.
TEST(JointConditions, AUnitThatStillTurnsAtFirst) {
  RigConfig config = usual_unit();
  config.faults.push_back({.kind = RigFaultKind::table_moved, .axis = 0, .size = 20.0, .rate_degps = 4.0});
  const RigRecording made = record(config);
  const JointResult r = joint_estimate(made.recording);
  ASSERT_TRUE(r.converged) << r.message;
  EXPECT_TRUE(r.undetermined.empty());
  EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
  EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000);
}

// 0.05 deg/sqrt(h) in pulses. What counts as determined follows from the noise, not from how the increments are written.
TEST(JointConditions, CoarseGyrosThatCountPulses) {
  for (const std::uint64_t seed : {22, 23}) {
    RigConfig config = usual_unit(seed);
    config.noise.gyro_random_walk_deg_per_rt_h = 0.05;
    const RigRecording made = record(config);
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << r.message;
    EXPECT_TRUE(r.undetermined.empty());
    EXPECT_NEAR(r.noise.angle_random_walk.mean() / radprs_per_degprh, 0.05, 0.004);
    EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000);
  }
}

// Of a clean triad one in twenty is given a bias instability (noise_fit.h); of sixteen, at most five in 99.9 % of all tests.
TEST(JointConditions, AnInstabilityThatIsNotThereIsNotInvented) {
  int invented = 0;
  for (std::uint64_t seed = 31; seed < 39; ++seed) {
    RigConfig config = usual_unit(seed);
    config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
    const JointResult r = joint_estimate(record(config).recording);
    invented += r.noise.gyro_bias_instability_radps > 0.0;
    invented += r.noise.accel_bias_instability_mps2 > 0.0;
  }
  EXPECT_LE(invented, 4);
}

// One too small to be kept is counted in sigma; one that is kept is in the filter already.
TEST(JointConditions, AnInstabilityThatIsNotSeenIsInTheSigma) {
  const JointResult& r = clean_estimate();
  ASSERT_FALSE(r.noise.has_bias_instability());
  const auto widened = [](const JointResult& of, int k) {
    return std::sqrt(of.covariance(k, k) / (of.covariance(k, k) - of.unseen_instability(k, k)));
  };
  for (int k = 0; k < 21; ++k) EXPECT_GE(widened(r, k), 1.0 - 1e-6) << k;
  for (int k = 3; k < 6;
       ++k) {  // 0.3 ug of flicker make the errors of A0 1.05 to 1.25 times the sigma without (docs/accuracy.md)
    EXPECT_GT(widened(r, k), 1.03) << k;
    EXPECT_LT(widened(r, k), 1.25) << k;
  }
  RigConfig config = usual_unit();
  config.noise.accel_bias_instability_ug = 5.0;
  config.noise.gyro_bias_instability_degph = 0.05;
  const JointResult seen = joint_estimate(record(config).recording);
  EXPECT_GT(seen.noise.accel_bias_instability_mps2, 0.0);
  EXPECT_GT(seen.noise.gyro_bias_instability_radps, 0.0);
  EXPECT_EQ(seen.unseen_instability.cwiseAbs().maxCoeff(), 0.0);
}

struct Grade {
  const char* name;
  double arw_deg_prh, vrw_ug_prhz, period_s, latitude_deg;
  RigQuantisation quantisation;
};
class AnyGrade : public testing::TestWithParam<Grade> {};

// What a unit of the grade, at the rate and the place can know is determined, its noise measured, and the errors what sigma says.
TEST_P(AnyGrade, IsEstimatedToItsSigma) {
  const Grade& grade = GetParam();
  RigConfig config = usual_unit(41);
  config.noise.gyro_random_walk_deg_per_rt_h = grade.arw_deg_prh;
  config.noise.accel_random_walk_ug_per_rt_hz = grade.vrw_ug_prhz;
  config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
  config.sample_period_s = grade.period_s;
  config.site.latitude_deg = grade.latitude_deg;
  config.quantisation = grade.quantisation;
  const RigRecording made = record(config);
  const JointResult r = joint_estimate(made.recording);
  ASSERT_TRUE(r.converged) << r.message;
  EXPECT_TRUE(r.undetermined.empty());
  EXPECT_TRUE(r.faults.empty()) << r.faults.front().what;
  EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
  EXPECT_NEAR(r.whiteness.level, 1.0, 0.1);  // at 50 Hz
  EXPECT_NEAR(r.noise.angle_random_walk.x() / radprs_per_degprh, grade.arw_deg_prh,
              3.5 * r.noise_fit->sigma_angle_random_walk.x() / radprs_per_degprh);
  EXPECT_NEAR(r.noise.velocity_random_walk.mean() / mpsprs_per_ugprHz / grade.vrw_ug_prhz, 1.0, 0.08);
  EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000);
}

INSTANTIATE_TEST_SUITE_P(JointConditions, AnyGrade,
                         testing::Values(Grade{"NavigationFarSouth", 0.002, 8.0, 0.005, -75.0, RigQuantisation::floor},
                                         Grade{"NavigationFarNorthReal", 0.002, 8.0, 0.005, 75.0, RigQuantisation::off},
                                         Grade{"NavigationAt50Hz", 0.002, 8.0, 0.02, -33.0, RigQuantisation::floor},
                                         Grade{"NavigationAt2kHz", 0.002, 8.0, 0.0005, 50.0, RigQuantisation::floor},
                                         Grade{"Tactical", 0.05, 50.0, 0.005, 45.0, RigQuantisation::off},
                                         Grade{"Mems", 0.3, 100.0, 0.005, 45.0, RigQuantisation::floor},
                                         Grade{"MemsOfADegree", 1.0, 200.0, 0.01, 45.0, RigQuantisation::off},
                                         Grade{"MemsOfThreeDegrees", 3.0, 200.0, 0.01, 45.0, RigQuantisation::off}),
                         [](const auto& grade) { return std::string(grade.param.name); });

// A count that falls short of a steady velocity, from anywhere; on the mean over a range, for one tooth more or less is not known.
TEST(JointConditions, QuantisationIsThatOfACountedVelocity) {
  constexpr int samples = 200;
  constexpr double pulse = 0.0005;
  const auto measured = [&](double teeth) {
    constexpr int phases = 200;
    double square = 0.0;
    double sum = 0.0;
    for (int phase = 0; phase < phases; ++phase) {
      double mean = 0.0;
      for (int k = 0; k < samples; ++k) {
        const double v = 0.618034 * phase + (k + 0.5) * teeth / samples;
        mean += (v - std::floor(v)) / samples;
      }
      sum += mean / phases;
      square += mean * mean / phases;
    }
    return pulse * pulse * (square - sum * sum);
  };
  const std::pair<double, double> ranges[] = {{0.02, 0.3}, {3.0, 9.0}, {20.0, 40.0}, {60.0, 75.0}, {90.0, 99.0}};
  for (const auto& [from, to] : ranges) {
    double expected = 0.0;
    double model = 0.0;
    constexpr int steps = 400;
    for (int i = 0; i < steps; ++i) {
      const double teeth = from + (to - from) * (i + 0.5) / steps;
      expected += measured(teeth);
      model += quantisation_variance(teeth + 3.0 * samples, samples, pulse);
    }
    EXPECT_NEAR(model / expected, 1.0, 0.25) << from;
  }
}

CompressedRecording seen_from(const CompressedRecording& recording, const Eigen::Matrix3d& M) {
  CompressedRecording other = recording;
  for (Block& b : other.blocks) {
    for (Eigen::Vector3d* v : {&b.gyro, &b.accel, &b.gyro_time, &b.accel_time, &b.coning}) *v = M.transpose() * *v;
    b.sculling = M.transpose() * b.sculling * M;
  }
  return other;
}

TEST(JointConditions, AUnitMountedAnotherWayIsSeenAndCalibrated) {
  const Eigen::Matrix3d about_up = Eigen::AngleAxisd(pi / 2.0, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const JointResult r = joint_estimate(seen_from(usual_run().recording, about_up));
  EXPECT_EQ(r.start.mounting_text, "turned by 90 deg about up");
  ASSERT_TRUE(r.converged) << r.message;
  EXPECT_TRUE(r.whiteness.white);
  EXPECT_TRUE(r.undetermined.empty());
}

// One gyro, all of them, or two that are exchanged: the table's turns say which.
CompressedRecording read_by(CompressedRecording recording, const Eigen::Matrix3d& reads) {
  for (Block& b : recording.blocks) {
    b.gyro = reads * b.gyro;
    b.gyro_time = reads * b.gyro_time;
    b.coning = reads.determinant() * (reads * b.coning);
    b.sculling = reads * b.sculling;
  }
  return recording;
}

// With the fourteen steps, and with forty minutes, where an estimate with them settles.
TEST(JointConditions, GyrosThatReadAnotherAxisAreSaid) {
  Eigen::Matrix3d one = Eigen::Matrix3d::Identity(), two = one, exchanged = Eigen::Matrix3d::Zero(), cyclic = exchanged;
  one(2, 2) = two(0, 0) = two(1, 1) = -1.0;
  exchanged(0, 1) = exchanged(1, 0) = exchanged(2, 2) = 1.0;
  cyclic(0, 1) = cyclic(1, 2) = cyclic(2, 0) = 1.0;
  RigConfig config = default_rig_config();
  config.seed = 71;
  const RigRecording short_one = record_on_rig(must_read_sequence("forty_minutes.seq"), config);
  struct Case {
    const RigRecording& made;
    Eigen::Matrix3d reads;  // of the true rates
    const char* said;
  };
  for (const Case& c :
       {Case{usual_run(), one, "the rate about z is what gyro z reads, reversed"},
        {usual_run(), -Eigen::Matrix3d::Identity(),
         "the rate about x is what gyro x reads, reversed, the rate about y"},
        {usual_run(), exchanged, "the rate about x is what gyro y reads, the rate about y is what gyro x reads"},
        {short_one, exchanged, "the rate about x is what gyro y reads"},
        {short_one, cyclic, "the rate about x is what gyro z reads"},
        {short_one, two, "the rate about x is what gyro x reads, reversed"}}) {
    const JointResult r = joint_estimate(read_by(c.made.recording, c.reads));
    EXPECT_FALSE(r.converged) << c.said;
    EXPECT_NE(r.message.find(c.said), std::string::npos) << r.message;
  }
}

TEST(JointConditions, GravityWithTheWrongSignIsRefused) {
  CompressedRecording recording = usual_run().recording;
  for (Block& b : recording.blocks) {
    b.accel = -b.accel;
    b.accel_time = -b.accel_time;
    b.sculling = -b.sculling;
  }
  const JointResult r = joint_estimate(recording);
  EXPECT_FALSE(r.converged);
  EXPECT_NE(r.message.find("gravity has the wrong sign"), std::string::npos) << r.message;
}

// The nominal weight of a count is 0.93 arcsec; the table's turns say that it is another. Of 4 arcsec a count, some of
// the quantisation counts as random walk: the sigmas come out too large.
TEST(JointConditions, ACounterOfAnotherWeightIsSeenByTheTurns) {
  for (const double weight : {2.0, 4.0}) {
    RigConfig config = usual_unit(106);
    config.noise_seed = 900006;
    config.gyro_pulse_arcsec = weight;
    const RigRecording made = record(config);
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << weight << ": " << r.message;
    EXPECT_TRUE(r.faults.empty()) << weight << ": " << r.faults.front().what;
    EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000) << weight;
  }
}

// ---- joint faults ----

// Bad data in a run of the rig: found, named with its sample, cut out, and the parameters stay within their sigma.

RigConfig eleventh_unit() {
  RigConfig config = default_rig_config();
  config.seed = 11;
  config.noise_seed = 311;
  return config;
}

// The middle of the n-th segment of a kind.
std::int64_t middle_of(SegmentKind kind, int n) {
  static const RigRecording clean = record_on_rig(fourteen_steps(), eleventh_unit());
  for (const Segment& s : clean.recording.segments)
    if (s.kind == kind && n-- == 0) return (s.start_sample + s.end_sample) / 2;
  ADD_FAILURE() << "no such segment";
  return 0;
}

RigFault fault(RigFaultKind kind, std::int64_t sample, double size = 0.0, int axis = 0, bool hidden = false) {
  return {.kind = kind, .sample = sample, .axis = axis, .size = size, .hidden = hidden};
}

struct Bad {
  const char* name;
  RigFaultKind kind;
  SegmentKind where;
  double size;
  int axis;
  bool hidden;
  bool costs;  // whether the parameters would have been wrong if nobody had looked for it
};

class BadData : public testing::TestWithParam<Bad> {};

TEST_P(BadData, IsFoundNamedAndCostsNothing) {
  const Bad& bad = GetParam();
  for (const int which : {6, 31}) {
    const std::int64_t sample = middle_of(bad.where, which);
    RigConfig config = eleventh_unit();
    config.faults.push_back(fault(bad.kind, sample, bad.size, bad.axis, bad.hidden));
    const RigRecording made = record_on_rig(fourteen_steps(), config);
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << r.message;
    ASSERT_EQ(r.faults.size(), 1u) << "segment " << which << ", sample " << sample;
    const Fault& found = r.faults.front();
    EXPECT_LE(found.first_sample, sample + 1) << found.what;
    EXPECT_GE(found.last_sample, sample - 1) << found.what;
    EXPECT_LT(found.last_sample - found.first_sample, 9000) << found.what;  // the turn or the second, not the whole run
    EXPECT_FALSE(found.what.empty());
    EXPECT_FALSE(found.action.empty());
    EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000) << found.what << " in segment " << which;

    JointOptions blind;
    blind.look_for_faults = false;
    JointResult fooled = joint_estimate(made.recording, blind);
    if (bad.costs) {  // its own covariance has the fault for noise
      fooled.covariance = r.covariance;
      EXPECT_GT(nees(fooled, made.truth), chi_square_21_one_in_1000) << which;
    }
  }
}

// Faults that the raw samples show need no look at innovations: nothing to compare with.
INSTANTIATE_TEST_SUITE_P(
    Faults, BadData,
    testing::Values(
        Bad{"GapInATurn", RigFaultKind::lost_sample, SegmentKind::rotate, 0.0, 0, false, false},
        Bad{"GapInATurnWithoutCounter", RigFaultKind::lost_sample, SegmentKind::rotate, 0.0, 0, true, true},
        Bad{"DuplicateInATurn", RigFaultKind::duplicated_sample, SegmentKind::rotate, 0.0, 0, true, true},
        Bad{"GlitchOfAMilliradianInADwell", RigFaultKind::gyro_glitch, SegmentKind::still, 1.0, 2, false, false},
        Bad{"GlitchOfAMilliradianInATurn", RigFaultKind::gyro_glitch, SegmentKind::rotate, 1.0, 1, false, false},
        Bad{"KnockInADwell", RigFaultKind::velocity_knock, SegmentKind::still, 0.05, 0, false, false},
        Bad{"KnockInATurn", RigFaultKind::velocity_knock, SegmentKind::rotate, 0.05, 1, false, false}),
    [](const auto& bad) { return std::string(bad.param.name); });

// A gyro that stands at the end of its range in the table's turns, at 80 % of their 10 deg/s: those turns are set aside, and what the
// others say of the unit holds. Of the clipped gyro's scale factor and misalignment only the earth's rate tells.
// Here a sample and there one: each is filled in, with what that leaves open in the sigmas, and all of them are one line.
TEST(BadDataNone, SamplesLostAtRandomAreFilledIn) {
  for (const double share : {0.001, 0.01, 0.03}) {
    double sum = 0.0;
    for (const std::uint64_t seed : {21, 22, 23, 24}) {
      RigConfig config = default_rig_config();
      config.seed = seed;
      std::mt19937_64 random(seed);
      std::uniform_real_distribution<double> part(0.0, 1.0);
      RigRecorderOptions options;
      options.lost = [&](const ImuSample&) { return part(random) < share; };
      const RigRecording made = record_on_rig(fourteen_steps(), config, options);
      const JointResult r = joint_estimate(made.recording);
      ASSERT_TRUE(r.converged) << r.message;
      EXPECT_TRUE(r.undetermined.empty()) << share;
      EXPECT_TRUE(r.whiteness.white) << share << " " << seed;
      EXPECT_LT(r.faults.size(), 25u) << share;  // but for those at the borders of segments
      EXPECT_NE(r.faults.front().what.find("samples missing in"), std::string::npos) << r.faults.front().what;
      sum += nees(r, made.truth);
    }
    EXPECT_LT(sum, 122.0) << share;  // chi-square of 84, one in 200
    EXPECT_GT(sum, 50.0) << share;   // sigmas twice as wide as they should be would give 21
  }
}

// A turn of a unit with 1500 deg/h of bias adds up to less than was commanded, and the largest of noisy values comes once.
TEST(BadDataNone, NoisyUnitsWithLargeBiasesDoNotClip) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    RigConfig config = default_rig_config();
    config.seed = seed;
    config.noise.gyro_random_walk_deg_per_rt_h = 0.9;
    for (std::size_t axis = 0; axis < 3; ++axis) config.truth[axis] = (seed >> axis & 1) != 0 ? 1500.0 : -1500.0;
    if (seed % 2 == 0) config.quantisation = RigQuantisation::off;
    EXPECT_TRUE(clipped_turns(record_on_rig(fourteen_steps(), config).recording).empty()) << seed;
  }
}

TEST(BadDataNone, ClippedTurnsAreNamedAndSetAside) {
  const std::vector<std::vector<std::size_t>> clipped = {{0}, {0, 2}, {1}};
  for (const std::vector<std::size_t>& axes : clipped) {
    const double limit = std::floor(0.8 * 10.0 * 3600.0 * 0.005 / 0.93292);
    RigRecorderOptions options;
    options.alter = [&](std::span<ImuSample> samples) {
      for (ImuSample& sample : samples)
        for (const std::size_t axis : axes) sample.gyro[axis] = std::clamp(sample.gyro[axis], -limit, limit);
    };
    const RigRecording made = record_on_rig(fourteen_steps(), eleventh_unit(), options);
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << r.message;
    EXPECT_GT(r.faults.size(), 10u);
    for (const Fault& found : r.faults) {
      EXPECT_NE(found.what.find("clipped at 7.9"), std::string::npos) << found.what;
      EXPECT_NE(found.action.find("set aside"), std::string::npos) << found.action;
    }
    EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000) << "gyro " << axes.front();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const bool lost = std::ranges::find(axes, axis) != axes.end();
      const double sigma = r.sigma[6 + 4 * axis];
      EXPECT_EQ(sigma > 1e-5, lost) << "gyro " << axis << ": " << sigma;
    }
  }
}

// Turns about an axis that lies between two gyros, and some that a gyro hardly comes to its end in: each turn in which it does is set
// aside, and no gyro but that one.
TEST(BadDataNone, EveryTurnThatClipsIsSetAside) {
  for (const std::size_t axis : {std::size_t{1}, std::size_t{2}}) {
    const double limit = std::floor(9.0 * 3600.0 * 0.005 / 0.93292);
    std::vector<std::int64_t> clipped;  // counters
    RigRecorderOptions options;
    options.alter = [&](std::span<ImuSample> samples) {
      for (ImuSample& sample : samples)
        if (double& x = sample.gyro[axis]; std::abs(x) > limit) {
          x = std::copysign(limit, x);
          clipped.push_back(sample.counter);
        }
    };
    const CompressedRecording made =
        record_on_rig(must_read_sequence("holdout.seq"), eleventh_unit(), options).recording;
    const std::vector<DataEvent> events = clipped_turns(made);
    for (const DataEvent& event : events) EXPECT_EQ(event.axis, int(axis)) << event.sample;
    for (const Segment& s : made.segments) {
      const auto within = [&](std::int64_t sample) { return s.start_sample <= sample && sample < s.end_sample; };
      const bool is = std::ranges::count_if(clipped, within) > 40;  // two blocks of a turn
      const bool found = std::ranges::any_of(events, [&](const DataEvent& e) { return within(e.sample); });
      EXPECT_TRUE(found || !is) << "gyro " << axis << " at sample " << s.start_sample;
    }
    EXPECT_GT(events.size(), 3u);
  }
}

// At rest a sample that is missing without a trace takes its gravity and its time with it; what is left is a part of a pulse,
// which may or may not stand out. Nothing is wrong either way.
TEST(BadDataNone, ALossAtRestWithoutCounterIsHarmless) {
  for (const int which : {6, 17, 31}) {
    const std::int64_t sample = middle_of(SegmentKind::still, which);
    RigConfig config = eleventh_unit();
    config.faults.push_back(fault(RigFaultKind::lost_sample, sample, 0.0, 0, true));
    const RigRecording made = record_on_rig(fourteen_steps(), config);
    const JointResult r = joint_estimate(made.recording);
    EXPECT_LE(r.faults.size(), 1u);
    for (const Fault& found : r.faults) EXPECT_LE(std::abs(found.first_sample - sample), 200) << found.what;
    EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000);
  }
}

}  // namespace
}  // namespace turncal
