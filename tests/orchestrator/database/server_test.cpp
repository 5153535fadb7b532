// A results database on a server: many stations, their roles, and what happens when the server goes away at the worst moment.
// scripts/fleet-test starts the server and says in the environment how it is stopped, killed and started again.

#include <thread>

#include "orchestrator/records/results_database.h"
#include "tests/imu_io/loopback.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class SharedDatabase : public Program {
 protected:
  std::string station(const std::string& database, const std::string& name = "east") const {
    return write(name + ".station",
                 station_head + "station.name = " + name +
                     "\nmotion.settle_s = 0.5\nlimit.residual_max = 2\nrecord.database = " + database + "\n");
  }
  Arguments dry_run(const std::string& unit, const std::string& name = "east") const {
    return quick_run(name + "/" + unit, {"--station", path(name + ".station")}, unit);
  }
  std::vector<AttemptRecord> attempts(const std::string& name, const RecordFilter& filter = {}) const {
    return *good(ResultsDatabase::open_to_read(name))->attempts(filter);
  }
  std::size_t calibrations(const std::string& name, const RecordFilter& filter = {}) const {
    return good(ResultsDatabase::open_to_read(name))->list(filter, "N01")->size();
  }
};

std::string setting(const char* name) {
  const char* const value = std::getenv(name);
  return value ? value : "";
}

class Server : public SharedDatabase {
 protected:
  void SetUp() override {
    if (setting("TURNCAL_TEST_SERVER").empty()) GTEST_SKIP() << "no server: scripts/fleet-test starts one";
    SharedDatabase::SetUp();
    name_ = testing::UnitTest::GetInstance()->current_test_info()->name();
    std::transform(name_.begin(), name_.end(), name_.begin(), [](unsigned char c) { return std::tolower(c); });
    ASSERT_EQ(psql("DROP DATABASE IF EXISTS " + name_, "postgres"), 0);
    ASSERT_EQ(psql("CREATE DATABASE " + name_, "postgres"), 0);
    ends({"records", "roles", address("postgres")}, 0);
    for (const char* login : {"east", "west"})
      psql("CREATE ROLE " + std::string(login) + " LOGIN IN ROLE turncal_station", name_, "2> /dev/null");
    psql("CREATE ROLE watcher LOGIN IN ROLE turncal_reader", name_, "2> /dev/null");
  }
  std::string address(const std::string& user, const std::string& database = "") const {
    return "postgresql://" + user + "@/" + (database.empty() ? name_ : database) +
           "?host=" + setting("TURNCAL_TEST_SERVER");
  }
  // 0: the server took it. As the owner, unless `user` says otherwise.
  int psql(const std::string& sql, const std::string& database = "", const std::string& more = "",
           const std::string& user = "postgres") const {
    return std::system(
        ("psql -qAtX -v ON_ERROR_STOP=1 '" + address(user, database) + "' -c \"" + sql + "\" " + more).c_str());
  }
  static void control(const std::string& what) {
    ASSERT_EQ(std::system((setting("TURNCAL_TEST_CONTROL") + " " + what).c_str()), 0) << what;
  }
  // A file with `count` attempts in it, each begun and ended.
  Result<ResultsDatabase> kept(const std::string& name, int count) const {
    Result<ResultsDatabase> database = ResultsDatabase::open(path(name));
    for (int i = 0; database && i < count; ++i) {
      AttemptRecord attempt;
      attempt.run = "2026-01-01T00:00:00Z /out/" + std::to_string(i);
      attempt.unit = "SN" + std::to_string(i);
      attempt.began_utc = attempt.time_utc = "2026-01-01T00:00:00Z";
      attempt.station = "east";
      for (const char* outcome : {outcome_running, "aborted"}) {
        attempt.outcome = outcome;
        EXPECT_TRUE(database->note(attempt).ok());
      }
    }
    return database;
  }
  std::string name_;
};

TEST_F(Server, TwoStationsAddAtOnceAndNothingIsLostOrDoubled) {
  constexpr int units = 4;
  std::string script;
  for (const std::string name : {"east", "west"}) {
    station(address(name), name);
    script += "(";
    for (int i = 0; i < units; ++i) {
      for (const std::string& word : dry_run(name + std::to_string(i), name))
        script += word == "run" ? TURNCAL_BINARY " run" : " '" + word + "'";
      script += " && ";
    }
    script += "true) & ";
  }
  ASSERT_EQ(std::system(("cd " + folder_.string() + "; exec > /dev/null; " + script + "wait").c_str()), 0);
  for (const std::string name : {"east", "west"}) {
    EXPECT_EQ(attempts(address("watcher"), {.station = name, .verdict = "pass"}).size(), 4u) << name;
    EXPECT_EQ(calibrations(address("watcher"), {.station = name}), 4u) << name;
    EXPECT_TRUE(attempts(path(name + ".station.outbox.db")).empty()) << name;
    EXPECT_EQ(calibrations(path(name + ".station.outbox.db")), 0u) << name;
  }
  EXPECT_EQ(run({"records", "check", address("watcher")}).code, 0);
  const ProgramResult of_files = run({"fleet", "diagnose", path("."), "--format", "csv"});
  EXPECT_FALSE(of_files.out.empty()) << of_files.err;
  EXPECT_EQ(run({"fleet", "diagnose", address("watcher"), "--format", "csv"}).out, of_files.out);
  EXPECT_SAYS(run({"history", address("watcher"), "--unit", "west3"}).out, "west3");
  const ProgramResult shift = ends({"shift", address("watcher"), "--simulated"}, 0);
  EXPECT_SAYS(shift.out, "8 attempts");
}

// A reader that has seen a number misses no smaller one: who writes waits for who has begun to.
TEST_F(Server, NumbersOfRowsGrowAsTheRowsCanBeRead) {
  Result<ResultsDatabase> server = good(ResultsDatabase::open(address("east")));
  std::thread slow([this] {
    psql(
        "BEGIN; SELECT pg_advisory_xact_lock(7467); INSERT INTO attempt_note(key, unit, began_utc, time_utc, outcome, "
        "simulated, sessions) VALUES('k', 'slow', '', '', 'pass', 0, 1); SELECT pg_sleep(2); COMMIT",
        "", "> /dev/null", "west");
  });
  std::this_thread::sleep_for(std::chrono::seconds(1));
  AttemptRecord fast;
  fast.unit = "fast";
  EXPECT_TRUE(server->note(fast).ok());
  std::string units;
  for (const AttemptRecord& attempt : attempts(address("watcher"))) units += attempt.unit + " ";
  slow.join();
  EXPECT_EQ(units, "slow fast ");
}

TEST_F(Server, WhatWasKeptWhileItWasStoppedIsSentOnce) {
  station(address("east"));
  ASSERT_EQ(run(dry_run("SN1")).code, 0);
  control("stop");
  ends(dry_run("SN2"), 0);
  EXPECT_EQ(attempts(path("east.station.outbox.db")).size(), 1u);
  control("start");
  ASSERT_EQ(run(dry_run("SN3")).code, 0);
  const std::vector<AttemptRecord> all = attempts(address("watcher"));
  ASSERT_EQ(all.size(), 3u);
  for (const AttemptRecord& attempt : all)
    EXPECT_TRUE(attempt.outcome == "pass" && attempt.calibration) << attempt.unit;
  EXPECT_EQ(calibrations(address("watcher")), 3u);
  EXPECT_TRUE(attempts(path("east.station.outbox.db")).empty());
}

TEST_F(Server, KilledInMidTransactionItLosesAndDoublesNothing) {
  constexpr int count = 150;  // with two notes each: three pages
  const Result<ResultsDatabase> outbox = good(kept("outbox.db", count));
  ASSERT_EQ(psql("CREATE FUNCTION slow() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN PERFORM pg_sleep(0.005); RETURN "
                 "NEW; END'; CREATE TRIGGER slow BEFORE INSERT ON attempt_note FOR EACH ROW EXECUTE FUNCTION slow()"),
            0);
  int broken = 0;
  for (const int after_ms : {100, 400, 700, 1000}) {
    Result<ResultsDatabase> server = good(ResultsDatabase::open(address("east")));
    std::thread killer([after_ms] {
      std::this_thread::sleep_for(std::chrono::milliseconds(after_ms));
      control("kill");
    });
    const Result<CopiedRows> sent = outbox->copy_to(*server, true);
    killer.join();
    broken += !sent.ok();
    control("start");
    std::set<std::string> somewhere;
    for (const std::string& name : {address("watcher"), path("outbox.db")})
      for (const AttemptRecord& attempt : attempts(name)) somewhere.insert(attempt.unit);
    EXPECT_EQ(somewhere.size(), 150u) << after_ms;
  }
  EXPECT_GE(broken, 3);
  Result<ResultsDatabase> server = ResultsDatabase::open(address("east"));
  ASSERT_TRUE(server.ok() && outbox->copy_to(*server, true).ok());
  const std::vector<AttemptRecord> all = attempts(address("watcher"));
  EXPECT_EQ(all.size(), 150u);
  for (const AttemptRecord& attempt : all) EXPECT_EQ(attempt.outcome, "aborted") << attempt.unit;
  EXPECT_TRUE(attempts(path("outbox.db")).empty());
  EXPECT_EQ(psql("SELECT 1 / (count(*) = 300)::int FROM attempt_note", "", "> /dev/null"), 0)
      << "notes, too, are there once";
}

TEST_F(Server, ItsDiskIsFull) {
  station(address("east"));
  ASSERT_EQ(run(dry_run("SN1")).code, 0);
  // As a full disk: what comes is refused with its code, 53100, in the middle of a calibration.
  ASSERT_EQ(
      psql("CREATE FUNCTION full_disk() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN RAISE EXCEPTION ''No space left "
           "on device'' USING ERRCODE = ''53100''; END'; CREATE TRIGGER full_disk BEFORE INSERT ON value FOR EACH "
           "ROW WHEN (NEW.key = 'a11') EXECUTE FUNCTION full_disk()"),
      0);
  ASSERT_EQ(run(dry_run("SN2")).code, 0);
  EXPECT_SAYS(file_text(folder_ / "east/SN2/run.log"), "No space left on device; 1 attempt is kept in ");
  EXPECT_EQ(calibrations(address("watcher")), 1u);
  EXPECT_EQ(psql("SELECT 1 / (count(*) = 24)::int FROM value", "", "> /dev/null"), 0) << "no half of a calibration";
  ASSERT_EQ(psql("DROP TRIGGER full_disk ON value"), 0);
  ASSERT_EQ(run(dry_run("SN3")).code, 0);
  EXPECT_EQ(attempts(address("watcher"), {.verdict = "pass"}).size(), 3u);
  EXPECT_EQ(calibrations(address("watcher")), 3u);
}

TEST_F(Server, AStationAddsAndNeverChangesAReaderReads) {
  station(address("east"));
  ASSERT_EQ(run(dry_run("SN1")).code, 0);
  for (const std::string user : {"east", "watcher"}) {
    EXPECT_EQ(psql("SELECT count(*) FROM attempt", "", "> /dev/null", user), 0) << user;
    for (const std::string table : {"attempt_note", "calibration", "value", "schema_version"}) {
      EXPECT_NE(psql("DELETE FROM " + table, "", "2> /dev/null", user), 0) << user << ' ' << table;
      EXPECT_NE(psql("TRUNCATE " + table + " CASCADE", "", "2> /dev/null", user), 0) << user << ' ' << table;
    }
    EXPECT_NE(psql("UPDATE attempt_note SET outcome = 'pass'", "", "2> /dev/null", user), 0) << user;
    EXPECT_NE(psql("UPDATE attempt SET outcome = 'pass'", "", "2> /dev/null", user), 0) << user;
    EXPECT_NE(psql("UPDATE calibration SET verdict = 'pass'", "", "2> /dev/null", user), 0) << user;
    EXPECT_NE(psql("UPDATE value SET value = 0", "", "2> /dev/null", user), 0) << user;
    EXPECT_NE(psql("DROP TABLE value", "", "2> /dev/null", user), 0) << user;
    EXPECT_NE(psql("CREATE TABLE other(x int)", "", "2> /dev/null", user), 0) << user;
  }
  const std::string more =
      "INSERT INTO attempt_note(key, unit, began_utc, time_utc, outcome, simulated, sessions) VALUES('k', 'u', 't', "
      "'t', 'o', 1, 1)";
  EXPECT_NE(psql(more, "", "2> /dev/null", "watcher"), 0);
  EXPECT_EQ(psql(more, "", "", "west"), 0);
  EXPECT_EQ(run({"history", address("watcher"), "--attempts"}).code, 0);
  // A station that was given a reader's name keeps its rows.
  station(address("watcher"), "west");
  ASSERT_EQ(run(dry_run("SN2", "west")).code, 0);
  EXPECT_SAYS(file_text(folder_ / "west/SN2/run.log"), "permission denied for table");
  EXPECT_EQ(attempts(path("west.station.outbox.db")).size(), 1u);
}

TEST_F(Server, RowsGoThereAndBackAsTheyWere) {
  station("results.db");
  for (const char* unit : {"SN1", "SN2"}) ASSERT_EQ(run(dry_run(unit)).code, 0);
  write("gone.rig", "fault.1.kind = imu_unplugged\nfault.1.time_s = 100\n");
  std::vector<std::string> failing = dry_run("SN3");
  failing.insert(failing.end(), {"--rig", path("gone.rig")});
  ASSERT_EQ(run(failing).code, 50);
  for (int i = 0; i < 2; ++i) {
    const ProgramResult copied = ends({"records", "copy", "results.db", address("east")}, 0);
    EXPECT_SAYS(copied.out, i == 0 ? "2 new calibrations and 6 new notes" : "0 new calibrations and 0 new notes");
  }
  ASSERT_EQ(run({"records", "backup", address("watcher"), "--out", "back.db"}).code, 0);
  EXPECT_EQ(run({"records", "check", "back.db"}).code, 0);
  const std::string before = run({"history", "results.db", "--format", "csv"}).out;
  EXPECT_GT(before.size(), 1000u);
  EXPECT_EQ(run({"history", address("watcher"), "--format", "csv"}).out, before);
  EXPECT_EQ(run({"history", "back.db", "--format", "csv"}).out, before);
  EXPECT_EQ(run("history back.db --attempts --format csv").out,
            run({"history", "results.db", "--attempts", "--format", "csv"}).out);
}

TEST_F(Server, APasswordComesFromTheFileForPasswordsAndIsNeverShown) {
  psql("CREATE ROLE guarded LOGIN PASSWORD 'xyzzy17' IN ROLE turncal_reader", "", "2> /dev/null");
  const std::string name = "postgresql://guarded@127.0.0.1:" + setting("TURNCAL_TEST_PORT") + "/" + name_;
  const ProgramResult without = ends({"history", name}, 50, "");
  ::setenv("PGPASSFILE", write("pgpass", "127.0.0.1:*:*:guarded:xyzzy17\n").c_str(), 1);
  ::chmod(path("pgpass").c_str(), 0600);
  const ProgramResult with = ends({"history", name}, 0);
  ::setenv("PGPASSFILE", write("pgpass", "127.0.0.1:*:*:guarded:wrong17\n").c_str(), 1);
  const ProgramResult wrong = run({"history", name});
  ::unsetenv("PGPASSFILE");
  EXPECT_EQ(wrong.code, 50);
  EXPECT_SAYS_NOT((with.out + wrong.err + without.err), "17\n");
  EXPECT_SAYS_NOT(wrong.err, "wrong17");
}

// ---- a server that is away

using Outbox = SharedDatabase;

TEST_F(Outbox, ServerThatTakesAConnectionAndSaysNothingCostsSecondsOnly) {
  const test::Socket listener(SOCK_STREAM);
  ASSERT_EQ(::listen(listener.descriptor, 8), 0);
  const auto began = std::chrono::steady_clock::now();
  const Result<ResultsDatabase> database = ResultsDatabase::open(
      "postgresql://east@127.0.0.1:" + std::to_string(listener.port) + "/turncal", {.wait_s = 1.0, .all_s = 2.0});
  ASSERT_FALSE(database.ok());
  EXPECT_EQ(database.error().kind, ErrorKind::device);
  EXPECT_SAYS(database.error().message, "there is no connection within 1 s");
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(2));
}

}  // namespace
}  // namespace turncal
