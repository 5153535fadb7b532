// One outcome a unit: what the diagnosis finds enters verdict, journal, database, store, queue, hook and exit code.
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/queue_outcomes.h"

#include "orchestrator/jobs/run.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/results_database.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

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
    EXPECT_EQ(report.reason, std::string("diagnosis ") + word + ": what was found");
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
