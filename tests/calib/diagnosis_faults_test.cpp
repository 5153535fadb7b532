// Effects that once were handed out as `clean` or under a false name. They are laid on recordings of the rig by formulas of their own
// (tests/disturbance.h). Whatever the verdict is: no parameter of a trusted result is far from the truth.
#include "tests/calib/diagnosed_unit.h"
#include "tests/disturbance.h"
#include "tests/study/taken_up.h"

namespace turncal {
namespace {

// One clean recording for all disturbances.
const Made& clean() {
  static const Made made = make(unit(31));
  return made;
}

// What biases and rows of the matrices take up of it over the recording are other parameters, and is left out.
Disturbance beside_parameters(const Disturbance& disturbance) {
  return without_parameters(disturbance, clean().recording, clean().truth);
}

Diagnosis diagnose_with(const Disturbance& disturbance) {
  Made disturbed = clean();
  for (CompressedRecording* recording : {&disturbed.recording, &disturbed.holdout})
    disturb(*recording, clean().truth, disturbance);
  return diagnose_with_holdout(disturbed);
}

void expect_trust_is_deserved(const Diagnosis& d) {
  EXPECT_TRUE(!d.trusted() || worst_sigmas(d, clean().truth) < 4.5) << told(d);
}

void expect_named(const Diagnosis& d, const std::string& effect) {
  EXPECT_EQ(d.verdict, Verdict::extended) << told(d);
  EXPECT_TRUE(in_class(d, effect)) << told(d);
}

enum class Said { a_name, no_name, unexplained, trusted };

struct Laid {
  std::string what;
  Said said;
  std::string name;  // found, or not told from what was found
  Disturbance added;
};

// Sizes, axes and phases at random. Scatter of one gyro once passed for an asymmetry.
std::vector<Laid> drawn_without_name() {
  std::vector<Laid> list;
  std::mt19937_64 random(20261122);
  const auto between = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
  for (int axis = 0; axis < 3; ++axis) {
    const double size = 1e-6 * between(3.0, 12.0);
    list.push_back({"scatter of one scale factor", Said::no_name, "", scattered_scale(axis, size, random())});
  }
  for (const bool gyro : {true, false, true, false}) {
    const int axis = int(random() % 3), table = int(random() % 3);
    const double order = 2.0 + double(random() % 3), phase = between(0.0, 2.0 * pi);
    const double size = (gyro ? 0.005 * degph : ug) * between(10.0, 40.0);
    const auto wave = [=](const DisturbedMoment& m) { return size * std::sin(order * m.table_rad[table] + phase); };
    list.push_back({gyro ? "gyro's bias with an angle" : "accelerometer's bias with an angle", Said::no_name, "",
                    beside_parameters(gyro ? on_gyro(axis, wave) : on_accel(axis, wave))});
  }
  return list;
}

TEST(DiagnosisFaults, WhatIsLaidOnIsNamedOrHasNoName) {
  std::vector<Laid> list = {
      {"creep", Said::a_name, "accel_creep", accel_creep(1, 15.0, 250.0)},
      {"f abs(f)", Said::a_name, "accel_odd_quadratic",
       on_accel(0, [](const DisturbedMoment& m) { return 60.0 * ug * m.force_g[0] * std::abs(m.force_g[0]); })},
      // On x the fourteen steps leave 0.8 % of such a creep beside the scale factor: four sigma of it are no name, and the rest is a11.
      {"creep that looks like a scale factor", Said::trusted, "", beside_parameters(accel_creep(0, -17.0, 409.0))},
      {"scatter of all scale factors from turn to turn", Said::unexplained, "",
       [](const DisturbedMoment& m) {
         AddedReading added;
         for (int axis = 0; axis < 3; ++axis) {
           std::mt19937_64 own(std::uint64_t(3 * m.turn + axis));
           added.gyro_radps[axis] = 6e-6 * std::normal_distribution<double>()(own) * m.rate_radps[axis];
         }
         return added;
       }},
      // It is more in one sense of rotation than in the other; a size effect, which goes with products of two rates, is the same in both.
      {"bias with the rate about one axis", Said::unexplained, "",
       on_accel(2,
                [](const DisturbedMoment& m) {
                  return 25.0 * ug * (std::sin(9.0 * m.rate_radps.y() + 1.2) - std::sin(1.2));
                })},
  };
  for (Laid& drawn : drawn_without_name()) list.push_back(std::move(drawn));
  for (const Laid& laid : list) {
    SCOPED_TRACE(laid.what);
    const Diagnosis d = diagnose_with(laid.added);
    expect_trust_is_deserved(d);
    if (laid.said == Said::a_name) expect_named(d, laid.name);
    const bool unexplained = laid.said == Said::unexplained;
    EXPECT_TRUE(d.trusted() || laid.said != Said::trusted) << told(d);
    EXPECT_TRUE(d.effect_names.empty() || !(unexplained || laid.said == Said::no_name)) << told(d);
    EXPECT_TRUE((d.verdict == Verdict::unexplained && !d.trusted()) || !unexplained) << told(d);
  }
}

TEST(DiagnosisFaults, ScaleWarmUpIsNamedOrHasItsAlias) {
  const auto faded = [](const DisturbedMoment& m) { return 20e-6 * std::exp(-m.time_s / 1200.0); };
  expect_named(diagnose_with(on_gyro(2, [=](const DisturbedMoment& m) { return m.rate_radps[2] * faded(m); })),
               "gyro_scale_warm_up");
  expect_named(diagnose_with(on_accel(
                   2, [=](const DisturbedMoment& m) { return standard_gravity_mps2 * m.force_g[2] * faded(m); })),
               "accel_scale_warm_up");
}

TEST(DiagnosisFaults, SmoothLockInIsNotTheEarthRate) {
  const auto locked = [](double rate) { return locked_in(rate, -0.04, 3.0); };
  const Diagnosis d = diagnose_with(
      [&](const DisturbedMoment& m) { return AddedReading{.gyro_radps = m.rate_radps.unaryExpr(locked)}; });
  EXPECT_EQ(std::ranges::count(d.effect_names, "earth_rate"), 0) << told(d);
  expect_trust_is_deserved(d);
}

// Two turns of the fourteen steps tell n22. What both have in common is n22 of this recording. (Undisturbed its A03 is 4.4 sigma off.)
TEST(DiagnosisFaults, ScatterOfTwoTurnsIsNotTrustedFarFromTheTruth) {
  const Parameters undisturbed = diagnose_with_holdout(clean()).extended.parameters;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const Diagnosis d = diagnose_with(beside_parameters(scattered_scale(1, 4e-6, 1000 * seed)));
    EXPECT_TRUE(!d.trusted() || worst_sigmas(d, undisturbed) < 4.5) << seed << ": " << told(d);
  }
}

// Two exponentials of one gyro: its warm-up is in the model already, so it is no candidate with another time constant.
TEST(DiagnosisFaults, OneComponentIsNotTakenTwice) {
  const Diagnosis d = diagnose_with(beside_parameters(on_gyro(1, [](const DisturbedMoment& m) {
    return 5.0 * degph * (std::exp(-m.time_s / 60.0) + std::exp(-m.time_s / 700.0));
  })));
  std::set<std::string> accepted;
  for (const EstimatedEffect& effect : d.extended.effects)
    EXPECT_TRUE(accepted.insert(effect.column.key()).second) << effect.column.key() << " twice; " << told(d);
  expect_trust_is_deserved(d);
}

// Between the time constants of the list, and beyond its ends: the one of the data is found, and what it leaves open is in the sigmas.
TEST(DiagnosisFaults, TimeConstantIsFoundAndInTheSigmas) {
  std::mt19937_64 random(20261124);
  int named = 0;
  for (const int axis : {0, 1, 2}) {
    const double tau_s = 60.0 * std::pow(50.0, std::uniform_real_distribution<double>(0.0, 1.0)(random));
    SCOPED_TRACE(tau_s);
    const Diagnosis d = diagnose_with([=](const DisturbedMoment& m) {
      const double faded = std::exp(-m.time_s / tau_s);
      return axis == 0   ? to_accel(axis, -62.0 * ug * m.force_g[axis] * faded)
             : axis == 1 ? to_gyro(axis, 0.5 * degph * faded)
                         : to_accel(axis, 150.0 * ug * faded);
    });
    named += d.trusted() && !d.effect_names.empty();
    expect_trust_is_deserved(d);
  }
  EXPECT_GE(named, 2);
  // Slower than half the recording: the settled bias is open, and its sigma says so.
  const auto slow = [](const DisturbedMoment& m) { return 60.0 * ug * std::exp(-m.time_s / 3000.0); };
  const Diagnosis d = diagnose_with(on_accel(1, slow));
  EXPECT_TRUE(d.trusted() && in_class(d, "accel_warm_up")) << told(d);
  expect_trust_is_deserved(d);
}

TEST(DiagnosisFaults, DriftThatGoesOnIntoTheHoldoutIsKept) {
  Made made = clean();
  const auto drift = [](double from_h) {
    return on_accel(0, [from_h](const DisturbedMoment& m) { return 12.0 * ug * (from_h + m.time_s / 3600.0); });
  };
  disturb(made.recording, made.truth, drift(0.0));
  disturb(made.holdout, made.truth, drift(1.8));
  expect_named(diagnose_with_holdout(made), "accel_bias_drift");
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
  const Diagnosis d = diagnose_with_holdout(made);
  expect_named(d, "accel_second_order");
  EXPECT_LT(worst_sigmas(d, made.truth), 4.5);
}

// Noise is of a recording: one that is noisier than the fit is judged by its own.
TEST(DiagnosisFaults, NoisierHoldoutIsJudgedByItsOwnNoise) {
  const Made made = make(unit(31), [](RigConfig& c) {
    c.noise.gyro_random_walk_deg_per_rt_h *= 5.0;
    c.noise.accel_random_walk_ug_per_rt_hz *= 5.0;
  });
  const Diagnosis d = diagnose_with_holdout(made);
  EXPECT_EQ(d.verdict, Verdict::clean) << told(d);
  EXPECT_NEAR(d.holdout_after.normalised_rms, 1.0, 0.2);
  EXPECT_NEAR(d.holdout_own_noise, 5.0, 1.5);
}

// Switched on again a MEMS unit is another by hundreds of degrees an hour: one linear step from the fit's biases is none.
TEST(DiagnosisFaults, HoldoutOfAnotherSwitchOnIsCleanHoweverFarItsBiasesAre) {
  for (const double shift_degph : {30.0, 300.0}) {
    RigConfig config = unit(34);
    config.noise.gyro_random_walk_deg_per_rt_h = 0.05;
    for (std::size_t k = 0; k < 3; ++k) config.truth[k] = k == 1 ? -200.0 : 300.0;
    const Made made = make(config, [&](RigConfig& c) {
      for (std::size_t k = 0; k < 3; ++k) *c.truth[k] += k == 2 ? -shift_degph : shift_degph;
    });
    const Diagnosis d = diagnose_with_holdout(made);
    EXPECT_EQ(d.verdict, Verdict::clean) << shift_degph << " " << told(d);
    EXPECT_LT(worst_sigmas(d, made.truth), 4.5);
  }
}

TEST(DiagnosisFaults, CleanUnitsHaveNoLockIn) {
  for (const std::uint64_t seed : {51u, 52u}) {
    RigConfig config = unit(seed);
    config.noise.gyro_random_walk_deg_per_rt_h = 0.004;
    for (const CandidateScore& c : diagnose(record_on_rig(fourteen_steps(), config).recording).candidates)
      EXPECT_TRUE(c.column.entry->name != "gyro_lock_in" || !c.visible || std::abs(c.z) < 4.5)
          << seed << " " << c.column.key();
  }
}

TEST(DiagnosisFaults, WhatIsNotDeterminedIsNotTested) {
  CompressedRecording empty;
  empty.info = clean().recording.info;
  EXPECT_EQ(diagnose(empty).verdict, Verdict::not_tested);
  Sequence one = fourteen_steps();
  one.steps.resize(1);
  const Diagnosis d = diagnose(record_on_rig(one, unit(37)).recording);
  EXPECT_FALSE(d.base.undetermined.empty());
  EXPECT_EQ(d.verdict, Verdict::not_tested) << told(d);
  EXPECT_FALSE(d.trusted());
}

// A latitude so far off that it hides in the noise is in the reason.
TEST(DiagnosisFaults, ALatitudeOfTheOtherHemisphereIsSaid) {
  CompressedRecording recording = clean().recording;
  recording.info.latitude_deg = -recording.info.latitude_deg;
  const Diagnosis d = diagnose(recording, {});
  EXPECT_FALSE(d.trusted()) << told(d);
  EXPECT_SAYS(d.reason, "of a latitude of");
  EXPECT_EQ(d.effect_names, std::vector<std::string>{"earth_rate"}) << told(d);
}

}  // namespace
}  // namespace turncal
