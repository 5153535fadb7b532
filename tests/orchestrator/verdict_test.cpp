// Verdicts by guard bands, control charts, and what of them reaches parameter file, database, store and exit code.
#include "orchestrator/station/verdict.h"

#include "orchestrator/jobs/run.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/watch/progress.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/queue_outcomes.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

TEST(Verdict, GuardBandsOfOneValue) {
  const Limit limit{-1.0, 1.0};
  // sigma 0.1, U = 0.2, w = 0.2.
  const auto judged = [&](double value) { return judge_value(value, 0.1, limit, 1.0); };
  EXPECT_EQ(judged(0.0), UnitVerdict::pass);
  EXPECT_EQ(judged(0.79), UnitVerdict::pass);
  EXPECT_EQ(judged(-0.79), UnitVerdict::pass);
  EXPECT_EQ(judged(0.81), UnitVerdict::conditional_pass);
  EXPECT_EQ(judged(1.0), UnitVerdict::conditional_pass);
  EXPECT_EQ(judged(1.01), UnitVerdict::conditional_fail);
  EXPECT_EQ(judged(-1.19), UnitVerdict::conditional_fail);
  EXPECT_EQ(judged(1.21), UnitVerdict::fail);
  // No guard band: simple acceptance. Half of it: half the band.
  EXPECT_EQ(judge_value(0.99, 0.1, limit, 0.0), UnitVerdict::pass);
  EXPECT_EQ(judge_value(1.01, 0.1, limit, 0.0), UnitVerdict::fail);
  EXPECT_EQ(judge_value(0.89, 0.1, limit, 0.5), UnitVerdict::pass);
  // One-sided limits, no uncertainty, and what is no number.
  EXPECT_EQ(judge_value(-100.0, 0.1, {std::nullopt, 1.0}, 1.0), UnitVerdict::pass);
  EXPECT_EQ(judge_value(0.0, std::nullopt, limit, 1.0), UnitVerdict::conditional_pass);
  EXPECT_EQ(judge_value(1.1, std::nullopt, limit, 1.0), UnitVerdict::fail);
  for (const Limit& any : {limit, Limit{std::nullopt, 1.0}, Limit{-1.0, std::nullopt}}) {
    EXPECT_EQ(judge_value(std::nan(""), 0.1, any, 1.0), UnitVerdict::fail);
    EXPECT_EQ(judge_value(0.0, std::nan(""), any, 1.0), UnitVerdict::fail);
  }
  EXPECT_EQ(judge_value(-std::numeric_limits<double>::infinity(), 0.1, {std::nullopt, 1.0}, 1.0), UnitVerdict::fail);
}

// On page and terminal: a pass that is only one by less than its uncertainty is not shown as one that is.
TEST(Tone, AConditionalPassIsAmber) {
  EXPECT_EQ(tone_of(UnitVerdict::pass), Tone::good);
  EXPECT_EQ(tone_of(UnitVerdict::conditional_pass), Tone::attention);
  for (const UnitVerdict bad : {UnitVerdict::conditional_fail, UnitVerdict::fail, UnitVerdict::hold})
    EXPECT_EQ(tone_of(bad), Tone::bad) << to_string(bad);
  std::ostringstream file;
  EXPECT_EQ(in_tone(file, Tone::attention, "conditional_pass"), "conditional_pass") << "no colours in a file";
}

TEST(Verdict, TheWorstValueDecides) {
  ParameterFile file;
  file.sigma[0] = 0.1;
  file.parameters[0] = 0.9;  // N01
  file.add_further("quality.normalised_rms", 1.02);
  VerdictLimits limits;
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::not_judged);
  limits.parameter[0] = {-2.0, 2.0};
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::pass);
  limits.parameter[0] = {-1.0, 1.0};
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::conditional_pass);
  limits.sigma_max[0] = 0.2;
  limits.residual_max = 1.1;
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::conditional_pass);
  limits.temperature_c = {10.0, 30.0};
  EXPECT_EQ(judge(file, {15.0, 29.0}, limits).verdict, UnitVerdict::conditional_pass);
  EXPECT_EQ(judge(file, {15.0, 31.0}, limits).verdict, UnitVerdict::fail);
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::fail) << "a limit on a temperature that is not measured";
  limits.temperature_c = {};
  limits.sigma_max[0] = 0.05;
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::fail);
  limits.sigma_max[0] = std::nullopt;
  limits.residual_max = 1.0;
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::fail);
}

// Montgomery, Introduction to Statistical Quality Control, individuals chart: sigma from the moving range.
TEST(ControlChart, LimitsFromTheMovingRange) {
  std::vector<double> values = {10.0, 12.0, 11.0, 13.0};  // moving ranges 2, 1, 2
  const ControlChart chart = control_chart(values, {5.0, 15.0});
  EXPECT_DOUBLE_EQ(chart.mean, 11.5);
  EXPECT_DOUBLE_EQ(*chart.sigma, 5.0 / 3.0 / 1.128);
  EXPECT_DOUBLE_EQ(*chart.upper, 11.5 + 3.0 * 5.0 / 3.0 / 1.128);
  EXPECT_TRUE(chart.outside.empty());
  EXPECT_FALSE(chart.cpk) << "of fewer than five";
  values.push_back(12.0);  // mean 11.6, moving ranges 2, 1, 2, 1
  EXPECT_DOUBLE_EQ(control_chart(values, {5.0, 15.0}).cpk->value, 3.4 / (3.0 * 1.5 / 1.128));
  std::vector<double> jump(20, 1.0);
  for (std::size_t i = 0; i < jump.size(); i += 2) jump[i] = 1.01;
  jump.push_back(2.0);
  EXPECT_EQ(control_chart(jump, {}).outside, std::vector<std::size_t>{20});
  EXPECT_FALSE(control_chart(jump, {}).cpk);
  EXPECT_FALSE(control_chart(std::vector<double>{1.0}, {0.0, 2.0}).sigma);
  EXPECT_FALSE(control_chart(std::vector<double>{1.0, 1.0}, {0.0, 2.0}).cpk) << "no spread: no index";
  EXPECT_EQ(control_chart({}, {}).count, 0u);
}

// imu.clock_max_ppm = 200, the guard band 2 sigma; the file says what was judged.
TEST(Verdict, TheClockIsJudgedWithTheValues) {
  ParameterFile file;
  file.add_further("quality.normalised_rms", "1");
  VerdictLimits limits;
  const auto judged = [&](double ppm, double sigma_ppm) {
    return judge(file, {}, limits, ClockLimit{{ppm, sigma_ppm}, 200.0});
  };
  EXPECT_EQ(judged(500.0, 1.0).verdict, UnitVerdict::not_judged) << "nothing is judged without limits";
  limits.residual_max = 2.0;
  EXPECT_EQ(judge(file, {}, limits).verdict, UnitVerdict::pass);
  EXPECT_EQ(judged(-150.0, 2.0).verdict, UnitVerdict::pass);
  EXPECT_EQ(judged(199.0, 2.0).verdict, UnitVerdict::conditional_pass);
  EXPECT_EQ(judged(-201.0, 2.0).verdict, UnitVerdict::conditional_fail);
  const VerdictReport far = judged(-300.0, 2.0);
  EXPECT_EQ(far.verdict, UnitVerdict::fail);
  EXPECT_SAYS(far.reason, "clock of the unit -300.0 ppm, limits -200 .. 200");
  add_verdict(judged(-150.0, 2.0), file);
  EXPECT_NE(std::ranges::find(file.further, std::pair<std::string, std::string>(
                                                "verdict.clock_ppm", "pass, limits -200 .. 200, guard band 4")),
            file.further.end());
}

// One outcome a unit: what the diagnosis finds enters verdict, journal, database, store, queue, hook and exit code.
VerdictReport judged(UnitVerdict by_limits, const std::string& diagnosis, const DiagnosisPolicy& policy = {},
                     const std::string& distrust = "") {
  VerdictReport report;
  report.verdict = by_limits;
  judge_diagnosis(diagnosis, "what was found", distrust, policy, report);
  return report;
}

TEST(Outcome, ADiagnosisHoldsAUnitBackAndNeverMakesItBetter) {
  EXPECT_EQ(judged(UnitVerdict::not_judged, "clean").verdict, UnitVerdict::not_judged);
  const DiagnosisPolicy passes = {UnitVerdict::pass, true};
  for (const char* word : {"clean", "extended", "not_made"}) {
    EXPECT_EQ(judged(UnitVerdict::pass, word, passes).verdict, UnitVerdict::pass) << word;
    EXPECT_EQ(judged(UnitVerdict::pass, word, passes, "a33 may be off").verdict, UnitVerdict::hold) << word;
  }
  for (const char* word : {"extended", "unexplained", "noise_model", "not_tested", "failed"}) {
    const VerdictReport report = judged(UnitVerdict::pass, word);
    EXPECT_EQ(report.verdict, UnitVerdict::hold) << word;
    EXPECT_EQ(report.reason, "diagnosis " + in_words(word) + ": what was found");
    EXPECT_EQ(judged(UnitVerdict::fail, word).verdict, UnitVerdict::fail) << word;
  }
  EXPECT_EQ(judged(UnitVerdict::pass, "extended", {UnitVerdict::fail, true}).verdict, UnitVerdict::fail);
  EXPECT_EQ(judged(UnitVerdict::pass, "unexplained", passes).verdict, UnitVerdict::hold)
      << "what nothing explains is never passed on";
  EXPECT_FALSE(is_accepted(UnitVerdict::hold));
}

}  // namespace
}  // namespace turncal
