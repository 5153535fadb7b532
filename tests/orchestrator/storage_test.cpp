// A recording is bound to the run that sealed it, and what the storage cannot do is nobody's fault but its own: nothing is made of
// a damaged recording, and no measured unit is marked refused.
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/queue_outcomes.h"

#include <sqlite3.h>
#include <sys/resource.h>

#include <climits>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/records/results_database.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

class Storage : public Program {
 protected:
  std::string station(const std::string& name, const std::string& more = "") const {
    return write(name,
                 station_head + "motion.settle_s = 0.5\nrecord.database = results.db\nrecord.store = store\n" + more);
  }
  Arguments begin(const std::string& out, const std::string& station, int seed = 1) const {
    const std::string rig = write("rig" + std::to_string(seed), "seed = " + std::to_string(seed) + "\n");
    return quick_run(out, {"--station", station, "--rig", rig});
  }
  // A run that was killed when its recording was sealed and nothing had been made of it yet.
  void make_sealed(const std::string& folder) {
    ::setenv("TURNCAL_FAULT_RENAMED", "/recording.tcr", 1);
    run_struck(begin(folder + "/out", station(folder + "/s.station")), 0, "");
    ::unsetenv("TURNCAL_FAULT_RENAMED");
    ASSERT_TRUE(fs::exists(folder_ / folder / "out/recording.tcr"));
    ASSERT_FALSE(fs::exists(folder_ / folder / "out/parameters.conf"));
  }
  // Somebody else holds the results database.
  void hold_database(const char* statements) {
    if (held_ == nullptr) {
      ASSERT_EQ(sqlite3_open(path("results.db").c_str(), &held_), SQLITE_OK);
    }
    sqlite3_busy_timeout(held_, 10'000);  // the run begins by a row of its own
    ASSERT_EQ(sqlite3_exec(held_, statements, nullptr, nullptr, nullptr), SQLITE_OK);
  }
  void let_go_of_database() { sqlite3_close(std::exchange(held_, nullptr)); }
  sqlite3* held_ = nullptr;
};

TEST_F(Storage, NothingIsMadeOfASealedRecordingThatWasChanged) {
  make_sealed("run");
  ASSERT_EQ(run(begin("other", station("o/s.station"), 2)).code, 0);
  const std::string whole = file_text(folder_ / "run/out/recording.tcr");
  const std::string other = file_text(folder_ / "other/recording.tcr");
  const Result<JournalContents> journal = read_journal(path("run/out/journal.tcj"));
  ASSERT_TRUE(journal.ok() && journal->hashes.size() == 1 && journal->hashes[0].size() == 32);
  std::mt19937 random(20261122);
  const auto at = [&](std::size_t size) { return random() % size; };
  for (int i = 0; i < 24; ++i) {
    std::string bytes = whole;
    switch (i % 6) {
      case 0: {
        char& byte = bytes[at(bytes.size())];
        byte = char(byte ^ (1 << at(8)));
        break;
      }
      case 1: bytes.resize(at(bytes.size())); break;
      case 2: bytes.erase(at(bytes.size() - 5000), 1 + at(5000)); break;
      case 3: bytes = i == 3 ? other : whole + whole.substr(0, 1 + at(4000)); break;
      case 4: bytes.replace(at(bytes.size() - 300), 300, 300, '\0'); break;
      case 5: bytes = bytes.substr(0, bytes.size() / 2) + other.substr(other.size() / 2); break;
    }
    if (bytes == whole) continue;
    std::ofstream(folder_ / "run/out/recording.tcr", std::ios::binary) << bytes;
    const ProgramResult result = ends({"resume", "run/out"}, 50);
    EXPECT_EQ(result.err_lines(), 1) << result.err;
    EXPECT_SAYS(result.err, "recording.tcr");
    EXPECT_SAYS_NOT(result.err, "wrong segments, signs or units");
    EXPECT_FALSE(fs::exists(folder_ / "run/out/parameters.conf")) << i;
    EXPECT_FALSE(fs::exists(folder_ / "run/store")) << i;
    const Result<ResultsDatabase> database = good(ResultsDatabase::open_to_read(path("run/results.db")));
    EXPECT_TRUE(database->list({}, "N01")->empty()) << i;
    EXPECT_EQ(database->attempts({})->front().outcome, "failed") << i;
  }
  std::ofstream(folder_ / "run/out/recording.tcr", std::ios::binary) << whole;
  EXPECT_EQ(run({"resume", "run/out"}).code, 0);
  EXPECT_TRUE(fs::exists(folder_ / "run/store/simulated/SN1/parameters.conf"));
}

// As in the run itself: what is recorded is made something of.
TEST_F(Storage, ASignalDoesNotEndTheResultsOfASealedRecording) {
  make_sealed("run");
  fs::remove(folder_ / "run/out/truth.conf");
  const pid_t pid = start({"resume", "run/out"});
  for (int i = 0; i < 20'000 && !fs::exists(folder_ / "run/out/truth.conf"); ++i) ::usleep(500);  // the first result
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) ::kill(pid, signal);
  const ProgramResult result = finish(pid);
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_TRUE(fs::exists(folder_ / "run/store/simulated/SN1/parameters.conf"));
}

TEST_F(Storage, ALockedDatabaseStopsTheBatchAndTheUnitIsNotRefused) {
  write("queue", "SN1\nSN2\n");
  const Arguments batch = "batch queue --dry-run --out units --station s.station --sequence " + first_steps("5");
  station("s.station");
  hold_database("CREATE TABLE other(x); BEGIN IMMEDIATE");
  const ProgramResult before = ends(batch, 50, "results.db: results database: ");
  EXPECT_FALSE(fs::exists(folder_ / "units/SN1/journal.tcj")) << "seen before anything moved";
  // Locked while the unit is measured.
  hold_database("ROLLBACK");
  const pid_t pid = start(batch);
  while (!fs::exists(folder_ / "units/SN1/journal.tcj")) ::usleep(1000);
  hold_database("BEGIN IMMEDIATE");
  const ProgramResult during = finish(pid);
  EXPECT_EQ(during.code, 50) << during.err;
  EXPECT_EQ(outcomes_text(path("queue")), "");
  let_go_of_database();
  ASSERT_EQ(run(batch).code, 0);
  EXPECT_EQ(outcomes_text(path("queue")), "SN1=not_judged SN2=not_judged ");
}

// Nor is the database forgotten over a unit that failed on the way.
TEST_F(Storage, ALockedDatabaseStopsTheBatchWhoseUnitFails) {
  write("queue", "SN1\nSN2\n");
  station("s.station");
  write("flagged.rig", "fault.1.kind = invalid_sample\nfault.1.sample = 4000\nfault.1.count = 100000000\n");
  const Arguments batch =
      "batch queue --dry-run --out units --station s.station --rig flagged.rig --pace 20 --sequence " +
      first_steps("5");
  const pid_t pid = start(batch);
  while (!fs::exists(folder_ / "units/SN1/recording.partial.tcr")) ::usleep(1000);
  hold_database("BEGIN IMMEDIATE");
  const ProgramResult during = finish(pid);
  EXPECT_EQ(during.code, 50) << during.err;
  EXPECT_SAYS(during.err, "results database: ");
  EXPECT_EQ(outcomes_text(path("queue")), "");
  let_go_of_database();
  ASSERT_EQ(run(batch).code, 20);
  EXPECT_EQ(outcomes_text(path("queue")), "SN1=fail SN2=fail ");
}

TEST_F(Storage, WhatWouldStopARunIsSaidBeforeItBegins) {
  RunPlan run;
  run.station = default_station_config();
  run.request.units = {"SN1"};
  run.plan.samples = LLONG_MAX / 128;
  const std::vector<Error> full = preflight(run, path("r"), 0.0);
  ASSERT_EQ(full.size(), 1u);
  EXPECT_EQ(full.front().kind, ErrorKind::device);
  EXPECT_SAYS(full.front().message, "MiB are free: expected");
  run.station.table_calibration_due = "2026-01-01";
  constexpr double next_day_s = 1767312000.0;
  ASSERT_EQ(preflight(run, "", next_day_s).size(), 1u);
  EXPECT_EQ(preflight(run, "", next_day_s).front().kind, ErrorKind::input);
  run.request.overdue_reason = "x";
  EXPECT_TRUE(preflight(run, "", next_day_s).empty());
}

TEST(StorageError, IsADeviceErrorUnlessTheNameIsWrong) {
  for (const int number : {EROFS, EACCES, EPERM, ENOSPC, EIO, EMFILE, EBUSY})
    EXPECT_EQ(storage_error("x", "cannot create", number).kind, ErrorKind::device) << number;
  for (const int number : {ENOENT, ENOTDIR, EEXIST, ENAMETOOLONG})
    EXPECT_EQ(storage_error("x", "cannot create", number).kind, ErrorKind::input) << number;
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none{3, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &none), 0);
  const Result<PosixFile> one_too_many = PosixFile::open_to_read("/proc/version");
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &before), 0);
  ASSERT_FALSE(one_too_many.ok());
  EXPECT_EQ(one_too_many.error().kind, ErrorKind::device) << one_too_many.error().message;
  EXPECT_EQ(rename_durably("/proc/version", "/tmp/turncal_version").error().kind, ErrorKind::device);
  EXPECT_EQ(check_folder_writable("/proc/version/x").error().kind, ErrorKind::input);
}

// In a dwell of 200 s.
TEST_F(Storage, WhatIsTakenAwayInADwellIsNoticedAtOnce) {
  const std::string sequence = write("long.seq",
                                     "format = 1\nname = long\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n"
                                     "  initial H 0 P 0 R 0\n  align 200\n  dwell 800000\n");
  struct Row {
    const char* out;
    std::function<void(const fs::path&)> take_away;
    const char* said;
    bool goes_on = false;
  };
  for (const auto& [out, take_away, said, goes_on] :
       {Row{"journal", [](auto& out) { fs::remove(out / "journal.tcj"); }, "journal.tcj: is no longer there"},
        Row{"shorter", [](auto& out) { fs::resize_file(out / "journal.tcj", 200); }, "it is 200 bytes long where"},
        Row{"copied",
            [](auto& out) {
              fs::copy_file(out / "journal.tcj", out / "copy");
              fs::rename(out / "copy", out / "journal.tcj");
            },
            "journal.tcj: is another file now", true},
        Row{"gone", [](auto& out) { fs::remove(out / "recording.partial.tcr"); },
            "recording.partial.tcr: is no longer there"},
        Row{"cut", [](auto& out) { fs::resize_file(out / "recording.partial.tcr", 5'000); },
            "recording.partial.tcr: somebody else has changed it: it is 5000 bytes long where"},
        Row{"folder", [](auto& out) { fs::rename(out, out.string() + ".away"); }, "is no longer there"},
        Row{"log", [](auto& out) { fs::remove(out / "run.log"); }, "run.log: is no longer there", true}}) {
    SCOPED_TRACE(out);
    const pid_t pid = start(Arguments("run --dry-run --unit SN1 --pace 200 --capture-only --out") +
                            Arguments{out, "--sequence", sequence});
    const fs::path partial = folder_ / out / "recording.partial.tcr";
    for (int i = 0; i < 3000 && !(fs::exists(partial) && fs::file_size(partial) > 200'000); ++i) ::usleep(10'000);
    const Deadline time(60.0);
    take_away(folder_ / out);
    const ProgramResult result = finish(pid);
    EXPECT_FALSE(time.passed());
    EXPECT_EQ(result.code, 50) << result.err;
    EXPECT_EQ(result.err_lines(), 1) << result.err;
    EXPECT_SAYS(result.err, said);
    EXPECT_SAYS(result.err, "dwelling");
    EXPECT_EQ(result.out.find("resume with") != std::string::npos, goes_on);
  }
  EXPECT_SAYS(run({"resume", "cut"}).err, "does not hold what this run had recorded by sample");
}

}  // namespace
}  // namespace turncal
