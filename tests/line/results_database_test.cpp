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
  ASSERT_EQ(dry_run("SN1").code, 0);
  const pid_t writer = start({"run", "--dry-run", "--unit", "SN2", "--out", "SN2", "--station", path("line.station")});
  const ProgramResult made = [this] {  // start() and finish() are of one program at a time
    Result<ResultsDatabase> database = ResultsDatabase::open_to_read(path("results.db"));
    return ProgramResult{.code = database && database->copy_into(path("live.db")) ? 0 : 1, .out = "", .err = ""};
  }();
  EXPECT_EQ(made.code, 0);
  ASSERT_EQ(finish(writer).code, 0);
  EXPECT_EQ(run({"records", "check", "live.db"}).code, 0);

  ASSERT_EQ(run({"records", "backup", "results.db", "--out", "copy.db"}).code, 0);
  EXPECT_SAYS(run({"records", "check", "copy.db"}).out, "2 attempts");
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
