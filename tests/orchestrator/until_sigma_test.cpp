// A run that ends when it knows enough: when, with what, and the same after every kill.
#include "orchestrator/station/verdict.h"

#include "calib/evidence/diagnosis.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/design/sequence_design.h"
#include "orchestrator/jobs/enough_watch.h"
#include "tests/orchestrator/program.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

ParameterFile file_with(std::size_t parameter, double value, double sigma) {
  ParameterFile file;
  file.parameters(Eigen::Index(parameter)) = value;
  file.sigma[parameter] = sigma;
  return file;
}

TEST(NeededSigma, IsTheLeastOfWhatIsAskedAndOfWhereTheGuardBandEnds) {
  VerdictLimits limits;
  StopSigmas stop{};
  EXPECT_FALSE(says_when(stop, limits));
  EXPECT_TRUE(needed_sigmas(file_with(0, 0.5, 0.1), stop, limits).empty());
  limits.parameter[0] = {-1.0, 1.0};
  EXPECT_TRUE(says_when(stop, limits));
  const auto needed = [&](double value) { return needed_sigmas(file_with(0, value, 0.1), stop, limits).at(0).needed; };
  EXPECT_DOUBLE_EQ(needed(0.5), 0.25) << "U = 2 sigma is as wide as the margin";
  EXPECT_DOUBLE_EQ(needed(-0.8), 0.1);
  EXPECT_EQ(judge_value(-0.8, 0.0999, limits.parameter[0], 1.0), UnitVerdict::pass);
  EXPECT_EQ(judge_value(-0.8, 0.1001, limits.parameter[0], 1.0), UnitVerdict::conditional_pass);
  limits.sigma_max[0] = 0.2;
  EXPECT_DOUBLE_EQ(needed(0.5), 0.2);
  stop[0] = 0.05;
  EXPECT_DOUBLE_EQ(needed(0.5), 0.05);
  EXPECT_TRUE(std::isinf(needed_sigmas(file_with(0, 1.5, 0.1), stop, limits).at(0).ratio())) << "no sigma is enough";
  limits.guard_factor = 0.0;
  stop[0].reset();
  limits.sigma_max[0].reset();
  EXPECT_TRUE(needed_sigmas(file_with(0, 0.999, 0.1), stop, limits).empty());
}

TEST(TakesOfLast, AreThoseOfThePoseAlsoAcrossAnInterruption) {
  const auto segment = [](SegmentKind kind, double heading_deg) {
    Segment one;
    one.kind = kind;
    one.heading_deg = heading_deg;
    return one;
  };
  Segments segments;
  EXPECT_EQ(takes_of_last(segments, 1).size(), 0u);
  segments = {segment(SegmentKind::align, 0.0), segment(SegmentKind::rotate, 90.0)};
  EXPECT_EQ(takes_of_last(segments, 1).size(), 0u) << "it has not been made at all";
  segments.push_back(segment(SegmentKind::still, 90.0));
  EXPECT_EQ(takes_of_last(segments, 1).size(), 1u);
  segments.push_back(segment(SegmentKind::rotate, 90.0));  // settled again after an interruption
  segments.push_back(segment(SegmentKind::still, 90.0));
  EXPECT_EQ(takes_of_last(segments, 1).size(), 2u);
  EXPECT_EQ(takes_of_last(segments, 2).size(), 1u) << "the plan has two dwells there";
  segments[2].kind = SegmentKind::rotate;  // set aside
  EXPECT_EQ(takes_of_last(segments, 1).size(), 1u);
}

const std::string until_sigma_station =
    station_head +
    "motion.settle_s = 0.5\nrecord.database = results.db\nrecord.store = store\nstop.sigma.n11 = 3e-6\n"
    "stop.sigma.n22 = 3e-6\n";

class UntilSigma : public Program {
 protected:
  static Arguments begin(const std::string& out, const std::string& station) {
    return dry_run(out, {"--station", station, "--until-sigma"});
  }
  // Of the records of the journal, those of one type.
  std::vector<std::string> records(const std::string& folder, const std::string& type) const {
    std::vector<std::string> found;
    for (const std::string& line : lines_of(run({"journal", folder}).out))
      if (line.find(" " + type + " ") != std::string::npos) found.push_back(line);
    return found;
  }
};

TEST_F(UntilSigma, EndsAfterTheDwellAtWhichAllIsKnownAndNoSooner) {
  std::string asked = until_sigma_station;  // reached some dwells after there is enough to test the fit by
  asked.replace(asked.find("3e-6"), 4, "4.2e-7");
  const ProgramResult early = ends(begin("early", write("mock.station", asked)), 0);
  EXPECT_SAYS(early.out, "enough is known; 0:");
  EXPECT_SAYS(early.out, "after item 1 of 106: not yet enough: the table has not turned yet");
  const std::vector<std::string> estimates = records("early", "estimate");
  const std::vector<std::string> dwells = records("early", "dwell");
  ASSERT_EQ(estimates.size(), dwells.size()) << "after each of them";
  for (std::size_t i = 0; i < estimates.size(); ++i)
    EXPECT_EQ(estimates[i].find("enough = true") != std::string::npos, i + 1 == estimates.size()) << estimates[i];
  EXPECT_LT(dwells.size(), 40u) << "of 51 that the sequence has";

  // What it stopped with is what comes of the recording, by the same numbers.
  ASSERT_EQ(run({"calibrate", "early/recording.tcr", "--out", "again"}).code, 0);
  const Result<ParameterFile> file = good(read_parameter_file(path("early/parameters.conf")));
  const Result<ParameterFile> again = good(read_parameter_file(path("again/parameters.conf")));
  EXPECT_EQ(file->parameters, again->parameters);
  EXPECT_EQ(file->sigma, again->sigma);
  EXPECT_LE(*file->sigma[6], 4.2e-7) << "n11";
  EXPECT_LE(*file->sigma[10], 3e-6) << "n22";
  ASSERT_NE(find_further(*file, "record.ended_after_s"), nullptr);
}

// A gyro that drifts in one dwell, the 18th, and only then.
TEST_F(UntilSigma, SetsADwellThatDisagreesAsideWhenItsRepeatAgreesAlsoAfterAKill) {
  std::string rig = "seed = 5\n";
  for (int k = 0; k < 190; ++k) {
    const std::string fault = "fault." + std::to_string(k + 1) + ".";
    rig += fault + "kind = gyro_glitch\n" + fault + "axis = x\n" + fault + "size_mrad = 0.002\n" + fault +
           "sample = " + std::to_string(50700 + 5 * k) + "\n";
  }
  std::string asked = until_sigma_station + "rig.file = drift.rig\n";
  asked.replace(asked.find("3e-6"), 4, "4.5e-7");
  write("drift.rig", rig);
  const std::string station = write("mock.station", asked);
  // Killed where it was decided, and where the dwell was made: the same bytes.
  const ProgramResult drifted = expect_same_after_kills(begin("drifted", station), "drifted", {0.38, 0.40, 0.42});
  EXPECT_SAYS(drifted.out,
              "after item 41 of 106: this dwell, or the turn before it, disagrees with the others: it is repeated");
  std::vector<std::string> again;
  for (const std::string& estimate : records("drifted", "estimate"))
    if (estimate.find("again = true") != std::string::npos) again.push_back(estimate);
  ASSERT_EQ(again.size(), 1u) << "the second take agrees";
  const Result<LoadedRecording> recorded = good(load_recording(path("drifted/recording.tcr")));
  EXPECT_EQ(
      std::ranges::count_if(recorded->data.segments, [](const Segment& s) { return s.kind != SegmentKind::rotate; }) +
          1,
      std::ssize(records("drifted", "dwell")));
  EXPECT_SAYS(
      drifted.out,
      "after item 41 of 106: repeated, this dwell agrees; the one that does not is left out; not yet enough: n11, 4.");
  EXPECT_SAYS(file_text(folder_ / "drifted/parameters.conf"), "rest that disagreed with all the others");
  EXPECT_SAYS(drifted.out, "enough is known") << "its noise is that of a clean run";
  // In text the same recording: which rest it was goes with the samples.
  ASSERT_EQ(run({"export", "drifted/recording.tcr", "--out", "text"}).code, 0);
  const Result<LoadedRecording> as_text = good(load_recording(path("text")));
  EXPECT_EQ(as_text->hash, recorded->hash);
  EXPECT_SAYS(again.front(), "enough = false");
}

TEST_F(UntilSigma, EndsTheSameAfterAKillAtAnyTime) {
  const std::string station = write("killed/s.station", until_sigma_station);
  const std::vector<double> calls = {40, 0.4, 0.7, -40, -32, -24, -16, -8, -0.1};
  expect_same_after_kills(begin("killed/o", station), "killed/o", calls);
}

// Legs that are added to tell apart what the diagnosis cannot.
TEST(Doubt, IsAClassOfNamesOrABranchThatIsSaidWithoutOne) {
  Diagnosis d;
  d.verdict = Verdict::extended;
  d.effect_names = {"gyro_warm_up", "accel_third_order"};
  d.aliases = {{"gyro_warm_up", {}}, {"accel_third_order", {"accel_odd_quadratic"}}};
  ASSERT_TRUE(doubt_of(d));
  EXPECT_EQ(words_of(*doubt_of(d)), "accel_third_order or accel_odd_quadratic");
  d.aliases["accel_third_order"].clear();
  EXPECT_FALSE(doubt_of(d));
  d.verdict = Verdict::unexplained;
  d.statements.nodes = {{"accelerometer y", "bias", "force", "", 0.99},
                        {"accelerometer y", "bias", "force", "accel_scale_asymmetry", 0.4},
                        {"accelerometer y", "bias", "force", "accel_second_order", 0.6},
                        {"gyro x", "bias", "time", "gyro_bias_drift", 0.3}};
  ASSERT_TRUE(doubt_of(d));
  EXPECT_EQ(words_of(*doubt_of(d)), "accel_second_order or accel_scale_asymmetry");
  d.statements.nodes.front().probability = 0.9;  // not said
  EXPECT_FALSE(doubt_of(d));
  d.statements.nodes.front().probability = 0.99;
  d.verdict = Verdict::noise_model;
  EXPECT_FALSE(doubt_of(d));
}

// 2 ln L scatters by twice its root about what is expected.
TEST(ChanceToTell, IsThatOfAGainAbove10) {
  EXPECT_NEAR(chance_to_tell(10.0), 0.5, 1e-12);
  EXPECT_NEAR(chance_to_tell(4.65), 0.1074, 1e-3);  // (10 - 4.65) / (2 sqrt(4.65)) = 1.2405 sigma
  EXPECT_NEAR(chance_to_tell(30.0), 0.966, 1e-3);
  EXPECT_LT(chance_to_tell(0.0), 1e-12);
}

class Settle : public Program {};

TEST_F(Settle, AddsTheLegsOnceSaysWhatIsKnownAndIsTheSameAfterAKill) {
  // While the legs are walked, and when everything is recorded.
  write("doubt.rig", "seed = 4\nnoise.seed = 104\neffect.accel_third_order.y = -90\n");
  const Arguments begin = "run --dry-run --unit SN1 --out whole --rig doubt.rig --settle 5min";
  const ProgramResult whole = expect_same_after_kills(begin, "whole", {-64, -4}, 20, 32);
  EXPECT_SAYS(whole.out, "in doubt: ");
  EXPECT_SAYS(whole.out, "In doubt was ");
  EXPECT_SAYS(whole.out, " of legs were added; it is ");
  EXPECT_SAYS(file_text(folder_ / "whole/parameters.conf"), "record.settle.1 = ");
  EXPECT_EQ(std::ranges::count_if(lines_of(run({"journal", "whole"}).out),
                                  [](const std::string& line) { return line.find(" settle ") != std::string::npos; }),
            1);
}

TEST(FindSettling, LegsBringASigmaThatIsNotYetEnough) {
  Sequence sequence = must_read_sequence("forty_minutes.seq");
  const PlanLimits limits = plan_limits(default_station_config(), default_rig_config().sample_period_s);
  const CompressedRecording first = record_on_rig(sequence, default_rig_config()).recording;
  const JointResult base = joint_estimate(first);
  const NeededSigma n22{10, base.sigma[10], 0.93 * base.sigma[10]};
  const auto found = find_settling({first, base, sequence, make_plan(sequence, limits), limits, 600.0, {n22}});
  ASSERT_TRUE(found);
  append_steps(must(parse_sequence(found->sequence, "settling")), sequence);
  EXPECT_LE(joint_estimate(record_on_rig(sequence, default_rig_config()).recording).sigma[10], n22.needed);
}

}  // namespace
}  // namespace turncal
