// Effects that once were handed out as `clean` or under a false name. They are laid on recordings of the rig by formulas of their own
// (tests/disturbance.h). Whatever the verdict is: no parameter of a trusted result is far from the truth.
#include "tests/calib/diagnosed_unit.h"
#include "tests/disturbance.h"
#include "tests/study/taken_up.h"

namespace turncal {
namespace {

// Added to one reading alone.
template <class Value>
Disturbance on_gyro(int axis, Value value) {
  return [=](const DisturbedMoment& m) { return to_gyro(axis, value(m)); };
}
template <class Value>
Disturbance on_accel(int axis, Value value) {
  return [=](const DisturbedMoment& m) mutable { return to_accel(axis, value(m)); };
}

void expect_named(const Diagnosis& d, const std::string& effect) {
  EXPECT_EQ(d.verdict, Verdict::extended) << told(d);
  EXPECT_TRUE(in_class(d, effect)) << told(d);
}

// One clean recording for all disturbances.
const Made& clean() {
  static const Made made = make(unit(31));
  return made;
}

// What biases and rows of the matrices take up of it over the recording are other parameters, and is left out.
Disturbance beside_parameters(const Disturbance& disturbance) {
  return without_parameters(disturbance, clean().recording, clean().truth);
}

Diagnosis diagnose_with(const Made& made, const Disturbance& disturbance) {
  Made disturbed = made;
  if (disturbance)
    for (CompressedRecording* recording : {&disturbed.recording, &disturbed.holdout})
      disturb(*recording, made.truth, disturbance);
  return diagnose_with_holdout(disturbed);
}

TEST(DiagnosisFaults, SecondOrderTermIsKeptThoughTheUnitWasSwitchedOffAndOn) {
  RigConfig config = unit(32);
  config.effects.accel_second_order = {0.0, 15.0, 0.0};
  const Made made = make(config, [](RigConfig& c) {
    for (std::size_t k = 0; k < 3; ++k) {
      *c.truth[k] += k == 1 ? -0.02 : 0.02;
      *c.truth[3 + k] += k == 1 ? 20e-6 : -20e-6;
    }
  });
  const Diagnosis d = diagnose_with(made, {});
  expect_named(d, "accel_second_order");
  EXPECT_LT(worst_sigmas(d, made.truth), 4.5);
}

TEST(DiagnosisFaults, DriftThatGoesOnIntoTheHoldoutIsKept) {
  Made made = clean();
  const auto drift = [](double from_h) {
    return on_accel(0, [from_h](const DisturbedMoment& m) { return 12.0 * ug * (from_h + m.time_s / 3600.0); });
  };
  disturb(made.recording, made.truth, drift(0.0));
  disturb(made.holdout, made.truth, drift(1.8));
  const Diagnosis d = diagnose_with_holdout(made);
  expect_named(d, "accel_bias_drift");
}

TEST(DiagnosisFaults, ScaleWarmUpIsNamedOrHasItsAlias) {
  const auto faded = [](const DisturbedMoment& m) { return std::exp(-m.time_s / 1200.0); };
  const Diagnosis gyro =
      diagnose_with(clean(), on_gyro(2, [=](const DisturbedMoment& m) { return 20e-6 * m.rate_radps[2] * faded(m); }));
  expect_named(gyro, "gyro_scale_warm_up");
  const Diagnosis accel = diagnose_with(
      clean(), on_accel(2, [=](const DisturbedMoment& m) { return 20.0 * ug * m.force_g[2] * faded(m); }));
  expect_named(accel, "accel_scale_warm_up");
}

TEST(DiagnosisFaults, ScatterOfScaleFromTurnToTurnIsNotClean) {
  const Diagnosis d = diagnose_with(clean(), [](const DisturbedMoment& m) {
    AddedReading added;
    for (int axis = 0; axis < 3; ++axis) {
      std::mt19937_64 own(std::uint64_t(3 * m.turn + axis));
      added.gyro_radps[axis] = 6e-6 * std::normal_distribution<double>()(own) * m.rate_radps[axis];
    }
    return added;
  });
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
  EXPECT_FALSE(d.trusted);
  EXPECT_TRUE(d.effect_names.empty()) << told(d);
}

// Of the scale factor of one gyro, another number in each turn.
Disturbance scattered(int axis, double size, std::uint64_t seed) {
  return on_gyro(axis, [=](const DisturbedMoment& m) {
    std::mt19937_64 own(seed + std::uint64_t(m.turn));
    own.discard(3);
    return size * std::normal_distribution<double>()(own) * m.rate_radps[axis];
  });
}

// Of one gyro alone it once passed for an asymmetry: of sizes and axes at random none gets a name, nor is it trusted far from the truth.
TEST(DiagnosisFaults, ScatterOfOneScaleFactorGetsNoName) {
  std::mt19937_64 random(20261122);
  for (int k = 0; k < 5; ++k) {
    const int axis = k % 3;
    const double size = 1e-6 * std::uniform_real_distribution<double>(3.0, 12.0)(random);
    const std::uint64_t seed = random();
    const Diagnosis d = diagnose_with(clean(), scattered(axis, size, seed));
    EXPECT_TRUE(d.effect_names.empty()) << axis << " " << size << ": " << told(d);
    if (d.trusted) {
      EXPECT_LT(worst_sigmas(d, clean().truth), 4.5) << axis << " " << size << ": " << told(d);
    }
  }
}

// Two turns of the fourteen steps tell n22. What both have in common is n22 of this recording. (Undisturbed its A03 is 4.4 sigma off.)
TEST(DiagnosisFaults, ScatterOfTwoTurnsIsNotTrustedFarFromTheTruth) {
  const Parameters undisturbed = diagnose_with(clean(), {}).extended.parameters;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const Diagnosis d = diagnose_with(clean(), beside_parameters(scattered(1, 4e-6, 1000 * seed)));
    if (d.trusted) {
      EXPECT_LT(worst_sigmas(d, undisturbed), 4.5) << seed << ": " << told(d);
    }
  }
}

// Noise is of a recording: one that is noisier than the fit is judged by its own.
TEST(DiagnosisFaults, NoisierHoldoutIsJudgedByItsOwnNoise) {
  Made made = clean();
  RigConfig config = unit(31);
  for (std::size_t k = 0; k < 24; ++k) config.truth[k] = to_vector(made.truth)[int(k)];
  config.noise_seed = 4711;
  config.noise.gyro_random_walk_deg_per_rt_h *= 5.0;
  config.noise.accel_random_walk_ug_per_rt_hz *= 5.0;
  made.holdout = record_on_rig(must_read_sequence("holdout.seq"), config).recording;
  const Diagnosis d = diagnose_with(made, {});
  EXPECT_EQ(d.verdict, Verdict::clean) << told(d);
  EXPECT_NEAR(d.holdout_after.normalised_rms, 1.0, 0.2);
  EXPECT_NEAR(d.holdout_own_noise, 5.0, 1.5);
}

// Switched on again a MEMS unit is another by hundreds of degrees an hour: one linear step from the fit's biases is none.
TEST(DiagnosisFaults, HoldoutOfAnotherSwitchOnIsCleanHoweverFarItsBiasesAre) {
  for (const double shift_degph : {30.0, 100.0, 300.0}) {
    RigConfig config = unit(34);
    config.noise.gyro_random_walk_deg_per_rt_h = 0.05;
    for (std::size_t k = 0; k < 3; ++k) config.truth[k] = k == 1 ? -200.0 : 300.0;
    const Made made = make(config, [&](RigConfig& c) {
      for (std::size_t k = 0; k < 3; ++k) *c.truth[k] += k == 2 ? -shift_degph : shift_degph;
    });
    const Diagnosis d = diagnose_with(made, {});
    EXPECT_EQ(d.verdict, Verdict::clean) << shift_degph << " " << told(d);
    EXPECT_LT(worst_sigmas(d, made.truth), 4.5);
  }
}

TEST(DiagnosisFaults, BiasWithATableAngleGetsNoName) {
  std::mt19937_64 random(20261123);
  for (int k = 0; k < 6; ++k) {
    const int axis = int(random() % 3), table = int(random() % 3);
    const double order = 2.0 + double(random() % 3);
    const double phase = std::uniform_real_distribution<double>(0.0, 2.0 * pi)(random);
    const double size = std::uniform_real_distribution<double>(10.0, 40.0)(random);
    const bool gyro = k % 2 == 0;
    const auto wave = [=](const DisturbedMoment& m) {
      return (gyro ? 0.005 * degph : ug) * size * std::sin(order * m.table_rad[table] + phase);
    };
    const Diagnosis d = diagnose_with(clean(), beside_parameters(gyro ? on_gyro(axis, wave) : on_accel(axis, wave)));
    EXPECT_TRUE(d.effect_names.empty()) << k << ": " << told(d);
    if (d.trusted) {
      EXPECT_LT(worst_sigmas(d, clean().truth), 4.5) << k << ": " << told(d);
    }
  }
}

// Its column was once made from the measured rate, whose noise it shared with what it was to explain.
// It is more in one sense of rotation than in the other; a size effect, which goes with products of two rates, is the same in both.
TEST(DiagnosisFaults, BiasWithTheRateAboutOneAxisIsNoSizeEffect) {
  const Diagnosis d = diagnose_with(clean(), on_accel(2, [](const DisturbedMoment& m) {
                                      return 25.0 * ug * (std::sin(9.0 * m.rate_radps.y() + 1.2) - std::sin(1.2));
                                    }));
  EXPECT_TRUE(d.effect_names.empty()) << told(d);
  EXPECT_EQ(d.verdict, Verdict::unexplained) << told(d);
}

TEST(DiagnosisFaults, CleanUnitsHaveNoLockIn) {
  static const Sequence sequence = must_read_sequence("fourteen_step.seq");
  for (const std::uint64_t seed : {51u, 52u, 53u, 54u}) {
    RigConfig config = unit(seed);
    config.noise.gyro_random_walk_deg_per_rt_h = 0.004;
    const Diagnosis d = diagnose(record_on_rig(sequence, config).recording);
    for (const CandidateScore& c : d.candidates) {
      if (c.column.entry->name == "gyro_lock_in" && c.visible) {
        EXPECT_LT(std::abs(c.z), 4.5) << seed << " " << c.column.key();
      }
    }
  }
}

// c (f - f lagged by tau) along an axis.
Disturbance creep(int axis, double micro_g, double tau_s) {
  return on_accel(axis, [=, force = 0.0, left = 0.0, time = 1e9](const DisturbedMoment& m) mutable {
    if (m.time_s < time) left = 0.0, force = m.force_g[axis], time = m.time_s;
    left = left * std::exp(-(m.time_s - time) / tau_s) + (m.force_g[axis] - force);
    force = m.force_g[axis];
    time = m.time_s;
    return micro_g * ug * left;
  });
}

TEST(DiagnosisFaults, CreepAfterAChangeOfForce) {
  const Diagnosis d = diagnose_with(clean(), creep(1, 15.0, 250.0));
  expect_named(d, "accel_creep");
  EXPECT_LT(worst_sigmas(d, clean().truth), 4.5);
}

// On x the fourteen steps leave 0.8 % of such a creep beside the scale factor: four sigma of it are no name, and the rest is a11.
TEST(DiagnosisFaults, CreepThatLooksLikeAScaleFactorIsOne) {
  const Diagnosis d = diagnose_with(clean(), beside_parameters(creep(0, -17.0, 409.0)));
  EXPECT_TRUE(d.trusted) << told(d);
  EXPECT_LT(worst_sigmas(d, clean().truth), 4.5) << told(d);
}

TEST(DiagnosisFaults, SmoothLockInIsNotTheEarthRate) {
  const Diagnosis d = diagnose_with(clean(), [](const DisturbedMoment& m) {
    AddedReading added;
    for (int axis = 0; axis < 3; ++axis) {
      const double w = m.rate_radps[axis], w0 = 3.0 * degph;
      added.gyro_radps[axis] = -0.04 * w * w0 * w0 / (w0 * w0 + w * w);
    }
    return added;
  });
  EXPECT_EQ(std::ranges::count(d.effect_names, "earth_rate"), 0) << told(d);
  if (d.trusted) {
    EXPECT_LT(worst_sigmas(d, clean().truth), 4.5) << told(d);
  }
}

TEST(DiagnosisFaults, SigmasHoldTheSpreadOverTheAliasClass) {
  const Diagnosis d = diagnose_with(
      clean(), on_accel(0, [](const DisturbedMoment& m) { return 60.0 * ug * m.force_g[0] * std::abs(m.force_g[0]); }));
  expect_named(d, "accel_odd_quadratic");
  EXPECT_LT(worst_sigmas(d, clean().truth), 4.5) << told(d);
}

TEST(DiagnosisFaults, NothingDeterminedIsNotTested) {
  CompressedRecording empty;
  empty.info = clean().recording.info;
  EXPECT_EQ(diagnose(empty).verdict, Verdict::not_tested);
}

// Two exponentials of one gyro: its warm-up is in the model already, so it is no candidate with another time constant.
TEST(DiagnosisFaults, OneComponentIsNotTakenTwice) {
  const auto warm_ups = on_gyro(1, [](const DisturbedMoment& m) {
    return 5.0 * degph * (std::exp(-m.time_s / 60.0) + std::exp(-m.time_s / 700.0));
  });
  const Diagnosis d = diagnose_with(clean(), beside_parameters(warm_ups));
  std::set<std::string> accepted;
  for (const EstimatedEffect& effect : d.extended.effects)
    EXPECT_TRUE(accepted.insert(effect.column.key()).second) << effect.column.key() << " twice; " << told(d);
  if (d.trusted) {
    EXPECT_LT(errors_in_sigmas(d.extended, clean().recording, clean().truth).cwiseAbs().maxCoeff(), 4.5) << told(d);
  }
}

// Between the time constants of the list, and beyond its ends: the one of the data is found, and what it leaves open is in the sigmas.
TEST(DiagnosisFaults, TimeConstantIsFoundAndInTheSigmas) {
  std::mt19937_64 random(20261124);
  int named = 0;
  for (int k = 0; k < 6; ++k) {
    const double tau_s = 60.0 * std::pow(50.0, std::uniform_real_distribution<double>(0.0, 1.0)(random));
    const int axis = k % 3;
    const Diagnosis d = diagnose_with(clean(), [=](const DisturbedMoment& m) {
      const double faded = std::exp(-m.time_s / tau_s);
      return k / 2 == 1   ? to_gyro(axis, 0.5 * degph * faded)
             : k / 2 == 2 ? to_accel(axis, 150.0 * ug * faded)
                          : to_accel(axis, -62.0 * ug * m.force_g[axis] * faded);
    });
    if (!d.trusted) continue;
    named += d.effect_names.empty() ? 0 : 1;
    EXPECT_LT(worst_sigmas(d, clean().truth), 4.5) << k << ", " << tau_s << " s: " << told(d);
  }
  EXPECT_GE(named, 3);
}

TEST(DiagnosisFaults, ParametersLeftOpenAreNotCalledClean) {
  Sequence one = must_read_sequence("fourteen_step.seq");
  one.steps.resize(1);
  const Diagnosis d = diagnose(record_on_rig(one, unit(37)).recording);
  EXPECT_FALSE(d.base.undetermined.empty());
  EXPECT_EQ(d.verdict, Verdict::not_tested) << told(d);
  EXPECT_FALSE(d.trusted);
}

// A latitude so far off that it hides in the noise is in the reason.
TEST(DiagnosisFaults, ALatitudeOfTheOtherHemisphereIsSaid) {
  CompressedRecording recording = clean().recording;
  recording.info.latitude_deg = -recording.info.latitude_deg;
  const Diagnosis d = diagnose(recording, {});
  EXPECT_FALSE(d.trusted) << told(d);
  EXPECT_SAYS(d.reason, "of a latitude of");
  EXPECT_EQ(d.effect_names, std::vector<std::string>{"earth_rate"}) << told(d);
}

}  // namespace
}  // namespace turncal
