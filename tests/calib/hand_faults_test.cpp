// What went wrong with hand-turned data once: each row of it must be said, or set aside, and must not become a result.
#include "calib/evidence/rest_diagnosis.h"
#include "calib/model/limits.h"
#include "calib/rests/rest_units.h"
#include "calib/rests/single_pose.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/segmentation.h"
#include "tests/calib/compress.h"
#include "tests/calib/hand_rotations.h"
#include "tests/test.h"

namespace turncal {
namespace {

CompressedRecording compressed(const HandData& hand) {
  CompressedRecording recording = compress(hand.info, hand.segments, hand.samples, rest_compression_options());
  ClippingFinder clipping;
  for (const ImuSample& sample : hand.samples) clipping.add(sample);
  clipping.note(recording.events);
  return recording;
}

RestDiagnosis diagnosis_of(const HandData& hand) {
  const CompressedRecording recording = compressed(hand);
  return *good(diagnose_rests(make_rest_data(recording)));
}

void scale(HandData& hand, double gyro, double accel) {
  for (ImuSample& sample : hand.samples)
    for (std::size_t k = 0; k < 3; ++k) {
      sample.gyro[k] *= gyro;
      sample.accel[k] *= accel;
    }
}

TEST(WrongUnits, AreSaidInPlainWordsAndNotFitted) {
  struct Case {
    double gyro, accel;
    const char* words;
  };
  const Case cases[] = {{1.0, 1.0 / standard_gravity_mps2, "accelerometers look as if they were in g, not m/s^2"},
                        {1.0, standard_gravity_mps2, "accelerometers look as if they were in m/s^2, not g"},
                        {1.0, 2.0, "accelerometers look too large by 2"},
                        {1.0, 1.3, "accelerometers look to be something else, or of another unit or scale"},
                        {1.0, 0.75, "accelerometers look to be something else, or of another unit or scale"},
                        {1.0, 2.5, "accelerometers look to be something else, or of another unit or scale"},
                        {1.0 / rad_per_deg, 1.0, "gyros look as if they were in deg/s, not rad/s"},
                        {rad_per_deg, 1.0, "gyros look as if they were in rad/s, not deg/s"},
                        {2.0, 1.0, "gyros look too large by 2"},
                        {0.5, 1.0, "gyros look too small by 2"}};
  for (const Case& c : cases) {
    HandData hand = make_hand_data({.seed = 3});
    scale(hand, c.gyro, c.accel);
    const RestDiagnosis d = diagnosis_of(hand);
    EXPECT_EQ(d.diagnosis.verdict, Verdict::not_tested) << c.words;
    EXPECT_FALSE(d.base.converged) << c.words;
    EXPECT_NE(d.not_tested.find(c.words), std::string::npos) << c.words << ": " << d.not_tested;
  }
}

TEST(WrongUnits, ARoughSensorHasNone) {
  for (unsigned seed = 1; seed <= 10; ++seed)
    for (const double factor : {1.0, 0.8, 1.25}) {
      HandData hand = make_hand_data({.seed = seed});
      scale(hand, factor, factor);
      const CompressedRecording recording = compressed(hand);
      EXPECT_EQ(wrong_units(make_rest_data(recording)), "") << seed << " " << factor;
    }
}

TEST(NotTested, IsAVerdictOfItsOwn) {
  const RestDiagnosis d = diagnosis_of(make_hand_data({.rests = 6}));
  EXPECT_EQ(d.diagnosis.verdict, Verdict::not_tested);
  EXPECT_FALSE(d.diagnosis.trusted);
}

TEST(NotTested, SignsAndAxesAreSaid) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    HandData reversed = make_hand_data({.rests = 26, .seed = seed});
    HandData swapped = reversed;
    for (ImuSample& sample : reversed.samples) sample.gyro[2] = -sample.gyro[2];
    for (ImuSample& sample : swapped.samples) std::swap(sample.gyro[0], sample.gyro[1]);
    HandData all = swapped, left_handed = reversed;
    for (ImuSample& sample : all.samples)
      for (double& rate : sample.gyro) rate = -rate;
    for (ImuSample& sample : left_handed.samples) {
      sample.gyro[2] = -sample.gyro[2];
      sample.accel[1] = -sample.accel[1];
    }
    for (const HandData& hand : {reversed, swapped, all, left_handed}) {
      const RestDiagnosis d = diagnosis_of(hand);
      EXPECT_EQ(d.diagnosis.verdict, Verdict::not_tested);
      EXPECT_TRUE(d.not_tested.starts_with("signs or axes: ")) << d.not_tested;
    }
  }
}

// Nine poses: the nine accelerometer parameters take up gravity's norm, which says nothing of the gyros.
TEST(NotTested, AccelerometersAreJudgedApart) {
  HandPlan plan;
  plan.rests = 11;
  plan.seed = 4;
  plan.effect = [](const Eigen::Vector3d&, const Eigen::Vector3d& f, double, Eigen::Vector3d& w, Eigen::Vector3d&) {
    w.x() += 900.0 * radps_per_degph * f.y() / standard_gravity_mps2;
  };
  const RestDiagnosis d = diagnosis_of(make_hand_data(plan));
  EXPECT_NE(d.accel_not_tested.find("depends on individual rests"), std::string::npos) << d.accel_not_tested;
  EXPECT_EQ(d.diagnosis.verdict, Verdict::extended);
  ASSERT_FALSE(d.diagnosis.extended.effects.empty());
  for (const EstimatedEffect& e : d.diagnosis.extended.effects) EXPECT_EQ(e.column.entry->name, "gyro_g_sensitivity");
  EXPECT_FALSE(d.diagnosis.trusted);
}

TEST(Segmentation, AUnitThatSwingsNeverRests) {
  HandData hand = make_hand_data({.rests = 2});
  hand.samples.resize(6000);
  for (std::size_t k = 0; k < hand.samples.size(); ++k) {
    const double t = static_cast<double>(k) * 0.01;
    hand.samples[k].counter = static_cast<std::int64_t>(k);
    const double noise = 1e-5 * std::sin(1e4 * t * t);
    hand.samples[k].gyro = {0.01 * std::sin(3.0 * t) + noise, 0.008 * std::cos(2.1 * t) - noise, 0.005 * std::sin(t)};
    hand.samples[k].accel = {0.0981 * std::sin(std::cos(3.0 * t)), 0.0981 * std::cos(std::cos(3.0 * t)), noise};
  }
  const Segmentation found = find_rests(hand.info, hand.samples);
  EXPECT_TRUE(found.segments.empty());
  EXPECT_NE(found.reason.find("never rests"), std::string::npos) << found.reason;
}

// Small motions at all levels: the longest stretch of thresholds lies at 10^4 times the noise, where rests hold motion.
TEST(Segmentation, ThresholdsStayNearTheNoise) {
  HandData hand = make_hand_data({.gyro_noise_radps = 0.0002, .accel_noise_mps2 = 0.002, .seed = 6});
  // Every rest is interrupted by a wobble, each of another size up to 100 times the noise.
  int rest = 0;
  for (const Segment& s : hand.segments) {
    if (s.kind == SegmentKind::rotate) continue;
    const double size = 0.0002 * std::pow(100.0, (rest++ % 20) / 19.0) * 3.0;
    for (std::int64_t k = s.start_sample + 250; k < s.start_sample + 350; ++k)
      hand.samples[k].gyro[0] += size * std::sin(0.0628 * static_cast<double>(k - s.start_sample - 250)) * 0.01;
  }
  const Segmentation found = find_rests(hand.info, hand.samples);
  EXPECT_LT(found.threshold, 3.2 * segmentation_limits.most_tremor);
  SegmentationOptions given;
  given.threshold = 50.0;
  EXPECT_EQ(find_rests(hand.info, hand.samples, given).threshold, 50.0);
  EXPECT_EQ(find_rests(hand.info, hand.samples, given).reason, "given");
}

// Rests supplied too long, with the beginning of the next turn in them, give what good ones give.
TEST(Rests, VerifyTheirOwnEnds) {
  HandData hand = make_hand_data({.seed = 8});
  HandData sloppy = hand;
  for (std::size_t k = 0; k + 1 < sloppy.segments.size(); ++k)
    if (sloppy.segments[k].kind != SegmentKind::rotate)  // 1.5 s of a turn of 4 s
      sloppy.segments[k].end_sample = sloppy.segments[k + 1].start_sample += 150;
  const CompressedRecording good = compressed(hand);
  const CompressedRecording bad = compressed(sloppy);
  const RestData a = make_rest_data(good);
  const RestData b = make_rest_data(bad);
  EXPECT_TRUE(a.notes.empty());
  ASSERT_EQ(b.rests.size(), a.rests.size());
  EXPECT_EQ(b.notes.size(), 19u);
  for (std::size_t k = 0; k < a.rests.size(); ++k)
    EXPECT_LT(b.rests[k].whole.duration_s, a.rests[k].whole.duration_s + 0.6)
        << k;  // of the 1.5 s; a turn begins smoothly
  EXPECT_EQ(diagnosis_of(sloppy).diagnosis.verdict, Verdict::clean);
}

TEST(Clipping, IsNamedAndItsTurnsAreSetAside) {
  HandData hand = make_hand_data({.seed = 5});
  ASSERT_GT(clip_gyros(hand, 0.8 * 0.01), 100);  // rad a sample, at 0.8 rad/s
  const CompressedRecording recording = compressed(hand);
  const RestData data = make_rest_data(recording);
  int aside = 0;
  for (const RestLeg& leg : data.legs)
    if (!leg.fault.empty()) {
      ++aside;
      EXPECT_TRUE(leg.fault.starts_with("gyro ")) << leg.fault;
      EXPECT_NE(leg.fault.find("clipped at"), std::string::npos) << leg.fault;
    }
  EXPECT_GE(aside, 3);
  const RestDiagnosis d = diagnosis_of(hand);
  EXPECT_TRUE(d.diagnosis.extended.effects.empty());
}

// A table's constant rate, counted in steps: 193.9 of them a sample, 194 or 193 at a time. The same cut at 150 stands.
TEST(Clipping, AConstantRateFlickersBetweenTwoSteps) {
  for (const double range : {1e9, 150.0}) {
    ClippingFinder finder;
    double angle = 0.0;
    for (std::int64_t k = 0; k < 20000; ++k) {
      const double rate = 193.9 * std::clamp(std::abs(static_cast<double>(k % 4000) - 2000.0) / 200.0 - 4.0, 0.0, 1.0);
      const double before = std::floor(angle);
      angle += rate;
      ImuSample sample;
      sample.counter = k;
      sample.gyro[0] = 1e-5 * std::min(range, std::floor(angle) - before);
      finder.add(sample);
    }
    EXPECT_EQ(finder.finish().empty(), range > 1e6) << range;
  }
}

TEST(SinglePose, GivesNoiseWarmUpAndTemperatureCoefficient) {
  RecordingInfo info;
  info.sample_period_s = 0.01;
  info.gravity_mps2 = 9.81;
  info.unit_serial = "pose";
  info.gyro_increment = info.accel_increment = IncrementKind::physical;
  info.has_temperature = true;
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  std::vector<ImuSample> samples(180000);
  const double dt = info.sample_period_s;
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const double t = static_cast<double>(k) * dt;
    const double temperature = 25.0 + 3.0 * std::sin(t / 150.0);
    ImuSample& s = samples[k];
    s.counter = static_cast<std::int64_t>(k);
    s.temperature_c = static_cast<float>(temperature);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      s.gyro[axis] = 0.002 * normal(random) * dt;
      s.accel[axis] = 0.01 * normal(random) * dt;
    }
    s.gyro[0] += 100.0 * radps_per_degph * std::exp(-t / 240.0) * dt;
    s.gyro[1] += 5.0 * radps_per_degph * (temperature - 25.0) * dt;
    s.accel[1] += 9.81 * dt;
  }
  Segment whole;
  whole.end_sample = static_cast<std::int64_t>(samples.size());
  const Result<SinglePose> pose = good(analyse_single_pose(compress(info, {whole}, samples)));
  // White noise of 0.002 rad/s a sample at 100 Hz is 2e-4 rad/s/sqrt(Hz).
  EXPECT_NEAR(pose->noise.axes[2].fit.random_walk().value, 2e-4, 1e-5);
  int found = 0;
  for (const PoseCoefficient& c : pose->coefficients) {
    if (c.key == "gyro_warm_up.x") {
      EXPECT_NEAR(c.value, 100.0, 4.0 * c.sigma);
      EXPECT_EQ(c.tau_s, 240.0);
      ++found;
    } else if (c.key == "gyro_bias_temperature.y") {
      EXPECT_NEAR(c.value, 5.0, 4.0 * c.sigma);
      EXPECT_FALSE(c.alias);
      ++found;
    } else {
      EXPECT_LT(std::abs(c.value), 4.5 * c.sigma) << c.key;
    }
  }
  EXPECT_EQ(found, 2);
  Segment brief = whole;
  brief.end_sample = 5000;
  EXPECT_FALSE(analyse_single_pose(compress(info, {brief}, samples)).ok());
}

}  // namespace
}  // namespace turncal
