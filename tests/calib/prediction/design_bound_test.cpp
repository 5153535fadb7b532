// What no walk can be better than: the known optimum of a small problem, and walks that must not be better.
#include "calib/prediction/design_bound.h"

#include "calib/prediction/separation.h"
#include "orchestrator/jobs/preflight.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

BoundTask task_of(double time_s) {
  BoundTask task;
  task.info.latitude_deg = 29.53;
  task.info.gravity_mps2 = 9.7914;
  task.info.accel_pulse_mps = 0.0005;
  task.noise.angle_random_walk.setConstant(0.002 * radprs_per_degprh);
  task.noise.velocity_random_walk.setConstant(8.0 * mpsprs_per_ugprHz);
  task.time_s = time_s;
  task.settle_s = 1.0;
  task.least_rest_s = 10.0;
  for (std::vector<double>& poses : task.poses_deg)
    for (int k = 0; k < 8; ++k) poses.push_back(45.0 * k);
  task.turns_deg = {90.0, 180.0, 360.0};
  task.rates_degps = {20.0};
  task.aim.setZero();
  return task;
}

// At rest a gyro shows its bias where it is level, and two of three are: with all of the time shared out evenly sigma = ARW sqrt(3 / 2T).
// An accelerometer's bias and scale factor show up and down: with half of the time each, sigma = VRW / sqrt(T) of the bias. Nothing else
// shows more of it than the vertical does, but for what levelling says: not more than as much again.
TEST(DesignBound, OfRestsIsNearTheKnownOptimum) {
  const struct {
    std::vector<int> aims;
    double best, slack;  // sigma; of its logarithm
  } cases[] = {{{0, 1, 2}, 0.002 * 60.0 * std::sqrt(1.5 / 2400.0), 0.02},
               {{4}, 8e-6 / std::sqrt(2400.0), std::log(2.0)}};
  for (const auto& [aims, best, slack] : cases) {
    BoundTask task = task_of(2400.0);
    task.turns_deg.clear();
    task.aim(aims).setConstant(1.0);
    const double bound = least_log_sigma(task).value();
    EXPECT_LE(bound, std::log(best) + 1e-6);
    EXPECT_GT(bound, std::log(best) - slack);
  }
}

// Walks of one kind and of all, whatever counts in them.
TEST(DesignBound, NoWalkIsBetter) {
  const std::string turns[] = {
      "rotate R +360\n dwell 2000\n rotate R -360\n dwell 2000\n",
      "rotate P +90\n dwell 4000\n rotate P +90\n dwell 4000\n rotate P -180\n dwell 2000\n",
      "rotate H +90\n dwell 2000\n rotate R +90\n dwell 6000\n rotate R -90\n dwell 2000\n rotate H -90\n dwell 2000\n",
      "rotate P +360\n dwell 2000\n rotate P -360\n dwell 2000\n rotate R +180\n dwell 2000\n rotate R -180\n dwell "
      "2000\n",
  };
  for (const int walk : {0, 2, 4}) {
    std::string text =
        "format = 1\nname = walk\nrate_degps = 20\nacceleration_degps2 = 20\nstep 1 \"all\"\n initial H 0 P 0 R 0\n "
        "align 2000\n";
    for (int k = 0; k < 24; ++k) text += turns[walk < 4 ? std::size_t(walk) : std::size_t(k % 4)];
    const Sequence sequence = must(parse_sequence(text, "walk"));
    PlanLimits limits;
    limits.settle_s = 1.0;
    const Plan plan = make_plan(sequence, limits);
    BoundTask task = task_of(plan.station_s);
    task.info.sample_period_s = limits.sample_period_s;
    PredictOptions options;
    options.noise = task.noise;
    const Prediction prediction = predict(task.info, planned_motion(sequence, plan), options);
    ASSERT_TRUE(prediction.valid);
    const auto never_better = [&](const ParameterVector& aim, const std::string& of) {
      task.aim = aim;
      double mean = 0.0;
      const auto counted = double((aim.array() > 0.0).count());
      for (int k = 0; k < parameter_count; ++k)
        if (aim[k] > 0.0) mean += std::log(prediction.sigma[k] / aim[k]) / counted;
      const std::optional<double> bound = least_log_sigma(task);
      EXPECT_LE(bound.value_or(-1e9), mean + 1e-3) << of << " of walk " << walk;
      return bound.has_value();
    };
    ParameterVector all = ParameterVector::Zero();
    for (const int k : {0, 6, 9, 16}) {
      if (!prediction.determined[k]) continue;
      ParameterVector aim = ParameterVector::Zero();
      aim[k] = all[k] = prediction.sigma[k];
      EXPECT_TRUE(never_better(aim, std::string(parameter_keys[k])));
    }
    EXPECT_EQ(never_better(all, "all"), all.maxCoeff() > 0.0) << "walk " << walk;
  }
}

// ---- separation ----

// What legs would tell confounded effects apart: poses off the axes do, poses on them and what looks alike in every pose do not.

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
  return planned_motion(sequence, make_plan(sequence, {.settle_s = 0.5, .sample_period_s = 0.05}));
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
