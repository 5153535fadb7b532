// The results database: every attempt has its row, other schemas and damage are refused.
#include "orchestrator/records/results_database.h"

#include <sqlite3.h>

#include "imu_io/base/text.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class Database : public Program {
 protected:
  void station(const std::string& more = "") const {
    write("line.station",
          station_head + "station.name = east\nmotion.settle_s = 0.5\nrecord.database = results.db\n" + more);
  }
  ProgramResult dry_run(const std::string& unit, const Arguments& more = {}, const std::string& out = "") const {
    return run(quick_run(out.empty() ? unit : out, Arguments{"--station", "line.station"} + more, unit));
  }
  std::vector<AttemptRecord> attempts(const RecordFilter& filter = {}) const {
    return *good(ResultsDatabase::open_to_read(path("results.db")))->attempts(filter);
  }
};

TEST_F(Database, ARunThatGoesOnIsTheSameAttempt) {
  station();
  const ProgramResult whole = dry_run("SN1");
  ASSERT_EQ(whole.code, 0);
  const pid_t pid =
      start({"run", "--dry-run", "--unit", "SN2", "--out", "SN2", "--pace", "300", "--station", path("line.station")});
  const auto begun = [this] {
    const std::vector<AttemptRecord> all = attempts({.unit = "SN2"});
    return all.size() == 1 && fs::exists(folder_ / "SN2/recording.partial.tcr");
  };
  for (int i = 0; i < 200 && !begun(); ++i) ::usleep(50'000);
  ::usleep(500'000);
  ASSERT_EQ(attempts({.unit = "SN2"}).size(), 1u);
  EXPECT_EQ(attempts({.unit = "SN2"}).front().outcome, outcome_running);
  ::kill(pid, SIGTERM);
  ASSERT_EQ(finish(pid).code, 75);
  EXPECT_EQ(attempts({.unit = "SN2"}).front().outcome, "interrupted");
  ASSERT_EQ(run({"resume", "SN2"}).code, 0);
  const std::vector<AttemptRecord> after = attempts({.unit = "SN2"});
  ASSERT_EQ(after.size(), 1u);
  EXPECT_EQ(after.front().outcome, "not_judged");
  EXPECT_EQ(after.front().sessions, 2);
  EXPECT_LT(after.front().began_utc, "2026-01-01T00:01:00Z");
}

TEST_F(Database, ABackupIsWholeWhileOthersWrite) {
  station();
  ASSERT_EQ(dry_run("SN1", {"--unit", "SN3"}, "both").code, 0);
  EXPECT_EQ(attempts({.unit = "SN3"}).front().units, 2) << "of one run";
  const pid_t writer = start({"run", "--dry-run", "--unit", "SN2", "--out", "SN2", "--station", path("line.station")});
  const ProgramResult made = [this] {  // start() and finish() are of one program at a time
    Result<ResultsDatabase> database = ResultsDatabase::open_to_read(path("results.db"));
    return ProgramResult{.code = database && database->copy_into(path("live.db")) ? 0 : 1, .out = "", .err = ""};
  }();
  EXPECT_EQ(made.code, 0);
  ASSERT_EQ(finish(writer).code, 0);
  EXPECT_EQ(run({"records", "check", "live.db"}).code, 0);

  ASSERT_EQ(run({"records", "backup", "results.db", "--out", "copy.db"}).code, 0);
  EXPECT_SAYS(run({"records", "check", "copy.db"}).out, "3 attempts");
}

TEST_F(Database, AfterAnIdComesWhatReachedTheDatabaseLater) {
  const auto add = [this](const std::string& file, const std::string& unit, const std::string& outcome, int hour) {
    AttemptRecord attempt;
    attempt.run = "run of " + unit;
    attempt.unit = unit;
    attempt.outcome = outcome;
    attempt.began_utc = attempt.time_utc = format_utc(3600.0 * hour);
    EXPECT_TRUE(good(ResultsDatabase::open(path(file)))->note(attempt).ok());
  };
  std::int64_t last = 0;
  const auto news = [&] {
    std::string text;
    const std::string csv = run("history results.db --attempts --format csv --after " + std::to_string(last)).out;
    for (const std::string& line : lines_of(csv)) {
      const std::vector<std::string> cells = lines_of(line, ',');
      if (cells.front() == "id") continue;
      last = std::max(last, parse_integer(cells.front()).value_or(0));
      text += cells[1] + " " + cells[4] + " " + cells.back() + "; ";
    }
    return text;
  };
  add("results.db", "SN1", "running", 10);
  add("results.db", "SN2", "pass", 11);
  EXPECT_EQ(news(), "SN1 running run of SN1; SN2 pass run of SN2; ");
  EXPECT_EQ(news(), "");
  add("kept.db", "SN3", "fail", 8);  // it waited for the server
  ends({"records", "copy", "kept.db", "results.db"}, 0);
  add("results.db", "SN1", "hold", 9);  // the clock was set back
  EXPECT_EQ(news(), "SN3 fail run of SN3; SN1 hold run of SN1; ");
  ends("history results.db --attempts --after 5", 1, "has id 4");
  ends("history results.db --after 1", 1, "has id 0");
}

TEST_F(Database, AnEmptyFileIsNoneForAReader) {
  write("results.db", "");
  for (const Arguments& reader : {Arguments("records check results.db"), Arguments("records copy results.db two.db"),
                                  Arguments("history results.db"), Arguments("shift results.db")})
    ends(reader, 1, "results.db: results database: holds no tables");
  station();
  EXPECT_EQ(dry_run("SN1").code, 0);
  EXPECT_SAYS(ends("records check results.db", 0).out, "1 attempt");
}

TEST_F(Database, SaysWhatIsNotThereAndWhatWasMeant) {
  station("record.store = store\n");
  ASSERT_EQ(dry_run("SN1").code, 0);
  ends("records restore store --simulated --unit SN2", 1,
       "store: there is no simulated unit 'SN2'; did you mean 'SN1'?");
  ends("records restore store --unit SN1", 1, "store: unit 'SN1' has simulated versions only: --simulated");
  ends("records restore store --simulated --unit SN1 --version 7", 1, "there is no version 7: expected 1 to 1");
  ends("queue q --again SN1", 1, "q: there is no unit 'SN1': there is none at all");
  ends("queue q --add SN1 --add SN22", 0);
  for (const char* change : {"--again", "--remove"})
    ends(std::string("queue q ") + change + " SN2Z", 1, "q: there is no unit 'SN2Z'; did you mean 'SN22'?");
  ends("queue q --again SN1", 1, "q: unit 'SN1' has no outcome yet");
}

// Words between backquotes in the first column of the tables of docs/production.md, "Results for a MES".
std::multiset<std::string> documented_keys() {
  const std::string text = file_text(std::string(TURNCAL_SOURCE_DIR) + "/docs/production.md");
  const std::size_t begin = text.find("## Results for a MES");
  std::multiset<std::string> keys;
  std::string_view remaining = std::string_view(text).substr(begin, text.find("\n## ", begin) - begin);
  while (!remaining.empty()) {
    const std::string_view line = next_line(remaining);
    if (!line.starts_with("| `")) continue;
    const std::vector<std::string_view> words = split(line.substr(0, line.find(" | ")), '`');
    for (std::size_t i = 1; i < words.size(); i += 2) keys.emplace(words[i]);
  }
  return keys;
}

TEST(ResultsForAMes, KeysAreDocumented) {
  std::multiset<std::string> keys;
  for (const DataTable& table : {attempts_table({}), calibrations_table({})}) {
    const std::string csv = table.csv();
    std::string_view heads = csv;
    for (std::string_view key : split(next_line(heads), ',')) {
      // One parameter stands for the others.
      const std::string_view parameter = key.substr(key.rfind('.') + 1);
      if (std::ranges::find(parameter_keys, parameter) == parameter_keys.end())
        keys.emplace(key);
      else if (parameter == "a33")
        keys.insert(std::string(key.substr(0, key.size() - parameter.size())) + "KEY");
    }
  }
  EXPECT_EQ(documented_keys(), keys);
}

}  // namespace
}  // namespace turncal
