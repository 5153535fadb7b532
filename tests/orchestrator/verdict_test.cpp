// Verdicts by guard bands, control charts, and what of them reaches parameter file, database, store and exit code.
#include "orchestrator/station/verdict.h"

#include "orchestrator/jobs/run.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/parameter_store.h"
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

class Production : public Program {
 protected:
  ProgramResult dry_run(const std::string& out, const std::string& station, const Arguments& more = {}) {
    const std::string text =
        station_head + "motion.settle_s = 0.5\nrecord.database = results.db\nrecord.store = store\n";
    return run(Program::dry_run(out, {"--station", write("mock.station", text + station)}) + more);
  }
};

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

TEST_F(Production, VerdictIsExitCodeAndRecord) {
  const ProgramResult good =
      dry_run("good", "limit.residual_max = 1.5\nlimit.N01.min = -1\nlimit.N01.max = 1\n",
              {"--operator", "A. Turner", "--part", "RLG-7", "--revision", "C", "--ambient", "21.5 C"});
  ASSERT_EQ(good.code, 0) << good.err;
  EXPECT_SAYS(good.out, "verdict     pass  (ILAC-G8:09/2019");
  const std::string file = file_text(folder_ / "good/parameters.conf");
  for (const char* line :
       {"verdict.result = pass", "verdict.rule = ILAC-G8:09/2019", "verdict.N01 = pass, limits -1 .. 1",
        "verdict.residual = pass", "record.operator = A. Turner", "record.part = RLG-7", "record.revision = C",
        "record.ambient = 21.5 C",
        "record.configuration_hash = ", "record.sequence_hash = ", "record.repeated_dwells = 0", "simulated = true"}) {
    EXPECT_SAYS(file, line);
  }
  const ProgramResult bad = dry_run("bad", "limit.sigma.max = 1\n");
  EXPECT_EQ(bad.code, 1) << "a misspelt limit must not pass for one";
  const ProgramResult fail = dry_run("fail", "limit.residual_max = 0.5\nlimit.N01.max = -100\n");
  EXPECT_EQ(fail.code, 20) << fail.out;
  EXPECT_EQ(fail.err_lines(), 1);
  EXPECT_SAYS(fail.err, "unit SN1: fail: gyro x bias (N01) ");
  EXPECT_SAYS(fail.err, "(and 1 more)");
  // It is on record, and its parameters are not in use.
  EXPECT_SAYS(file_text(folder_ / "fail/parameters.conf"), "verdict.result = fail");
  EXPECT_EQ(run({"resume", "fail"}).code, 20);
  EXPECT_EQ(file_text(folder_ / "store/simulated/SN1/parameters.conf"), file);
}

TEST_F(Production, AnOverdueTableIsRefusedUnlessOverridden) {
  const std::string due = "table.id = TT-1\ntable.calibration_due = 2025-12-31\n";  // the rig's day is 2026-01-01
  const ProgramResult refused = dry_run("out", due);
  EXPECT_EQ(refused.code, 1);
  EXPECT_SAYS(refused.err, "table 'TT-1' was due on 2025-12-31, today is 2026-01-01");
  EXPECT_FALSE(fs::exists(folder_ / "out"));
  ASSERT_EQ(dry_run("out", due, {"--override-due", "recalibration is booked for Monday"}).code, 0);
  const std::string file = file_text(folder_ / "out/parameters.conf");
  EXPECT_SAYS(file, "record.overdue_reason = recalibration is booked for Monday");
  EXPECT_SAYS(file, "record.table_calibration_due = 2025-12-31");
  ASSERT_EQ(dry_run("today", "table.calibration_due = 2026-01-01\n").code, 0) << "the last good day";
  // It runs out at midnight, in the middle of a run that is stopped then: begun in time, it needs a reason to go on.
  const std::string midnight = "fault.1.kind = emergency_stop\nfault.1.time_s = 400\n";
  const std::string rig = write("late.rig", "start_utc_s = 1767311700\n" + midnight);  // 2026-01-01T23:55
  ASSERT_EQ(dry_run("late", "table.calibration_due = 2026-01-01\n", {"--rig", rig}).code, 50);
  expect_refused({"resume", "late"}, "was due on 2026-01-01, today is 2026-01-02");
  EXPECT_EQ(run({"resume", "late", "--override-due", "half a run is no use"}).code, 0) << "the fault is repaired";
  const std::string journal = run({"journal", "late"}).out;
  EXPECT_SAYS(journal, "overdue_reason = half a run is no use");
  EXPECT_EQ(journal.find("[dry run] "), 0u);
  EXPECT_EQ(std::ranges::count(journal, '\n'), std::ranges::count(journal, '[')) << journal;
  EXPECT_EQ(run({"resume", "late"}).code, 0) << "it is complete";
  EXPECT_EQ(dry_run("bad", "table.calibration_due = 31.12.2026\n").code, 1);
}

// What it prints is in tests/golden: history, control, compare and the files.
TEST_F(Production, HistoryIsOfTheUnitsThatAreAskedFor) {
  ASSERT_EQ(dry_run("one", "limit.N01.min = -1\nlimit.N01.max = 1\nlimit.N01.sigma_max = 0.5\n").code, 0);
  ASSERT_EQ(
      run(Program::dry_run("two", {"--station", "mock.station", "--rig", write("two.rig", "seed = 3\n")}, "SN2")).code,
      0);
  EXPECT_SAYS_NOT(run("history results.db --unit SN1").out, "SN2");
  EXPECT_EQ(run("history results.db --compare 1 2").code, 1) << "two units";
  EXPECT_EQ(run("history results.db --compare 1 9").code, 1);
  EXPECT_SAYS_NOT(run("history results.db --control").out, "\nN01 ") << "simulated units among the real ones";
  EXPECT_SAYS(run("history results.db --parameter N01 --simulated --together").out, "-1    1");
  EXPECT_EQ(run("history results.db --parameter N99").code, 1);
  EXPECT_SAYS(run("history results.db --format json").out, "\"verdict.sigma.N01\":\"pass\"");
  expect_refused("history results.db --format csv --control", "--format csv: only for the list");
  expect_refused("history nowhere.db", "there is no such results database");
  expect_refused({"history", write("garbage.db", std::string(4096, 'x'))}, "not a database");
}

TEST_F(Production, VersionsAreKeptAndOneIsBroughtBack) {
  ASSERT_EQ(dry_run("one", "").code, 0);
  ASSERT_EQ(dry_run("two", "", {"--rig", write("two.rig", "noise.seed = 2\n")}).code, 0);
  const fs::path store = folder_ / "store/simulated/SN1";
  EXPECT_EQ(file_text(store / "parameters.conf"), file_text(folder_ / "two/parameters.conf"));
  expect_refused("records restore store --unit SN1", "no such version of unit 'SN1', but simulated ones: --simulated");
  expect_refused({"records", "restore", "store", "--unit", "SN1", "--version", "1"}, "but simulated ones: --simulated");
  expect_refused({"records", "restore", "store", "--unit", "SN7"}, "no such version of unit 'SN7'");
  const ProgramResult list = ends({"records", "restore", "store", "--unit", "SN1", "--simulated"}, 0);
  EXPECT_EQ(std::ranges::count(list.out, '\n'), 2);
  const ProgramResult back = ends({"records", "restore", "store", "--unit", "SN1", "--simulated", "--version", "1"}, 0);
  EXPECT_EQ(file_text(store / "parameters.conf"), file_text(folder_ / "one/parameters.conf"));
  EXPECT_EQ(file_text(store / "versions/0002.conf"), file_text(folder_ / "two/parameters.conf"));
  expect_refused({"records", "restore", "store", "--unit", "SN1", "--simulated", "--version", "3"}, "0003.conf");
  // A version that was tampered with is not brought back.
  std::string bytes = file_text(store / "versions/0002.conf");
  bytes[bytes.find("N01 = ") + 6] ^= 1;
  write("store/simulated/SN1/versions/0002.conf", bytes);
  EXPECT_EQ(run({"records", "restore", "store", "--unit", "SN1", "--simulated", "--version", "2"}).code, 1);
  const ProgramResult rest = ends({"records", "restore", "store", "--unit", "SN1", "--simulated"}, 1);
  EXPECT_SAYS(rest.err, "0002.conf");
  EXPECT_SAYS(rest.out, "   2  damaged\n");
  EXPECT_SAYS(rest.out, "  in use\n") << "the others are listed:";
  EXPECT_EQ(file_text(store / "parameters.conf"), file_text(folder_ / "one/parameters.conf"));
}

// One outcome a unit: what the diagnosis finds enters verdict, journal, database, store, queue, hook and exit code.
VerdictReport judged(UnitVerdict by_limits, const std::string& diagnosis, const DiagnosisPolicy& policy = {}) {
  VerdictReport report;
  report.verdict = by_limits;
  judge_diagnosis(diagnosis, "what was found", policy, report);
  return report;
}

TEST(Outcome, ADiagnosisHoldsAUnitBackAndNeverMakesItBetter) {
  EXPECT_EQ(judged(UnitVerdict::pass, "clean").verdict, UnitVerdict::pass);
  EXPECT_EQ(judged(UnitVerdict::pass, "not_made").verdict, UnitVerdict::pass);
  EXPECT_EQ(judged(UnitVerdict::not_judged, "clean").verdict, UnitVerdict::not_judged);
  for (const char* word : {"extended", "unexplained", "noise_model", "not_tested", "failed"}) {
    const VerdictReport report = judged(UnitVerdict::pass, word);
    EXPECT_EQ(report.verdict, UnitVerdict::hold) << word;
    EXPECT_EQ(report.reason, "diagnosis " + in_words(word) + ": what was found");
    EXPECT_EQ(judged(UnitVerdict::fail, word).verdict, UnitVerdict::fail) << word;
  }
  EXPECT_EQ(judged(UnitVerdict::pass, "extended", {UnitVerdict::pass, true}).verdict, UnitVerdict::pass);
  EXPECT_EQ(judged(UnitVerdict::pass, "extended", {UnitVerdict::fail, true}).verdict, UnitVerdict::fail);
  EXPECT_EQ(judged(UnitVerdict::pass, "unexplained", {UnitVerdict::pass, true}).verdict, UnitVerdict::hold)
      << "what nothing explains is never passed on";
  EXPECT_FALSE(is_accepted(UnitVerdict::hold));
}

class Found : public Program {
 protected:
  std::string station(const std::string& more) const {
    return write(
        "found.station",
        station_head +
            "motion.settle_s = 0.5\nrecord.database = results.db\nrecord.store = store\n"
            "hook.done = echo done $TURNCAL_OUTCOME >> told\nhook.fail = echo fail $TURNCAL_OUTCOME >> told\n" +
            more);
  }
  std::string rig() const { return write("delay.rig", "seed = 7\neffect.accel_delay.tau = 0.3\n"); }
  static long lines_with(const std::string& text, const std::string& start) {
    long count = 0;
    for (const std::string& line : lines_of(text)) count += line.starts_with(start);
    return count;
  }
};

TEST_F(Found, AUnitWithAMissingEffectIsHeldEverywhere) {
  write("queue", "SN1\n");
  const ProgramResult result =
      ends({"batch", "queue", "--dry-run", "--out", "units", "--rig", rig(), "--station", station("")}, 20);
  EXPECT_EQ(lines_with(result.out, "[dry run] [batch] unit SN1: hold: diagnosis extended: accel_delay ("), 1);
  EXPECT_SAYS(result.out, "0 passed, 1 not passed");
  EXPECT_EQ(outcomes_text(path("queue")), "SN1=hold ");
  EXPECT_EQ(file_text(folder_ / "told"), "fail hold\n");
  EXPECT_FALSE(fs::exists(folder_ / "store")) << "a file of a unit that is held is not put in use";
  const std::string parameters = file_text(folder_ / "units/SN1/parameters.conf");
  for (const char* line : {"model = extended", "effect.accel_delay.tau = ", "verdict.result = hold",
                           "verdict.reason = diagnosis extended: accel_delay (", "verdict.diagnosis = extended"})
    EXPECT_SAYS(parameters, line);
  const Result<JournalContents> journal = good(read_journal(path("units/SN1/journal.tcj")));
  EXPECT_EQ(journal->verdicts.at(0).at(0).second, "hold");
  const Result<ResultsDatabase> database = good(ResultsDatabase::open_to_read(path("results.db")));
  EXPECT_EQ(database->list({.unit = "SN1"}, "N01")->at(0).verdict, "hold");
  // It is said again, not made anew.
  ends({"resume", "units/SN1"}, 20, "hold: diagnosis extended: accel_delay");
}

TEST_F(Found, TheStationMayPassItAndLoadTheBaseFile) {
  ends({"run", "--unit", "SN1", "--dry-run", "--out", "r", "--rig", rig(), "--station",
        station("diagnosis.extended = pass\ndiagnosis.parameters = base\nlimit.N01.sigma_max = 1\n")},
       0);
  EXPECT_EQ(file_text(folder_ / "told"), "done pass\n");
  EXPECT_SAYS(file_text(folder_ / "r/parameters.conf"), "\nmodel = base\n");
  EXPECT_EQ(file_text(folder_ / "store/simulated/SN1/parameters.conf"), file_text(folder_ / "r/parameters.conf"));
  EXPECT_SAYS(file_text(folder_ / "r/diagnosis/parameters.conf"), "\nmodel = extended\n");
}

}  // namespace
}  // namespace turncal
