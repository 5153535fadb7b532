// The joint estimate on units of all grades and with bad data: what it says of itself is right. And what it must refuse in plain words.
// The long statistics (200 runs, normalised error parameter by parameter) are scripts/study-joint; docs/accuracy.md.
#include "calib/joint/joint_estimate.h"
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

RigRecording record(const RigConfig& config, const RigRecorderOptions& options = {}) {
  return record_on_rig(fourteen_steps(), config, options);
}

const RigRecording& usual_run() {
  static const RigRecording made = record(usual_unit());
  return made;
}

const JointResult& clean_estimate() {
  static const JointResult result = joint_estimate(usual_run().recording);
  return result;
}

// The n-th segment of a kind.
const Segment& segment_of(SegmentKind kind, int n) {
  const Segments& segments = usual_run().recording.segments;
  return *std::ranges::find_if(segments, [&](const Segment& s) { return s.kind == kind && n-- == 0; });
}

// Errors of the size that sigma says.
void expect_right(const JointResult& r, const Parameters& truth) {
  ASSERT_TRUE(r.converged) << r.message;
  EXPECT_TRUE(r.undetermined.empty());
  EXPECT_LT(nees(r, truth), chi_square_21_one_in_1000);
}

struct Unit {
  const char* name;
  std::function<void(RigConfig&)> alter;
};

std::function<void(RigConfig&)> grade(double arw_deg_prh, double vrw_ug_prhz, double period_s, double latitude_deg,
                                      RigQuantisation quantisation) {
  return [=](RigConfig& config) {
    config.noise.gyro_random_walk_deg_per_rt_h = arw_deg_prh;
    config.noise.accel_random_walk_ug_per_rt_hz = vrw_ug_prhz;
    config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
    config.sample_period_s = period_s;
    config.site.latitude_deg = latitude_deg;
    config.quantisation = quantisation;
  };
}

// What a unit of the grade, at the rate and the place can know is determined, its noise measured, and the errors what sigma says: the mean
// of n chi-squares of 21 degrees of freedom lies within 21 +- 2.58 sqrt(42/n), 99 of 100 times. The estimate starts from the values of
// Wang (2020); scale factors of gyros and accelerometers are per cents off.
TEST(JointConditions, EveryUnitIsEstimatedToItsSigma) {
  const auto floor = RigQuantisation::floor, off = RigQuantisation::off;
  const auto as_drawn = [](RigConfig&) {};
  const Unit units[] = {
      {"as drawn, first", as_drawn},
      {"as drawn, second", as_drawn},
      {"as drawn, third", as_drawn},
      {"no instability", grade(0.002, 8.0, 0.005, 29.53, floor)},
      {"three times the noise", grade(0.006, 24.0, 0.005, 29.53, floor)},
      {"far south", grade(0.002, 8.0, 0.005, -75.0, floor)},
      {"far north, real increments", grade(0.002, 8.0, 0.005, 75.0, off)},
      {"at 50 Hz", grade(0.002, 8.0, 0.02, -33.0, floor)},
      {"at 2 kHz", grade(0.002, 8.0, 0.0005, 50.0, floor)},
      {"coarse gyros that count pulses", grade(0.05, 8.0, 0.005, 29.53, floor)},
      {"tactical", grade(0.05, 50.0, 0.005, 45.0, off)},
      {"MEMS", grade(0.3, 100.0, 0.005, 45.0, floor)},
      {"MEMS of a degree", grade(1.0, 200.0, 0.01, 45.0, off)},
      {"MEMS of three degrees", grade(3.0, 200.0, 0.01, 45.0, off)},
      {"still turning at first",  // 20 deg in the first 5 s of the first alignment
       [](RigConfig& config) {
         config.faults.push_back({.kind = RigFaultKind::table_moved, .axis = 0, .size = 20.0, .rate_degps = 4.0});
       }},
  };
  double sum = 0.0;
  int invented = 0;
  std::uint64_t seed = 41;
  for (const Unit& unit : units) {
    SCOPED_TRACE(unit.name);
    RigConfig config = usual_unit(seed++);
    unit.alter(config);
    const RigRecording made = record(config);
    const JointResult r = joint_estimate(made.recording);
    expect_right(r, made.truth);
    sum += nees(r, made.truth) / double(std::size(units));
    EXPECT_TRUE(r.faults.empty() || !config.faults.empty()) << r.faults.front().what;
    EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
    EXPECT_NEAR(r.whiteness.level, 1.0, 0.1);  // at 50 Hz
    if (config.noise.gyro_bias_instability_degph > 0.0) continue;
    invented += (r.noise.gyro_bias_instability_radps > 0.0) + (r.noise.accel_bias_instability_mps2 > 0.0);
    const double arw = config.noise.gyro_random_walk_deg_per_rt_h * radprs_per_degprh;
    const double vrw = config.noise.accel_random_walk_ug_per_rt_hz * mpsprs_per_ugprHz;
    ASSERT_TRUE(r.noise_fit && r.noise_fit->converged);
    EXPECT_LE(r.noise_fit->evaluations, 30);  // an instability that promises nothing is not looked for
    EXPECT_NEAR(r.noise.angle_random_walk.x(), arw, 3.5 * r.noise_fit->sigma_angle_random_walk.x());
    EXPECT_LT(r.noise_fit->sigma_angle_random_walk.x(), (config.sample_period_s < 0.005 ? 0.12 : 0.08) * arw);
    EXPECT_NEAR(r.noise.velocity_random_walk.mean(), vrw, 0.04 * vrw);  // what is left of the quantisation included
  }
  EXPECT_NEAR(sum, 21.0, 2.58 * std::sqrt(42.0 / double(std::size(units))));
  // Of a clean triad one in twenty is given a bias instability (noise_fit.h); of 22, at most five in 99.7 % of all tests.
  EXPECT_LE(invented, 5);
}

// The nominal weight of a count is 0.93 arcsec; the table's turns say that it is another. Some of the quantisation counts as random walk:
// the sigmas come out too large.
TEST(JointConditions, ACounterOfAnotherWeightIsSeenByTheTurns) {
  RigConfig config = usual_unit(106);
  config.gyro_pulse_arcsec = 4.0;
  const RigRecording made = record(config);
  const JointResult r = joint_estimate(made.recording);
  expect_right(r, made.truth);
  EXPECT_TRUE(r.faults.empty()) << r.faults.front().what;
}

// A noise model three times too small is not believed: the result says that the innovations are not white at it.
TEST(JointConditions, GivenNoiseThatDoesNotFitIsSaid) {
  JointOptions options;
  options.noise = clean_estimate().noise;
  options.noise->angle_random_walk /= 3.0;
  options.noise->velocity_random_walk /= 3.0;
  options.noise->accel_pulse_mps /= 3.0;
  const JointResult r = joint_estimate(usual_run().recording, options);
  EXPECT_TRUE(clean_estimate().whiteness.white);
  EXPECT_FALSE(r.whiteness.white);
  EXPECT_GT(r.whiteness.level, 4.0);
}

// One too small to be kept is counted in sigma; one that is kept is in the filter already.
TEST(JointConditions, AnInstabilityThatIsNotSeenIsInTheSigma) {
  const JointResult& r = clean_estimate();
  ASSERT_FALSE(r.noise.has_bias_instability());
  for (int k = 0; k < 21; ++k) {
    const double widened = std::sqrt(r.covariance(k, k) / (r.covariance(k, k) - r.unseen_instability(k, k)));
    // 0.3 ug of flicker make the errors of A0 1.05 to 1.25 times the sigma without (docs/accuracy.md)
    const bool of_A0 = k >= 3 && k < 6;
    EXPECT_GT(widened, of_A0 ? 1.03 : 1.0 - 1e-6) << k;
    EXPECT_LT(widened, of_A0 ? 1.25 : HUGE_VAL) << k;
  }
  RigConfig config = usual_unit();
  config.noise.accel_bias_instability_ug = 5.0;
  config.noise.gyro_bias_instability_degph = 0.05;
  const JointResult seen = joint_estimate(record(config).recording);
  EXPECT_GT(seen.noise.accel_bias_instability_mps2, 0.0);
  EXPECT_GT(seen.noise.gyro_bias_instability_radps, 0.0);
  EXPECT_EQ(seen.unseen_instability.cwiseAbs().maxCoeff(), 0.0);
}

// The heading that is given is one to begin the search at, and not even that.
TEST(JointConditions, AWrongHeadingCostsNothing) {
  for (const double wrong_deg : {2.0, -90.0, 180.0}) {
    CompressedRecording recording = usual_run().recording;
    for (Segment& segment : recording.segments) segment.heading_deg += wrong_deg;
    const JointResult r = joint_estimate(recording);
    ASSERT_TRUE(r.converged) << wrong_deg << ": " << r.message;
    EXPECT_TRUE(r.whiteness.white);
    const ParameterVector difference = to_vector(r.parameters) - to_vector(clean_estimate().parameters);
    for (const int k : r.free) {
      EXPECT_LT(std::abs(difference[k]), 0.02 * r.sigma[k]) << wrong_deg << " " << parameter_keys[k];
      EXPECT_NEAR(r.sigma[k] / clean_estimate().sigma[k], 1.0, 0.01) << wrong_deg << " " << parameter_keys[k];
    }
  }
}

// The first minute, cut off, has an east rate larger than the Earth's, which no heading explains.
TEST(JointConditions, ShortChainThatNoHeadingExplainsDoesNotStopTheFit) {
  RigConfig config = usual_unit();
  grade(0.28, 86.0, 0.005, 23.0, RigQuantisation::off)(config);
  const RigRecording made = record(config);
  constexpr std::size_t cut = 60;
  for (const double added : {45.0, -45.0}) {  // pulses a second: about 42 deg/h
    SCOPED_TRACE(added);
    CompressedRecording recording = made.recording;
    for (std::size_t k = 0; k < cut; ++k) recording.blocks[k].gyro.z() += added;
    JointOptions options;
    options.breaks = {{cut, 1.0, 1.0}};
    options.look_for_faults = false;
    expect_right(joint_estimate(recording, options), made.truth);
  }
}

// A recording as it would be of sensors that read these maps of the true rates and forces.
CompressedRecording read_by(CompressedRecording recording, const Eigen::Matrix3d& rates,
                            const Eigen::Matrix3d& forces) {
  for (Block& b : recording.blocks) {
    b.gyro = rates * b.gyro;
    b.gyro_time = rates * b.gyro_time;
    b.coning = rates.determinant() * (rates * b.coning);
    b.accel = forces * b.accel;
    b.accel_time = forces * b.accel_time;
    b.sculling = rates * b.sculling * forces.transpose();
  }
  return recording;
}

TEST(JointConditions, AUnitMountedAnotherWayIsSeenAndCalibrated) {
  const Eigen::Matrix3d turned = Eigen::AngleAxisd(-pi / 2.0, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const JointResult r = joint_estimate(read_by(usual_run().recording, turned, turned));
  EXPECT_EQ(r.start.mounting_text, "turned by 90 deg about up");
  ASSERT_TRUE(r.converged) << r.message;
  EXPECT_TRUE(r.whiteness.white);
  EXPECT_TRUE(r.undetermined.empty());
}

// With the fourteen steps, and with forty minutes, where an estimate with them settles.
TEST(JointConditions, GyrosThatReadAnotherAxisAreSaid) {
  using Eigen::Matrix3d;
  const Matrix3d same = Matrix3d::Identity();
  Matrix3d one = same, two = same, exchanged = Matrix3d::Zero(), cyclic = exchanged;
  one(2, 2) = two(0, 0) = two(1, 1) = -1.0;
  exchanged(0, 1) = exchanged(1, 0) = exchanged(2, 2) = 1.0;
  cyclic(0, 1) = cyclic(1, 2) = cyclic(2, 0) = 1.0;
  const RigRecording brief = record_on_rig(must_read_sequence("forty_minutes.seq"), usual_unit(71));
  const struct {
    const RigRecording& made;
    Matrix3d rates, forces;
    const char* said;
  } cases[] = {{usual_run(), one, same, "the rate about z is what gyro z reads, reversed"},
               {usual_run(), -same, same, "the rate about x is what gyro x reads, reversed, the rate about y"},
               {usual_run(), exchanged, same, "about x is what gyro y reads, the rate about y is what gyro x reads"},
               {brief, exchanged, same, "the rate about x is what gyro y reads"},
               {brief, cyclic, same, "the rate about x is what gyro z reads"},
               {brief, two, same, "the rate about x is what gyro x reads, reversed"},
               {brief, same, -same, "gravity has the wrong sign"}};
  for (const auto& [made, rates, forces, said] : cases) {
    const JointResult r = joint_estimate(read_by(made.recording, rates, forces));
    EXPECT_FALSE(r.converged) << said;
    EXPECT_SAYS(r.message, said);
  }
}

// ---- bad data: found, named with its sample, cut out, and the parameters stay within their sigma ----

// 15 ms to 10 s. The sigmas are those of the run with that turn set aside, and those of three samples hardly differ from none.
TEST(BadData, AGapCostsWhatItsTurnKnewAndNoMore) {
  const Segment turn = segment_of(SegmentKind::rotate, 2);
  const auto& blocks = usual_run().recording.blocks;
  const auto in_turn =
      std::ranges::find_if(blocks, [&](const Block& b) { return b.start_sample >= turn.start_sample + 100; });
  JointResult without_turn = clean_estimate();
  without_turn.setup.breaks = {{std::size_t(in_turn - blocks.begin()), 1.0, 1.0}};
  JointOptions aside;
  aside.faults_of = &without_turn;
  aside.noise = clean_estimate().noise;
  const ParameterVector expected = joint_estimate(usual_run().recording, aside).sigma;

  for (const std::int64_t lost : {3, 60, 2000}) {
    SCOPED_TRACE(lost);
    RigConfig config = usual_unit();
    const std::int64_t sample = (turn.start_sample + turn.end_sample - lost) / 2;
    config.faults.push_back({.kind = RigFaultKind::lost_sample, .sample = sample, .count = lost});
    const RigRecording made = record(config);
    const JointResult r = joint_estimate(made.recording);
    expect_right(r, made.truth);
    EXPECT_TRUE(r.whiteness.white) << r.whiteness.message;
    ASSERT_GE(r.faults.size(), 1u);
    EXPECT_NEAR(r.noise.angle_random_walk.x() / clean_estimate().noise.angle_random_walk.x(), 1.0, 0.1);
    const ParameterVector error = to_vector(r.parameters) - to_vector(made.truth);
    for (const int k : r.free) {
      EXPECT_LT(std::abs(error[k]), 4.0 * r.sigma[k]) << parameter_keys[k];
      EXPECT_LT(r.sigma[k], 1.1 * expected[k]) << parameter_keys[k];
      if (lost == 3) {
        EXPECT_LT(r.sigma[k], 1.05 * clean_estimate().sigma[k]) << parameter_keys[k];
      }
    }
    if (lost == 3) {
      EXPECT_SAYS_NOT(r.faults.front().action, "set aside");
    }
  }
}

struct Bad {
  const char* name;
  RigFaultKind kind;
  SegmentKind where;
  double size;
  int axis;
  bool hidden;
  bool costs;  // the parameters would be wrong if nobody looked for it; what raw samples show nobody looks for
  std::vector<int> places;  // the n-th turns or rests
};

TEST(BadData, IsFoundNamedAndCostsNothing) {
  const auto turn = SegmentKind::rotate, rest = SegmentKind::still;
  const Bad list[] = {
      {"gap in a turn", RigFaultKind::lost_sample, turn, 0.0, 0, false, false, {6}},
      {"gap in a turn without counter", RigFaultKind::lost_sample, turn, 0.0, 0, true, true, {6, 31}},
      {"duplicate in a turn", RigFaultKind::duplicated_sample, turn, 0.0, 0, true, true, {6, 31}},
      {"glitch of a milliradian at rest", RigFaultKind::gyro_glitch, rest, 1.0, 2, false, false, {31}},
      {"glitch of a milliradian in a turn", RigFaultKind::gyro_glitch, turn, 1.0, 1, false, false, {31}},
      {"knock at rest", RigFaultKind::velocity_knock, rest, 0.05, 0, false, false, {6}},
      {"knock in a turn", RigFaultKind::velocity_knock, turn, 0.05, 1, false, false, {31}},
      // It takes its gravity and its time with it; what is left is a part of a pulse, which may or may not stand out.
      {"loss at rest without counter", RigFaultKind::lost_sample, rest, 0.0, 0, true, false, {6}},
  };
  for (const Bad& bad : list)
    for (const int which : bad.places) {
      const Segment& segment = segment_of(bad.where, which);
      const std::int64_t sample = (segment.start_sample + segment.end_sample) / 2;
      SCOPED_TRACE(testing::Message() << bad.name << ", sample " << sample);
      RigConfig config = usual_unit();
      config.faults.push_back(
          {.kind = bad.kind, .sample = sample, .axis = bad.axis, .size = bad.size, .hidden = bad.hidden});
      const RigRecording made = record(config);
      const JointResult r = joint_estimate(made.recording);
      expect_right(r, made.truth);
      const bool may_be_missed = bad.hidden && !bad.costs;
      EXPECT_TRUE(r.faults.size() == 1 || (may_be_missed && r.faults.empty())) << r.faults.size();
      for (const Fault& found : r.faults) {
        EXPECT_LE(found.first_sample, sample + (may_be_missed ? 200 : 1)) << found.what;
        EXPECT_GE(found.last_sample, sample - 1) << found.what;
        EXPECT_LT(found.last_sample - found.first_sample, 9000) << found.what;  // the turn or the second, not the run
        EXPECT_FALSE(found.what.empty() || found.action.empty());
      }
      if (!bad.costs) continue;
      JointOptions blind;
      blind.look_for_faults = false;
      JointResult fooled = joint_estimate(made.recording, blind);
      fooled.covariance = r.covariance;  // its own has the fault for noise
      EXPECT_GT(nees(fooled, made.truth), chi_square_21_one_in_1000);
    }
}

// Here a sample and there one: each is filled in, with what that leaves open in the sigmas, and all of them are one line.
TEST(BadData, SamplesLostAtRandomAreFilledIn) {
  for (const double share : {0.001, 0.03}) {
    double sum = 0.0;
    for (const std::uint64_t seed : {21, 22, 23, 24}) {
      std::mt19937_64 random(seed);
      std::uniform_real_distribution<double> part(0.0, 1.0);
      RigRecorderOptions options;
      options.lost = [&](const ImuSample&) { return part(random) < share; };
      const RigRecording made = record(usual_unit(seed), options);
      const JointResult r = joint_estimate(made.recording);
      expect_right(r, made.truth);
      EXPECT_TRUE(r.whiteness.white) << share << " " << seed;
      EXPECT_LT(r.faults.size(), 25u) << share;  // but for those at the borders of segments
      EXPECT_SAYS(r.faults.front().what, "samples missing in");
      sum += nees(r, made.truth);
    }
    EXPECT_LT(sum, 122.0) << share;  // chi-square of 84, one in 200
    EXPECT_GT(sum, 50.0) << share;   // sigmas twice as wide as they should be would give 21
  }
}

// A turn of a unit with 1500 deg/h of bias adds up to less than was commanded, and the largest of noisy values comes once.
TEST(BadData, NoisyUnitsWithLargeBiasesDoNotClip) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    RigConfig config = usual_unit(seed);
    config.noise.gyro_random_walk_deg_per_rt_h = 0.9;
    for (std::size_t axis = 0; axis < 3; ++axis) config.truth[axis] = (seed >> axis & 1) != 0 ? 1500.0 : -1500.0;
    if (seed % 2 == 0) config.quantisation = RigQuantisation::off;
    EXPECT_TRUE(clipped_turns(record_on_rig(must_read_sequence("forty_minutes.seq"), config).recording).empty())
        << seed;
  }
}

// Gyros that end at a rate; `clipped`: counters of samples that did.
RigRecorderOptions clipping_at(double degps, std::vector<std::size_t> axes, std::vector<std::int64_t>& clipped) {
  RigRecorderOptions options;
  options.alter = [axes = std::move(axes), limit = std::floor(degps * 3600.0 * 0.005 / 0.93292),
                   &clipped](std::span<ImuSample> samples) {
    for (ImuSample& sample : samples)
      for (const std::size_t axis : axes)
        if (double& x = sample.gyro[axis]; std::abs(x) > limit) {
          x = std::copysign(limit, x);
          clipped.push_back(sample.counter);
        }
  };
  return options;
}

// At 80 % of the table's 10 deg/s: those turns are set aside, and what the others say of the unit holds. Of the clipped gyro's scale factor
// and misalignment only the earth's rate tells.
TEST(BadData, ClippedTurnsAreNamedAndSetAside) {
  for (const std::vector<std::size_t>& axes : {std::vector<std::size_t>{0, 2}, {1}}) {
    std::vector<std::int64_t> clipped;
    const RigRecording made = record(usual_unit(), clipping_at(8.0, axes, clipped));
    const JointResult r = joint_estimate(made.recording);
    ASSERT_TRUE(r.converged) << r.message;
    EXPECT_GT(r.faults.size(), 10u);
    for (const Fault& found : r.faults) {
      EXPECT_SAYS(found.what, "clipped at 7.9");
      EXPECT_SAYS(found.action, "set aside");
    }
    EXPECT_LT(nees(r, made.truth), chi_square_21_one_in_1000) << "gyro " << axes.front();
    for (std::size_t axis = 0; axis < 3; ++axis)
      EXPECT_EQ(r.sigma[6 + 4 * axis] > 1e-5, std::ranges::count(axes, axis) > 0) << "gyro " << axis;
  }
}

// Turns about an axis that lies between two gyros, and some that a gyro hardly comes to its end in: each turn in which it does is set
// aside, and no gyro but that one.
TEST(BadData, EveryTurnThatClipsIsSetAside) {
  for (const std::size_t axis : {std::size_t{1}, std::size_t{2}}) {
    std::vector<std::int64_t> clipped;
    const CompressedRecording made =
        record_on_rig(must_read_sequence("holdout.seq"), usual_unit(), clipping_at(9.0, {axis}, clipped)).recording;
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

}  // namespace
}  // namespace turncal
