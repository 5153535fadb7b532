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
    return run(Program::dry_run(out.empty() ? unit : out, Arguments{"--station", "line.station"} + more, unit));
  }
  std::vector<AttemptRecord> attempts(const RecordFilter& filter = {}) const {
    const Result<ResultsDatabase> database = ResultsDatabase::open_to_read(path("results.db"));
    EXPECT_TRUE(database.ok()) << database.error().message;
    return database.ok() ? *database->attempts(filter) : std::vector<AttemptRecord>();
  }
  void sql(const std::string& name, const std::string& text) const {
    sqlite3* handle = nullptr;
    ASSERT_EQ(sqlite3_open(path(name).c_str(), &handle), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(handle, text.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(handle);
    sqlite3_close(handle);
  }
};

TEST_F(Database, EveryAttemptHasARow) {
  station("limit.residual_max = 2\n");
  ASSERT_EQ(dry_run("SN1", {"--part", "RLG", "--operator", "A. Turner", "--revision", "C"}).code, 0);
  station("limit.residual_max = 0.1\n");
  ASSERT_EQ(dry_run("SN2").code, 20);
  write("gone.rig", "fault.1.kind = imu_unplugged\nfault.1.time_s = 200\n");
  ASSERT_EQ(dry_run("SN3", {"--rig", path("gone.rig")}).code, 50);
  station("table.calibration_due = 2020-01-01\n");
  ASSERT_EQ(dry_run("SN4").code, 1);
  station();
  ASSERT_EQ(dry_run("SN5", {"--capture-only"}).code, 0);

  const std::vector<AttemptRecord> all = attempts();
  ASSERT_EQ(all.size(), 5u);
  const auto of = [&all](const std::string& unit) {
    return *std::ranges::find_if(all, [&](const AttemptRecord& a) { return a.unit == unit; });
  };
  EXPECT_EQ(of("SN1").outcome, "pass");
  EXPECT_EQ(of("SN1").part + of("SN1").operator_name + of("SN1").revision + of("SN1").station, "RLGA. TurnerCeast");
  EXPECT_GT(of("SN1").residual.value_or(0.0), 0.5);
  EXPECT_GT(of("SN1").temperature_max_c.value_or(0.0), of("SN1").temperature_min_c.value_or(100.0));
  EXPECT_LT(of("SN1").began_utc, of("SN1").time_utc);
  EXPECT_TRUE(of("SN1").simulated && of("SN1").calibration);
  EXPECT_EQ(of("SN2").outcome, "fail");
  EXPECT_SAYS(of("SN2").reason, "normalised residual ");
  EXPECT_EQ(of("SN3").outcome, "failed");
  EXPECT_NE(of("SN3").reason, "");
  EXPECT_FALSE(of("SN3").calibration);
  EXPECT_EQ(of("SN4").outcome, "refused");
  EXPECT_SAYS(of("SN4").reason, "2020-01-01");
  EXPECT_EQ(of("SN5").outcome, "captured");

  EXPECT_EQ(attempts({.part = "RLG"}).size(), 1u);
  EXPECT_EQ(attempts({.station = "west"}).size(), 0u);
  EXPECT_EQ(attempts({.verdict = "fail"}).size(), 1u);
  EXPECT_EQ(attempts({.to = "2026-01-01T00:00:00Z"}).size(), 1u) << "the one that was refused at once";
  EXPECT_EQ(attempts({.from = "2026-01-01", .to = "2026-01-01"}).size(), 5u) << "a date is the whole day";
  EXPECT_EQ(attempts({.from = "2026-01-02"}).size(), 0u);
  const ProgramResult listed = run({"history", "results.db", "--attempts", "--verdict", "refused"});
  EXPECT_SAYS(listed.out, "SN4");
  EXPECT_SAYS_NOT(listed.out, "SN1");
  for (const char* none : {"yesterday", "2026-02-30", "2026-13", "2026-02-01T25:00:00Z", "202", "2026-", "2026-1-01"})
    expect_refused({"history", "results.db", "--from", none},
                   "--from '" + std::string(none) + "': expected a date or a time");
  for (const char* some : {"2026", "2026-1", "2026-01-3", "2026-01-31T2", "2026-01-31T23:59:59Z"})
    EXPECT_EQ(run({"history", "results.db", "--to", some}).code, 0) << some;
  expect_refused({"shift", "results.db", "--from", "2026-02", "--to", "2026-01-31"}, "is after --to '2026-01-31'");
  EXPECT_EQ(run({"history", "results.db", "--from", "2026-01-01", "--to", "2026-01"}).code, 0);

  // What no row has is more likely mistyped than asked for.
  for (const char* command : {"history", "shift"})
    expect_refused({command, "results.db", "--station", "west"},
                   "--station 'west': no row has it: expected one of east");
  expect_refused("history results.db --verdict bad",
                 "--verdict 'bad': no row has it: expected one of captured, dropped, refused, aborted, interrupted, "
                 "failed, running");
  EXPECT_EQ(run({"history", "results.db", "--attempts", "--verdict", "hold"}).code, 0) << "there may be none";
  for (const char* of_calibrations : {"--control", "--report=r.html", "--parameter=N01"})
    expect_refused({"history", "results.db", "--attempts", of_calibrations}, "--attempts: expected no --compare");
  expect_refused({"history", "results.db", "--control"}, "calibrations are of dry runs: expected --simulated");
  const ProgramResult real = run({"shift", "results.db"});
  EXPECT_SAYS(real.out, "attempts of simulated units left out: 5");
  EXPECT_SAYS(real.out, "Use --simulated");
  EXPECT_SAYS_NOT(run({"shift", "results.db", "--simulated"}).out, "left out");
}

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

TEST_F(Database, TheSameRecordingIsTheSameRow) {
  station();
  ASSERT_EQ(dry_run("SN1").code, 0);
  ASSERT_EQ(dry_run("SN1", {}, "again").code, 0);
  const Result<ResultsDatabase> database = good(ResultsDatabase::open_to_read(path("results.db")));
  ASSERT_EQ(database->list({}, "")->size(), 1u);
  EXPECT_EQ(database->list({}, "")->front().values.size(), 24u);
  const std::vector<AttemptRecord> all = attempts();
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0].calibration, all[1].calibration);
  EXPECT_TRUE(database->check().ok());
}

TEST_F(Database, OneOfAnotherSchemaIsRefusedInOneLine) {
  station();
  ASSERT_EQ(dry_run("SN1").code, 0);
  for (const std::string version : {"3", "5"}) {
    sql("results.db", "UPDATE schema_version SET version = " + version);
    const std::string why = "results.db: results database: its schema has version " + version + ", expected 4";
    expect_refused({"history", "results.db"}, why);
    expect_refused({"records", "check", "results.db"}, why);
    expect_refused({"run", "--dry-run", "--unit", "SN2", "--out", "SN2", "--station", path("line.station")}, why);
  }
}

TEST_F(Database, ABackupIsWholeWhileOthersWrite) {
  station();
  ASSERT_EQ(dry_run("SN1").code, 0);
  const pid_t writer = start({"run", "--dry-run", "--unit", "SN2", "--out", "SN2", "--station", path("line.station")});
  const ProgramResult made = [this] {  // start() and finish() are of one program at a time
    Result<ResultsDatabase> database = ResultsDatabase::open_to_read(path("results.db"));
    Result<std::string> image = database ? database->image() : Result<std::string>(database.error());
    if (image) std::ofstream(folder_ / "live.db", std::ios::binary) << *image;
    return ProgramResult{.code = image ? 0 : 1, .out = "", .err = ""};
  }();
  EXPECT_EQ(made.code, 0);
  ASSERT_EQ(finish(writer).code, 0);
  EXPECT_EQ(run({"records", "check", "live.db"}).code, 0);

  ASSERT_EQ(run({"records", "backup", "results.db", "--out", "copy.db"}).code, 0);
  EXPECT_SAYS(run({"records", "check", "copy.db"}).out, "2 attempts");
  ASSERT_EQ(run({"records", "backup", "results.db", "--out", "copy.db"}).code, 0) << "an older backup is replaced";
  write("letter.txt", "Dear customer,\n");
  expect_refused({"records", "backup", "results.db", "--out", "letter.txt"}, "letter.txt");
  expect_refused({"records", "backup", "results.db", "--out", "results.db"}, "results.db");
  expect_refused({"records", "backup", "results.db"}, "--out is required");
}

TEST_F(Database, DamageIsFound) {
  station();
  ASSERT_EQ(dry_run("SN1").code, 0);
  fs::copy_file(path("results.db"), path("changed.db"));
  sql("changed.db", "UPDATE value SET value = value + 1 WHERE key = 'N02'");
  expect_refused({"records", "check", "changed.db"}, "row 1: N02 is not that of the parameter file");
  expect_refused({"records", "backup", "changed.db", "--out", "copy.db"}, "row 1: N02");
  fs::copy_file(path("results.db"), path("other.db"));
  sql("other.db", "UPDATE calibration SET sequence_hash = 'another'");
  expect_refused({"records", "check", "other.db"}, "row 1: sequence_hash is not that of the parameter file");
  fs::copy_file(path("results.db"), path("loose.db"));
  sql("loose.db", "UPDATE attempt_note SET calibration = 77 WHERE calibration IS NOT NULL");
  expect_refused({"records", "check", "loose.db"},
                 "row 2 of attempt_note names a row of calibration that is not there");
  std::string torn = file_text(folder_ / "results.db");
  for (std::size_t i = 4096; i < 4096 + 200; ++i) torn[i] = '\x55';
  write("torn.db", torn);
  expect_refused({"records", "check", "torn.db"}, "torn.db: results database: ");
  write("none.db", "a letter, not a database, long enough to be looked at as one, 0123456789 0123456789 0123456789");
  expect_refused({"records", "check", "none.db"}, "none.db: results database: ");
  expect_refused({"records", "check", "missing.db"}, "missing.db: there is no such results database");
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
