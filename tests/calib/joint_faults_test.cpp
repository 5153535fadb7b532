// Bad data in a run of the rig: found, named with its sample, cut out, and the parameters stay within their sigma.
#include "calib/joint/joint_estimate.h"
#include "calib/statistics/clipping.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

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
  for (const int which : {6, 17, 31}) {
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
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
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
      const bool lost = std::find(axes.begin(), axes.end(), axis) != axes.end();
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
    for (const DataEvent& event : events) EXPECT_EQ(event.axis, static_cast<int>(axis)) << event.sample;
    for (const Segment& s : made.segments) {
      const auto within = [&](std::int64_t sample) { return s.start_sample <= sample && sample < s.end_sample; };
      const bool is = std::count_if(clipped.begin(), clipped.end(), within) > 40;  // two blocks of a turn
      const bool found =
          std::any_of(events.begin(), events.end(), [&](const DataEvent& e) { return within(e.sample); });
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
