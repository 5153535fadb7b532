// One unit switched on several times: rig recordings with the same scale factors and misalignments and other biases.
#include "calib/joint/several_recordings.h"

#include "calib/evidence/diagnosis.h"
#include "tests/calib/diagnosed_unit.h"
#include "tests/disturbance.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

RigConfig quiet() {
  RigConfig config = default_rig_config();
  config.seed = 77;
  config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
  return config;
}

RigRecording switched_on(const RigConfig& config, std::uint64_t noise_seed, const char* sequence) {
  RigConfig c = config;
  c.noise_seed = noise_seed;
  return record_on_rig(must_read_sequence(sequence), c);
}

// An estimate as if the unit had had other biases: exact, since what the estimate says of them is linear.
JointResult with_biases(JointResult estimate, double sign) {
  estimate.parameters.N0_degph.array() += sign * gyro_turn_on_degph;
  estimate.parameters.A0_g.array() += sign * accel_turn_on_g;
  return estimate;
}

TEST(SeveralRecordings, CommonParametersGainAndBiasesAreOfEach) {
  std::vector<JointResult> estimates;
  Parameters truth;
  for (const double sign : {1.0, -1.0, 0.0}) {
    const RigRecording made = switched_on(quiet(), 501 + estimates.size(), "fourteen_step.seq");
    truth = made.truth;
    estimates.push_back(with_biases(joint_estimate(made.recording), sign));
  }
  const SeveralRecordings r = combine_recordings(estimates);
  EXPECT_EQ(r.degrees, 30);
  EXPECT_TRUE(r.agree) << r.disagreement;
  EXPECT_GT(r.p_value, 0.001);
  EXPECT_LT(nees(r.unit, truth), chi_square_21_one_in_1000);
  for (int k = 6; k < parameter_count; ++k) {
    if (!parameter_is_free[k]) continue;
    EXPECT_NEAR(r.unit.sigma[k] / estimates[0].sigma[k], 1.0 / std::sqrt(3.0), 0.06) << k;
  }
  for (int k = 0; k < 6; ++k) {
    const double step = k < 3 ? gyro_turn_on_degph : accel_turn_on_g;
    EXPECT_NEAR((r.turn_ons.biases[0][k] - r.turn_ons.biases[1][k]) / (2.0 * step), 1.0, 0.1) << k;
    EXPECT_NEAR(r.turn_ons.repeatability[k] / step, 1.0, 0.1) << k;  // of +1, -1 and 0
    EXPECT_GT(r.unit.sigma[k], 0.9 * step / std::sqrt(3.0)) << k;
  }
}

// A short recording that determines little leans on one that does.
TEST(SeveralRecordings, WhatOneDoesNotDetermineTheOtherMay) {
  const RigRecording whole = switched_on(quiet(), 511, "fourteen_step.seq");
  JointResult little = joint_estimate(switched_on(quiet(), 512, "short_demo.seq").recording);
  const JointResult alone = joint_estimate(whole.recording);
  const SeveralRecordings r = combine_recordings({alone, little});
  for (const int k : r.unit.free) {
    EXPECT_TRUE(r.unit.determined[k]) << k;
    if (k < 6) continue;
    EXPECT_LT(r.unit.sigma[k], 1.001 * alone.sigma[k]) << k;
  }
  EXPECT_TRUE(r.agree) << r.disagreement << " of " << r.degrees;
}

// At four headings of a level table nothing tells a scale factor from its bias: where its own fit ends along that is no contradiction.
TEST(SeveralRecordings, ALevelTableContradictsNothing) {
  const RigRecording whole = switched_on(quiet(), 531, "fourteen_step.seq");
  const JointResult alone = joint_estimate(whole.recording);
  for (const std::uint64_t seed : {532u, 533u, 534u, 535u, 536u, 537u}) {
    const RigRecording turned = switched_on(quiet(), seed, "verify.seq");
    const JointResult level = estimate_beside(turned.recording, alone.parameters);
    ASSERT_TRUE(level.converged) << level.message;
    EXPECT_FALSE(level.undetermined.empty());
    const SeveralRecordings r = combine_recordings({alone, level});
    EXPECT_TRUE(r.agree) << seed << ": " << r.disagreement << " of " << r.degrees;
    EXPECT_LT(nees(r.unit, whole.truth), chi_square_21_one_in_1000) << seed;
  }
}

TEST(SeveralRecordings, AScaleFactorThatChangedIsSaid) {
  const JointResult first = joint_estimate(switched_on(quiet(), 521, "fourteen_step.seq").recording);
  JointResult second = joint_estimate(switched_on(quiet(), 522, "fourteen_step.seq").recording);
  second.parameters.n(0, 0) += 12.0 * second.sigma[6];
  const SeveralRecordings r = combine_recordings({first, second});
  EXPECT_FALSE(r.agree);
  EXPECT_LT(r.p_value, 1e-6);
  EXPECT_GT(r.unit.sigma[6], 1.2 * first.sigma[6]);
}

// ---- joined recordings ----

// Several recordings of one unit, fitted and diagnosed as one: rig recordings of one unit, each with a turn-on of its own laid on it.

AddedReading turn_on(double of) {
  AddedReading added;
  added.gyro_radps.setConstant(of * gyro_turn_on_degph * radps_per_degph);
  added.accel_mps2.setConstant(of * accel_turn_on_g * standard_gravity_mps2);
  return added;
}

// A unit in two recordings, the second switched on with other biases, and one more for a holdout.
struct JoinedUnit {
  CompressedRecording first, second, holdout;
  Parameters truth;
};

const JoinedUnit& joined_unit(std::uint64_t seed) {
  static std::map<std::uint64_t, JoinedUnit> units;
  if (const auto known = units.find(seed); known != units.end()) return known->second;
  RigConfig config = default_rig_config();
  config.seed = seed;
  config.noise_seed = 700 + seed;
  RigRecording first = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  config.noise_seed = 800 + seed;
  RigRecording second = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  config.noise_seed = 900 + seed;
  RigRecording holdout = record_on_rig(must_read_sequence("holdout.seq"), config);
  disturb(second.recording, second.truth, [](const DisturbedMoment&) { return turn_on(1.0); });
  disturb(holdout.recording, second.truth, [](const DisturbedMoment&) { return turn_on(-1.0); });
  return units[seed] = {std::move(first.recording), std::move(second.recording), std::move(holdout.recording),
                        first.truth};
}

Diagnosis diagnose_both(const JoinedUnit& made, const std::vector<const CompressedRecording*>& holdouts = {}) {
  DiagnosisOptions options;
  options.holdouts = holdouts;
  return diagnose(join_recordings({&made.first, &made.second}), options);
}

// Of another turn-on nothing is made but another bias; what is common is known as from twice the data.
TEST(JoinedRecordings, OneUnitAreCleanWhateverTheirTurnOns) {
  const JoinedUnit made = joined_unit(62);
  const JointResult alone = joint_estimate(made.first);
  const Diagnosis d = diagnose_both(made, {&made.holdout});
  EXPECT_EQ(d.verdict, Verdict::clean) << told(d);
  EXPECT_EQ(d.holdout_source, "second recording");
  EXPECT_TRUE(d.extended.effects.empty());
  ASSERT_EQ(d.each.turn_ons.biases.size(), 2u);
  const TurnOns& turn_ons = d.each.turn_ons;
  const ParameterVector truth = to_vector(made.truth);
  for (int k = 0; k < 6; ++k) {
    const double step = k < 3 ? gyro_turn_on_degph : accel_turn_on_g;
    EXPECT_LT(std::abs(turn_ons.biases[0][k] - truth[k]), 4.5 * turn_ons.sigma[0][k]) << k;
    EXPECT_LT(std::abs(turn_ons.biases[1][k] - truth[k] - step), 4.5 * turn_ons.sigma[1][k]) << k;
    EXPECT_NEAR(turn_ons.repeatability[k] / step, std::sqrt(0.5), 0.15) << k;
    EXPECT_NEAR(to_vector(d.extended.parameters)[k], truth[k] + 0.5 * step, 4.5 * turn_ons.sigma[0][k]) << k;
    EXPECT_GT(d.extended.sigma[k], 0.4 * step) << k;
  }
  for (int k = 6; k < parameter_count; ++k) {
    if (!parameter_is_free[k]) continue;
    const auto at = std::ranges::find(d.extended.free, k) - d.extended.free.begin();
    EXPECT_LT(std::sqrt(d.fitted_covariance(at, at)), 0.85 * alone.sigma[k]) << k;
    EXPECT_LT(std::abs(to_vector(d.extended.parameters)[k] - truth[k]), 4.5 * d.extended.sigma[k]) << k;
  }
}

// Too little of it for one recording (five sigma there), enough for both.
TEST(JoinedRecordings, OneUnitHaveItsEffectInCommon) {
  JoinedUnit made = joined_unit(62);
  const double K2 = 5e-6 / standard_gravity_mps2;
  const Disturbance second_order = [K2](const DisturbedMoment& m) {
    return to_accel(1, K2 * std::pow(standard_gravity_mps2 * m.force_g.y(), 2));
  };
  for (CompressedRecording* one : {&made.first, &made.second, &made.holdout}) disturb(*one, made.truth, second_order);
  const Diagnosis d = diagnose_both(made, {&made.holdout});
  EXPECT_EQ(d.verdict, Verdict::extended) << told(d);
  ASSERT_EQ(d.extended.effects.size(), 1u) << told(d);
  const EstimatedEffect& found = d.extended.effects.front();
  const auto& aliases = d.aliases.at(std::string(found.column.entry->name));
  EXPECT_TRUE(found.column.key() == "accel_second_order.y" || std::ranges::count(aliases, "accel_second_order") == 1)
      << told(d);
  if (found.column.key() == "accel_second_order.y") {
    EXPECT_NEAR(found.value, 5.0, 4.0 * found.sigma);
  }
}

// It is in one recording only, large: the other does not confirm it, and no name is given.
TEST(JoinedRecordings, OneUnitMustAgreeOnAnEffect) {
  JoinedUnit made = joined_unit(62);
  disturb(made.first, made.truth,
          [](const DisturbedMoment& m) { return to_accel(1, 25.0 * ug * m.force_g.y() * m.force_g.y()); });
  const Diagnosis d = diagnose_both(made);
  EXPECT_EQ(d.holdout_source, "cross-validation over recordings");
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
  EXPECT_TRUE(d.effect_names.empty()) << told(d);
  EXPECT_FALSE(d.trusted);
}

// A drift belongs to one run: it is that recording's, and the unit's parameters are as without.
TEST(JoinedRecordings, OneUnitMayDriftInOneOfThem) {
  JoinedUnit made = joined_unit(62);
  disturb(made.second, made.truth, [](const DisturbedMoment& m) { return to_accel(0, 20.0 * ug * m.time_s / 3600.0); });
  const Diagnosis d = diagnose_both(made, {&made.holdout});
  EXPECT_EQ(d.verdict, Verdict::extended) << told(d);
  EXPECT_TRUE(d.extended.effects.empty());
  ASSERT_EQ(d.each.effects.size(), 1u) << told(d);
  EXPECT_EQ(d.each.effects.front().column.recording, 1);
  const std::string name(d.each.effects.front().column.entry->name);
  const std::vector<std::string>& aliases = d.aliases.at(name);
  EXPECT_TRUE(name == "accel_bias_drift" || std::ranges::count(aliases, "accel_bias_drift") == 1) << told(d);
  if (name == "accel_bias_drift") {
    EXPECT_NEAR(d.each.effects.front().value, 20.0, 4.0 * d.each.effects.front().sigma);
  }
  const ParameterVector error = to_vector(d.extended.parameters) - to_vector(made.truth);
  for (int k = 6; k < parameter_count; ++k) EXPECT_LE(std::abs(error[k]), 4.5 * d.extended.sigma[k]) << k;
}

// At one noise the estimates of two recordings, added up, are what one fit of both finds; each at its own they weigh the recordings better.
TEST(JoinedRecordings, OneUnitAreWhatTheirEstimatesAddUpTo) {
  const JoinedUnit made = joined_unit(62);
  JointOptions options;
  options.noise = joint_estimate(made.first).noise;
  const JointResult added =
      combine_recordings({joint_estimate(made.first, options), joint_estimate(made.second, options)}).unit;
  const JoinedRecordings joined = join_recordings({&made.first, &made.second});
  options.effects = joined.turn_ons;
  options.begins = joined.begins;
  JointResult fit = joint_estimate(joined.data, options);
  const std::vector<int> free = added.free;
  leave_what_is_common(fit, 2);
  const ParameterVector apart = to_vector(added.parameters) - to_vector(fit.parameters);
  for (const int k : free) {
    EXPECT_LT(std::abs(apart[k]), 0.02 * fit.sigma[k]) << parameter_keys[k];
    EXPECT_NEAR(added.sigma[k] / fit.sigma[k], 1.0, 0.01) << parameter_keys[k];
  }
}

// An accelerometer that was bent between them, which is no scale factor: they contradict each other, as `combine_recordings` says.
TEST(JoinedRecordings, OneUnitAreTestedAgainstEachOther) {
  JoinedUnit made = joined_unit(62);
  const auto of_estimates = [&](const NoiseModel& noise) {
    JointOptions at;
    at.noise = noise;
    return combine_recordings({joint_estimate(made.first, at), joint_estimate(made.second, at)});
  };
  EXPECT_TRUE(of_estimates(diagnose_both(made).base.noise).agree);
  disturb(made.second, made.truth, [](const DisturbedMoment& m) { return to_accel(1, 20.0 * ug * m.force_g.z()); });
  const Diagnosis d = diagnose_both(made);
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
  EXPECT_FALSE(d.trusted);
  EXPECT_FALSE(of_estimates(d.base.noise).agree);
}

// Nothing is looked for in recordings of two units, and what is handed out is what `combine_recordings` finds.
TEST(JoinedRecordings, OfTwoUnitsContradictEachOther) {
  JoinedUnit made = joined_unit(65);
  made.second = joined_unit(66).second;
  const Diagnosis d = diagnose_both(made);
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
  EXPECT_NE(d.reason.find("contradict each other"), std::string::npos) << told(d);
  EXPECT_FALSE(d.trusted);
  const SeveralRecordings apart = combine_recordings({joint_estimate(made.first), joint_estimate(made.second)});
  EXPECT_EQ(to_vector(d.extended.parameters), to_vector(apart.unit.parameters));
  EXPECT_EQ(d.extended.sigma, apart.unit.sigma);
}

// One recording joined with nothing is that recording.
TEST(JoinedRecordings, OfOneAreIt) {
  const JoinedUnit made = joined_unit(64);
  const JoinedRecordings one = join_recordings({&made.first});
  EXPECT_TRUE(one.begins.empty() && one.turn_ons.empty());
  EXPECT_EQ(one.data.blocks.size(), made.first.blocks.size());
  const JoinedRecordings both = join_recordings({&made.first, &made.second});
  ASSERT_EQ(both.begins, std::vector{made.first.blocks.size()});
  EXPECT_EQ(both.turn_ons.size(), 6u);
  EXPECT_EQ(both.data.samples, made.first.samples + made.second.samples);
}

// Biases that are a hundred degrees an hour apart: one linear step from the first's would be none.
TEST(JoinedRecordings, OfSwitchOnsFarApartAreOneUnit) {
  for (const double apart_degph : {60.0, -100.0}) {
    RigConfig config = default_rig_config();
    config.seed = 61;
    config.noise_seed = 761;
    for (std::size_t k = 0; k < 3; ++k) config.truth[k] = 40.0;
    const RigRecording first = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
    config.noise_seed = 861;
    *config.truth[1] += apart_degph;
    const RigRecording second = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
    const Diagnosis d = diagnose(join_recordings({&first.recording, &second.recording}), {});
    EXPECT_EQ(d.verdict, Verdict::clean) << apart_degph << " " << told(d);
    ASSERT_EQ(d.each.turn_ons.biases.size(), 2u);
    EXPECT_NEAR(d.each.turn_ons.biases[1][1], 40.0 + apart_degph, 0.1);
  }
}

}  // namespace
}  // namespace turncal
