// One unit switched on several times: rig recordings with the same scale factors and misalignments and other biases.
#include "calib/joint/several_recordings.h"

#include "tests/calib/diagnosed_unit.h"
#include "tests/disturbance.h"

namespace turncal {
namespace {

RigConfig quiet() {
  RigConfig config = default_rig_config();
  config.seed = 77;
  config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
  return config;
}

RigRecording switched_on(RigConfig config, std::uint64_t noise_seed, const Sequence& sequence = fourteen_steps()) {
  config.noise_seed = noise_seed;
  return record_on_rig(sequence, config);
}

struct Estimated {
  RigRecording made;
  JointResult estimate;
};
const Estimated& quiet_run(std::size_t k) {
  static std::map<std::size_t, Estimated> runs;
  if (const auto known = runs.find(k); known != runs.end()) return known->second;
  RigRecording made = switched_on(quiet(), 501 + k);
  JointResult estimate = joint_estimate(made.recording);
  return runs.emplace(k, Estimated{std::move(made), std::move(estimate)}).first->second;
}

TEST(SeveralRecordings, CommonParametersGainAndBiasesAreOfEach) {
  // Estimates as if the unit had had other biases: exact, since what an estimate says of them is linear.
  std::vector<JointResult> estimates;
  for (const double sign : {1.0, -1.0, 0.0}) {
    estimates.push_back(quiet_run(estimates.size()).estimate);
    estimates.back().parameters.N0_degph.array() += sign * gyro_turn_on_degph;
    estimates.back().parameters.A0_g.array() += sign * accel_turn_on_g;
  }
  const SeveralRecordings r = combine_recordings(estimates);
  EXPECT_EQ(r.degrees, 30);
  EXPECT_TRUE(r.agree) << r.disagreement;
  EXPECT_GT(r.p_value, 0.001);
  EXPECT_LT(nees(r.unit, quiet_run(0).made.truth), chi_square_21_one_in_1000);
  for (const int k : free_parameters()) {
    if (k >= 6) {
      EXPECT_NEAR(r.unit.sigma[k] / estimates[0].sigma[k], 1.0 / std::sqrt(3.0), 0.06) << k;
      continue;
    }
    const double step = k < 3 ? gyro_turn_on_degph : accel_turn_on_g;
    EXPECT_NEAR((r.turn_ons.biases[0][k] - r.turn_ons.biases[1][k]) / (2.0 * step), 1.0, 0.1) << k;
    EXPECT_NEAR(r.turn_ons.repeatability[k] / step, 1.0, 0.1) << k;  // of +1, -1 and 0
    EXPECT_GT(r.unit.sigma[k], 0.9 * step / std::sqrt(3.0)) << k;
  }
}

// A short recording that determines little leans on one that does.
TEST(SeveralRecordings, WhatOneDoesNotDetermineTheOtherMay) {
  const JointResult& alone = quiet_run(0).estimate;
  const JointResult little = joint_estimate(switched_on(quiet(), 512, must_read_sequence("short_demo.seq")).recording);
  const SeveralRecordings r = combine_recordings({alone, little});
  for (const int k : r.unit.free) {
    EXPECT_TRUE(r.unit.determined[std::size_t(k)]) << k;
    EXPECT_TRUE(k < 6 || r.unit.sigma[k] < 1.001 * alone.sigma[k]) << k;
  }
  EXPECT_TRUE(r.agree) << r.disagreement << " of " << r.degrees;
}

// At four headings of a level table nothing tells a scale factor from its bias: where its own fit ends along that is no contradiction.
TEST(SeveralRecordings, ALevelTableContradictsNothing) {
  const auto& [whole, alone] = quiet_run(0);
  for (const std::uint64_t seed : {532u, 533u, 534u}) {
    const RigRecording turned = switched_on(quiet(), seed, must_read_sequence("verify.seq"));
    const JointResult level = estimate_beside(turned.recording, alone.parameters);
    ASSERT_TRUE(level.converged) << level.message;
    EXPECT_FALSE(level.undetermined.empty());
    const SeveralRecordings r = combine_recordings({alone, level});
    EXPECT_TRUE(r.agree) << seed << ": " << r.disagreement << " of " << r.degrees;
    EXPECT_LT(nees(r.unit, whole.truth), chi_square_21_one_in_1000) << seed;
  }
}

TEST(SeveralRecordings, AScaleFactorThatChangedIsSaid) {
  const JointResult& first = quiet_run(0).estimate;
  JointResult second = quiet_run(1).estimate;
  second.parameters.n(0, 0) += 12.0 * second.sigma[6];
  const SeveralRecordings r = combine_recordings({first, second});
  EXPECT_FALSE(r.agree);
  EXPECT_LT(r.p_value, 1e-6);
  EXPECT_GT(r.unit.sigma[6], 1.2 * first.sigma[6]);
}

// ---- several recordings of one unit, fitted and diagnosed as one ----

// A unit in two recordings, the second switched on with other biases, and one more for a holdout.
struct JoinedUnit {
  CompressedRecording first, second, holdout;
  Parameters truth;

  Diagnosis diagnose_both(bool with_holdout = false) const {
    DiagnosisOptions options;
    if (with_holdout) options.holdouts = {&holdout};
    return diagnose(join_recordings({&first, &second}), options);
  }
  // `combine_recordings` at this noise.
  SeveralRecordings combined(const NoiseModel& noise) const {
    JointOptions at;
    at.noise = noise;
    return combine_recordings({joint_estimate(first, at), joint_estimate(second, at)});
  }
};

Disturbance turn_on(double of) {
  return [of](const DisturbedMoment&) {
    AddedReading added;
    added.gyro_radps.setConstant(of * gyro_turn_on_degph * radps_per_degph);
    added.accel_mps2.setConstant(of * accel_turn_on_g * standard_gravity_mps2);
    return added;
  };
}

JoinedUnit made_unit(std::uint64_t seed) {
  RigConfig config = default_rig_config();
  config.seed = seed;
  RigRecording first = switched_on(config, 700 + seed), second = switched_on(config, 800 + seed);
  RigRecording holdout = switched_on(config, 900 + seed, must_read_sequence("holdout.seq"));
  disturb(second.recording, second.truth, turn_on(1.0));
  disturb(holdout.recording, second.truth, turn_on(-1.0));
  return {std::move(first.recording), std::move(second.recording), std::move(holdout.recording), first.truth};
}
const JoinedUnit& joined_unit() {
  static const JoinedUnit unit = made_unit(62);
  return unit;
}
const Diagnosis& clean_diagnosis() {
  static const Diagnosis diagnosis = joined_unit().diagnose_both(true);
  return diagnosis;
}

// Of another turn-on nothing is made but another bias; what is common is known as from twice the data.
TEST(JoinedRecordings, OneUnitAreCleanWhateverTheirTurnOns) {
  const Diagnosis& d = clean_diagnosis();
  const JointResult alone = joint_estimate(joined_unit().first);
  EXPECT_EQ(d.verdict, Verdict::clean) << told(d);
  EXPECT_EQ(d.holdout_source, "second recording");
  EXPECT_TRUE(d.extended.effects.empty());
  ASSERT_EQ(d.each.turn_ons.biases.size(), 2u);
  const TurnOns& turn_ons = d.each.turn_ons;
  const ParameterVector truth = to_vector(joined_unit().truth), found = to_vector(d.extended.parameters);
  for (int k = 0; k < 6; ++k) {
    const double step = k < 3 ? gyro_turn_on_degph : accel_turn_on_g;
    EXPECT_LT(std::abs(turn_ons.biases[0][k] - truth[k]), 4.5 * turn_ons.sigma[0][k]) << k;
    EXPECT_LT(std::abs(turn_ons.biases[1][k] - truth[k] - step), 4.5 * turn_ons.sigma[1][k]) << k;
    EXPECT_NEAR(turn_ons.repeatability[k] / step, std::sqrt(0.5), 0.15) << k;
    EXPECT_NEAR(found[k], truth[k] + 0.5 * step, 4.5 * turn_ons.sigma[0][k]) << k;
    EXPECT_GT(d.extended.sigma[k], 0.4 * step) << k;
  }
  for (const int k : free_parameters()) {
    if (k < 6) continue;
    const auto at = std::ranges::find(d.extended.free, k) - d.extended.free.begin();
    EXPECT_LT(std::sqrt(d.fitted_covariance(at, at)), 0.85 * alone.sigma[k]) << k;
    EXPECT_LT(std::abs(found[k] - truth[k]), 4.5 * d.extended.sigma[k]) << k;
  }
}

// The effect, or one that these recordings do not tell from it.
void expect_effect(const Diagnosis& d, const EstimatedEffect& found, const std::string& key, double value) {
  const std::string name = key.substr(0, key.find('.'));
  EXPECT_TRUE(in_class(d, name)) << told(d);
  if (found.column.key() == key) {
    EXPECT_NEAR(found.value, value, 4.0 * found.sigma);
  }
}

// Too little of it for one recording (five sigma there), enough for both.
TEST(JoinedRecordings, OneUnitHaveItsEffectInCommon) {
  JoinedUnit made = joined_unit();
  const Disturbance second_order =
      on_accel(1, [](const DisturbedMoment& m) { return 5.0 * ug * m.force_g.y() * m.force_g.y(); });
  for (CompressedRecording* one : {&made.first, &made.second, &made.holdout}) disturb(*one, made.truth, second_order);
  const Diagnosis d = made.diagnose_both(true);
  EXPECT_EQ(d.verdict, Verdict::extended) << told(d);
  ASSERT_EQ(d.extended.effects.size(), 1u) << told(d);
  expect_effect(d, d.extended.effects.front(), "accel_second_order.y", 5.0);
}

// It is in one recording only, large: the other does not confirm it, and no name is given.
TEST(JoinedRecordings, OneUnitMustAgreeOnAnEffect) {
  JoinedUnit made = joined_unit();
  disturb(made.first, made.truth,
          on_accel(1, [](const DisturbedMoment& m) { return 15.0 * ug * m.force_g.y() * m.force_g.y(); }));
  const Diagnosis d = made.diagnose_both();
  EXPECT_EQ(d.holdout_source, "cross-validation over recordings");
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
  EXPECT_TRUE(d.effect_names.empty()) << told(d);
  EXPECT_FALSE(d.trusted());
}

// A drift belongs to one run: it is that recording's, and the unit's parameters are as without.
TEST(JoinedRecordings, OneUnitMayDriftInOneOfThem) {
  JoinedUnit made = joined_unit();
  disturb(made.second, made.truth, on_accel(0, [](const DisturbedMoment& m) { return 20.0 * ug * m.time_s / 3600.0; }));
  const Diagnosis d = made.diagnose_both(true);
  EXPECT_EQ(d.verdict, Verdict::extended) << told(d);
  EXPECT_TRUE(d.extended.effects.empty());
  ASSERT_EQ(d.each.effects.size(), 1u) << told(d);
  EXPECT_EQ(d.each.effects.front().column.recording, 1);
  expect_effect(d, d.each.effects.front(), "accel_bias_drift.x", 20.0);
  const ParameterVector error = to_vector(d.extended.parameters) - to_vector(made.truth);
  for (int k = 6; k < parameter_count; ++k) EXPECT_LE(std::abs(error[k]), 4.5 * d.extended.sigma[k]) << k;
}

// At one noise the estimates of two recordings, added up, are what one fit of both finds; each at its own they weigh the recordings better.
TEST(JoinedRecordings, OneUnitAreWhatTheirEstimatesAddUpTo) {
  const JoinedUnit& made = joined_unit();
  JointOptions options;
  options.noise = clean_diagnosis().base.noise;
  const SeveralRecordings several = made.combined(*options.noise);
  EXPECT_TRUE(several.agree);
  const JointResult& added = several.unit;
  const JoinedRecordings joined = join_recordings({&made.first, &made.second});
  options.effects = joined.turn_ons;
  options.begins = joined.begins;
  JointResult fit = joint_estimate(joined.data, options);
  leave_what_is_common(fit, 2);
  const ParameterVector apart = to_vector(added.parameters) - to_vector(fit.parameters);
  for (const int k : added.free) {
    EXPECT_LT(std::abs(apart[k]), 0.02 * fit.sigma[k]) << parameter_keys[k];
    EXPECT_NEAR(added.sigma[k] / fit.sigma[k], 1.0, 0.01) << parameter_keys[k];
  }
}

// An accelerometer that was bent between them, which is no scale factor: they contradict each other, as `combine_recordings` says.
TEST(JoinedRecordings, OneUnitAreTestedAgainstEachOther) {
  JoinedUnit made = joined_unit();
  disturb(made.second, made.truth, on_accel(1, [](const DisturbedMoment& m) { return 20.0 * ug * m.force_g.z(); }));
  const Diagnosis d = made.diagnose_both();
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
  EXPECT_FALSE(d.trusted());
  EXPECT_FALSE(made.combined(d.base.noise).agree);
}

// Nothing is looked for in recordings of two units, and what is handed out is what `combine_recordings` finds.
TEST(JoinedRecordings, OfTwoUnitsContradictEachOther) {
  JoinedUnit made = joined_unit();
  RigConfig other = default_rig_config();
  other.seed = 66;
  made.second = switched_on(other, 866).recording;
  const Diagnosis d = made.diagnose_both();
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
  EXPECT_SAYS(d.reason, "contradict each other");
  EXPECT_FALSE(d.trusted());
  const SeveralRecordings apart = combine_recordings({joint_estimate(made.first), joint_estimate(made.second)});
  EXPECT_EQ(to_vector(d.extended.parameters), to_vector(apart.unit.parameters));
  EXPECT_EQ(d.extended.sigma, apart.unit.sigma);
}

// One recording joined with nothing is that recording.
TEST(JoinedRecordings, OfOneAreIt) {
  const JoinedUnit& made = joined_unit();
  const JoinedRecordings one = join_recordings({&made.first}), both = join_recordings({&made.first, &made.second});
  EXPECT_TRUE(one.begins.empty() && one.turn_ons.empty());
  EXPECT_EQ(one.data.blocks.size(), made.first.blocks.size());
  ASSERT_EQ(both.begins, std::vector{made.first.blocks.size()});
  EXPECT_EQ(both.turn_ons.size(), 6u);
  EXPECT_EQ(both.data.samples, made.first.samples + made.second.samples);
}

// Biases that are a hundred degrees an hour apart: one linear step from the first's would be none.
TEST(JoinedRecordings, OfSwitchOnsFarApartAreOneUnit) {
  RigConfig config = default_rig_config();
  config.seed = 61;
  for (std::size_t k = 0; k < 3; ++k) config.truth[k] = 40.0;
  const RigRecording first = switched_on(config, 761);
  *config.truth[1] -= 100.0;
  const RigRecording second = switched_on(config, 861);
  const Diagnosis d = diagnose(join_recordings({&first.recording, &second.recording}), {});
  EXPECT_EQ(d.verdict, Verdict::clean) << told(d);
  ASSERT_EQ(d.each.turn_ons.biases.size(), 2u);
  EXPECT_NEAR(d.each.turn_ons.biases[1][1], -60.0, 0.1);
}

}  // namespace
}  // namespace turncal
