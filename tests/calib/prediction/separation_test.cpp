// What legs would tell confounded effects apart: poses off the axes do, poses on them and what looks alike in every pose do not.
#include "calib/prediction/separation.h"

#include "orchestrator/jobs/preflight.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

struct Found {
  RigRecording made;
  Diagnosis diagnosis;
  std::string name;
};

// Of the fourteen steps; the first effect of the diagnosis that has aliases.
Found found_on_rig(std::uint64_t seed, const std::function<void(RigEffects&)>& set) {
  RigConfig config = default_rig_config();
  config.seed = seed;
  config.noise_seed = 100 + seed;
  set(config.effects);
  Found found;
  found.made = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  found.diagnosis = diagnose(found.made.recording);
  for (const auto& [name, others] : found.diagnosis.aliases)
    if (!others.empty()) found.name = name;
  return found;
}

PlannedMotion planned(const std::string& legs) {
  const Sequence sequence =
      must(parse_sequence("format = 1\nname = legs\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1 \"legs\"\n  "
                          "initial H 0 P 0 R 0\n  align 6000\n" +
                              legs,
                          "legs"));
  PlanLimits limits;
  limits.settle_s = 0.5;
  limits.sample_period_s = 0.05;
  return planned_motion(sequence, make_plan(sequence, limits));
}

double worst(const std::vector<AliasPair>& pairs) {
  double least = 1e9;
  for (const AliasPair& pair : pairs) least = std::min(least, pair.gain);
  return least;
}

TEST(Separation, PosesOffTheAxesTellSecondOrderFromAsymmetry) {
  const Found found = found_on_rig(1, [](RigEffects& e) { e.accel_second_order = {0.0, 17.0, 0.0}; });
  ASSERT_FALSE(found.name.empty()) << found.diagnosis.reason;
  const Separation separation(found.made.recording, found.diagnosis, found.name);
  ASSERT_EQ(separation.members().size(), 2u);
  std::string on_axes, off_axes;
  for (int k = 0; k < 8; ++k) {  // a full circle, and half of it there and back
    on_axes += k < 4 ? "  rotate R +90\n  dwell 1000\n" : "  rotate R -90\n  dwell 1000\n";
    off_axes += "  rotate R +45\n  dwell 1000\n";
  }
  const double before = worst(separation.pairs(nullptr, 0.05));
  const PlannedMotion on = planned(on_axes), off = planned(off_axes);
  const double with_axes = worst(separation.pairs(&on, 0.05)), with_others = worst(separation.pairs(&off, 0.05));
  EXPECT_GT(before, 2.0);
  EXPECT_LT(before, separating_gain);
  EXPECT_GE(with_axes, before * 0.999) << "a recording more takes nothing away";
  EXPECT_GT(with_others - before, with_axes - before);
  const Separation same_run(found.made.recording, found.diagnosis, found.name, true);
  EXPECT_GT(worst(same_run.pairs(&off, 0.05)), with_others) << "it has the same biases";
}

// The earth's rate and the time that a sample lasts are one number to whatever rests on the earth.
TEST(Separation, NoMotionTellsTheEarthRateFromTheSamplePeriod) {
  const Found found = found_on_rig(9, [](RigEffects& e) { e.earth_rate = {0.05, 0.0}; });
  ASSERT_FALSE(found.name.empty()) << found.diagnosis.reason;
  const Separation separation(found.made.recording, found.diagnosis, found.name);
  const PlannedMotion motion = planned(
      "  rotate H +45\n  dwell 1000\n  rotate P +45\n  dwell 1000\n  rotate R +90\n  dwell 1000\n"
      "  rotate H +90\n  dwell 1000\n  rotate P -90\n  dwell 1000\n");
  EXPECT_EQ(separation.pairs(&motion, 0.05).size(), 2 * (separation.members().size() - 1))
      << "two aliases that are alike do not count";
  bool seen = false;
  for (const AliasPair& pair : separation.pairs(&motion, 0.05)) {
    if (pair.truth != "sample_period" || pair.other != "earth_rate") continue;
    seen = true;
    EXPECT_LT(pair.gain, 0.1);
    EXPECT_GT(pair.correlation, 0.999);
  }
  EXPECT_TRUE(seen);
}

}  // namespace
}  // namespace turncal
