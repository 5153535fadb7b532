// The diagnosis on rig recordings whose effect it is not told, and on the recordings of another simulator. The whole
// acceptance table is a study (scripts/study-undeclared, docs/diagnosis.md); these are the fast cases.
#include "calib/evidence/evidence.h"
#include "calib/statistics/numerics.h"
#include "tests/calib/diagnosed_unit.h"
#include "tests/disturbance.h"

namespace turncal {
namespace {

TEST(Diagnosis, NothingIsFoundWhereNothingIs) {
  const Diagnosis d = diagnose_with_holdout(make(unit(11)));
  EXPECT_EQ(d.verdict, Verdict::clean);
  EXPECT_TRUE(d.trusted() && d.omnibus.passed() && d.effect_names.empty());
  EXPECT_EQ(d.omnibus.tests.size(), 3u);
  EXPECT_LT(d.statements.anything, said_from);
  EXPECT_EQ(d.error_before, d.error_after);
  EXPECT_EQ(d.holdout_source, "second recording");
  // It says what it would have caught: the second-order term near the 5 x 0.9 ug/g^2 of the independent check values.
  const auto k2 = std::ranges::find_if(
      d.candidates, [](const CandidateScore& c) { return c.column.key() == "accel_second_order.x"; });
  ASSERT_NE(k2, d.candidates.end());
  EXPECT_NEAR(k2->detectable, 5.0 * 0.97, 5.0 * 0.97 * 0.25);
}

// 0.06 ms is 20 sigma of the independent check value 0.0034 ms. Left-out dwells do the holdout's work when there is no second recording.
TEST(Diagnosis, DelayIsFoundNamedAddedAndConfirmed) {
  RigConfig config = unit(12);
  config.effects.accel_delay = 0.06;
  const Made made = make(config);
  const Diagnosis of_both = diagnose_with_holdout(made), of_one = diagnose(made.recording);
  EXPECT_EQ(of_both.holdout_source, "second recording");
  EXPECT_EQ(of_one.holdout_source, "cross-validation over dwells");
  for (const Diagnosis& d : {of_both, of_one}) {
    SCOPED_TRACE(d.holdout_source);
    EXPECT_EQ(d.verdict, Verdict::extended);
    ASSERT_EQ(d.effect_names, std::vector<std::string>{"accel_delay"});
    const EstimatedEffect& tau = d.extended.effects.front();
    EXPECT_EQ(tau.column.key(), "accel_delay.tau");
    EXPECT_NEAR(tau.value, 0.06, 3.5 * tau.sigma);
    EXPECT_LT(tau.sigma, 0.006);
    EXPECT_LT(d.holdout_after.chi_square, d.holdout_before.chi_square);
    // What the missing effect did to the 24 parameters is gone.
    EXPECT_LT(worst_sigmas(d, made.truth), 4.5);
  }
}

// At 1 g on the axes, K2 and the scale asymmetry are one class to one recording: either name is right, and the other must be named beside it. A second
// recording has a say, and tells which it is.
TEST(Diagnosis, AliasClassIsNamedAndASecondRecordingTells) {
  RigConfig config = unit(13);
  config.effects.accel_second_order = {0.0, 7.0, 0.0};
  const Made made = make(config);
  const Diagnosis alone = diagnose(made.recording);
  ASSERT_EQ(alone.verdict, Verdict::extended) << alone.reason;
  ASSERT_EQ(alone.effect_names.size(), 1u);
  std::vector<std::string> names = alone.aliases.at(alone.effect_names[0]);
  names.push_back(alone.effect_names[0]);
  EXPECT_NE(std::ranges::find(names, "accel_second_order"), names.end());
  EXPECT_NE(std::ranges::find(names, "accel_scale_asymmetry"), names.end());
  EXPECT_FALSE(alone.separate_by.at(alone.effect_names[0]).empty());
  const Diagnosis both = diagnose_with_holdout(made);
  EXPECT_EQ(both.verdict, Verdict::extended) << both.reason;
  EXPECT_EQ(both.effect_names, std::vector<std::string>{"accel_second_order"});
  EXPECT_TRUE(both.aliases.at("accel_second_order").empty());
}

// A cubic that the fit knows to a tenth is far off at the faster turns of the holdout: so far as its sigma says. Of the units 17 to 26 nine are said
// so; in the first something else seems to be missing beside it.
TEST(Diagnosis, ErrorThatTheSigmasExplainLeavesTheTrust) {
  RigConfig config = unit(19);
  config.effects.gyro_rate_nonlinearity = {400.0, 0.0, 0.0};
  const Made made = make(config);
  // At one rate the square and the cube are one class.
  const Diagnosis d = diagnose_with_holdout(made), alone = diagnose(made.recording);
  EXPECT_TRUE(in_class(alone, "gyro_rate_nonlinearity") && in_class(alone, "gyro_rate_third_order")) << told(alone);
  EXPECT_TRUE(d.verdict == Verdict::extended && d.trusted()) << d.reason;
  EXPECT_GT(d.holdout_after.normalised_rms, GateLimits{}.highest_error);
}

TEST(Diagnosis, BiasStepGetsNoName) {
  RigConfig config = unit(14);
  config.outside.gyro_bias_step = {2, 2900.0, 0.06};
  const Diagnosis d = diagnose_with_holdout(make(config));
  EXPECT_EQ(d.verdict, Verdict::unexplained);
  EXPECT_TRUE(d.effect_names.empty());
  EXPECT_SAYS(d.unexplained_pattern, "the bias of gyro z changes with time");
}

// The bias of one accelerometer jumps between two values; a bias instability of all three explains that, too.
TEST(Diagnosis, OneUnstableSensorAmongStableOnesIsNoNoise) {
  Made made = make(unit(14));
  constexpr std::array jumps_s = {700.0, 1130.0, 1900.0, 2310.0, 3170.0, 3900.0, 4450.0, 5330.0};
  disturb(made.recording, made.truth, on_accel(1, [=](const DisturbedMoment& m) {
            return (std::ranges::upper_bound(jumps_s, m.time_s) - jumps_s.begin()) % 2 == 0 ? 0.0 : 10.0 * ug;
          }));
  const Diagnosis d = diagnose(made.recording);
  EXPECT_GT(d.base.noise.accel_bias_instability_mps2, 3.0 * ug);
  EXPECT_EQ(d.verdict, Verdict::unexplained);
  EXPECT_SAYS(d.unexplained_pattern, "the bias of accelerometer y changes with time");
}

TEST(Diagnosis, NoiseGivenThreeTimesTooSmallIsANoiseModelVerdict) {
  RigConfig config = unit(15);
  config.noise.gyro_random_walk_deg_per_rt_h *= 3.0;
  config.noise.accel_random_walk_ug_per_rt_hz *= 3.0;
  DiagnosisOptions options;
  NoiseModel given;
  given.angle_random_walk.setConstant(0.002 * radprs_per_degprh);
  given.velocity_random_walk.setConstant(8.0 * mpsprs_per_ugprHz);
  given.accel_pulse_mps = config.accel_pulse_mps;
  options.estimate.noise = given;
  const Diagnosis d = diagnose_with_holdout(make(config), options);
  EXPECT_EQ(d.verdict, Verdict::noise_model);
  EXPECT_TRUE(d.effect_names.empty());
}

TEST(Diagnosis, AParameterThatHangsOnANameIsSaid) {
  AveragedEstimate estimate;
  estimate.far_off = Eigen::Vector3d(0.03, 0.06, 0.02);
  EXPECT_EQ(hangs_on_a_name(estimate, {0, 3, 4}), "A01 is off by more than 4.5 sigma with a probability of 0.06");
  estimate.far_off[1] = 0.04;
  EXPECT_EQ(hangs_on_a_name(estimate, {0, 3, 4}), "");
}

// Pulses of 20 mm/s beat for seconds in nearly every dwell: what that makes of the innovations says nothing of the unit.
TEST(Diagnosis, PulsesThatBeatAreNoMisfitOfTheNoise) {
  for (const std::uint64_t seed : {21u, 24u}) {
    RigConfig config = unit(seed);
    config.accel_pulse_mps = 0.02;
    config.noise.accel_random_walk_ug_per_rt_hz = 50.0;
    config.noise.gyro_random_walk_deg_per_rt_h = 0.05;
    const Diagnosis d = diagnose_with_holdout(make(config));
    EXPECT_EQ(d.verdict, Verdict::clean) << seed << ": " << d.reason;
    EXPECT_GT(d.omnibus.beating_part, 0.5) << seed;
  }
}

// Every limit that docs/diagnosis.md names in its table is the one in force, and none of those below is missing there.
TEST(LimitsOfTheDocument, AreThoseOfTheProgram) {
  const DiagnosisOptions options;
  constexpr LackOfFitLimits fit;
  constexpr SelectionLimits selection;
  constexpr GateLimits gate;
  const NoiseLimits& noise = noise_limits;
  const std::map<std::string, double> in_force = {
      {"score_false_alarm", score_false_alarm},       {"fit.family_wise", fit.family_wise},
      {"fit.near_lags_s", fit.near_lags_s},           {"fit.lags_s", fit.lags_s},
      {"selection.bic_margin", selection.bic_margin}, {"selection.alias_correlation", selection.alias_correlation},
      {"gate.contradiction", gate.contradiction},     {"gate.highest_error", gate.highest_error},
      {"noise.correlation", noise.correlation},       {"noise.lowest_level", noise.lowest_level},
      {"noise.highest_level", noise.highest_level},   {"noise.highest_of_pulses", noise.highest_of_pulses}};
  std::ifstream document(std::string(TURNCAL_SOURCE_DIR) + "/docs/diagnosis.md");
  std::map<std::string, double> printed;
  for (std::string line; std::getline(document, line);)
    if (const auto end = line.find("` | "); line.starts_with("| `") && end != std::string::npos)
      printed[line.substr(3, end - 3)] = std::stod(line.substr(end + 4));
  EXPECT_EQ(printed, in_force);
}

TEST(Diagnosis, OfRecordingsOfAnotherSimulator) {
  const std::filesystem::path shared = TURNCAL_SOURCE_DIR "/../shared/data/recordings";
  if (!std::filesystem::exists(shared)) GTEST_SKIP() << "no shared recordings beside the project";
  const struct {
    const char* folder;
    Verdict verdict;
    std::vector<std::string> names;  // each found, or in the class of one found
  } cases[] = {{"clean", Verdict::clean, {}},
               {"undeclared-1", Verdict::extended, {"accel_delay"}},
               {"undeclared-2", Verdict::extended, {"accel_second_order", "accel_bias_temperature"}}};
  for (const auto& [folder, verdict, names] : cases) {
    SCOPED_TRACE(folder);
    const Diagnosis d =
        diagnose_with_holdout({compress_folder(shared / folder), compress_folder(shared / folder / "holdout"), {}});
    EXPECT_EQ(d.verdict, verdict) << d.reason;
    EXPECT_EQ(d.effect_names.size(), names.size());
    for (const std::string& name : names) EXPECT_TRUE(in_class(d, name)) << name;
    EXPECT_TRUE(names.empty() || d.holdout_after.normalised_rms < d.holdout_before.normalised_rms);
  }
}

// What no branch carries is a reason, too: calibrate and diagnose distrust by the same text.
TEST(Statements, HaveAReasonWhereNoBranchIsSaid) {
  EXPECT_EQ(reason_of(Statements{true, 0.99, {}}), "something is missing with a probability of 0.99");
}

// The filter carries a column for each effect through every block; the evidence puts them together from pieces of rest and turns. A shape that is off
// by a thousandth of a scale factor's error moves the odds of two that are nearly alike by many sigma.
TEST(Statements, SayABranchOfTwoFormulasOnce) {
  const std::string gyro = "gyro y", scale = "scale factor";
  const Statements s = {true,
                        1.0,
                        {{gyro, scale, "rate", "", 0.99},
                         {gyro, scale, "rate", "gyro_rate_nonlinearity", 0.98},
                         {gyro, scale, "rate", "gyro_lock_in", 0.97}}};
  EXPECT_EQ(words_of(s),
            "the scale factor of gyro y depends on the rate of rotation (0.98), by gyro_rate_nonlinearity (0.98) "
            "and gyro_lock_in (0.97)");
}

// Beside a curve without a formula, what else a model holds of that sensor may be a part of the curve; of another sensor it is not.
TEST(Statements, DoubtFurtherTermsOfASensorBesideACurve) {
  TermTable table;
  const auto add = [&](TermKind kind, const Statement& what) {
    table.terms.emplace_back();
    table.terms.back().kind = kind;
    table.terms.back().what = what;
  };
  add(TermKind::pattern, {"gyro y", "scale factor", "turns", ""});
  add(TermKind::effect, {"gyro y", "scale factor", "rate", "gyro_lock_in"});
  add(TermKind::effect, {"gyro y", "scale factor", "time", "gyro_scale_drift"});
  add(TermKind::effect, {"gyro x", "bias", "time", "gyro_warm_up"});
  const std::vector<UnderNoise> under = {{.table = std::make_shared<TermTable>(table), .blocks = {}}};
  const auto term = [](int number, double explained) { return ModelTerm{.term = number, .explained = explained}; };
  const auto probability = [&](const std::vector<ModelTerm>& terms, const std::string& formula) {
    const Statements all = statements_of(under, {{{terms, 0, 1.0}}});
    const auto node = std::ranges::find(all.nodes, formula, &Statement::formula);
    return node == all.nodes.end() ? 0.0 : node->probability;
  };
  EXPECT_EQ(probability({term(0, 90.0), term(1, 20.0), term(3, 9.0)}, "gyro_lock_in"), 0.4);
  EXPECT_EQ(probability({term(0, 90.0), term(1, 20.0), term(3, 9.0)}, "gyro_warm_up"), 1.0);
  EXPECT_EQ(probability({term(0, 20.0), term(1, 90.0)}, "gyro_lock_in"), 1.0);
  EXPECT_EQ(probability({term(1, 90.0), term(2, 20.0)}, "gyro_scale_drift"), 1.0);
}

TEST(Evidence, SaysOfWhatActsInTurnsWhatTheFilterSays) {
  RigConfig config = unit(14);
  config.effects.gyro_rate_nonlinearity = {3000.0, 0.0, 0.0};
  const CompressedRecording recording = record_on_rig(fourteen_steps(), config).recording;
  JointOptions options;
  options.fit_bias_instability = false;
  for (const EffectColumn& column : catalogue_columns(recording.info))
    if (!(column.tau_s > 0.0))
      options.candidates.push_back(column);  // what fades in a rest is taken as constant over its pieces
  const JointResult fit = joint_estimate(recording, options);
  const Evidence evidence = weigh_evidence(recording, fit);
  const UnderNoise& under = evidence.at_each_noise.front();
  const TermTable& table = *under.table;
  const Eigen::MatrixXd covariance = balanced_inverse(fit.last.information(fit.free, fit.free));
  const Eigen::VectorXd step = covariance * fit.last.gradient(fit.free);
  double largest = 0.0;
  for (std::size_t c = 0; c < options.candidates.size(); ++c) {
    const std::string key = options.candidates[c].key();
    SCOPED_TRACE(key);
    const auto k = std::size_t(std::ranges::find(table.effects, key, &EffectColumn::key) - table.effects.begin());
    ASSERT_LT(k, table.effects.size());
    if (!is_seen(under, k)) continue;
    const Eigen::Index at = parameter_count + Eigen::Index(c);
    const Eigen::VectorXd with = fit.last.information.col(at)(fit.free);
    const double sigma = 1.0 / std::sqrt(fit.last.information(at, at) - with.dot(covariance * with));
    const double z = sigma * (with.dot(step) - fit.last.gradient[at]);
    const PieceSystem::Block& block = under.blocks[table.basis_of_effect[k]];
    const int own = table.column_of_effect[k];
    EXPECT_NEAR(1.0 / std::sqrt(block.Q(own, own)), sigma, 0.01 * sigma);
    EXPECT_NEAR(block.s[own] / std::sqrt(block.Q(own, own)), z, 0.25 + 0.01 * std::abs(z));  // rests are coarser
    largest = std::max(largest, std::abs(z));
  }
  EXPECT_GT(largest, 10.0);
}

}  // namespace
}  // namespace turncal
