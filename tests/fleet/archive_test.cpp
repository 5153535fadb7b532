
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

// Two units of a station, a copy of the first, and two files that are no recordings.
class Archive : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    for (const char* unit : {"SN1", "SN2"})
      ends({"run", "--dry-run", "--unit", unit, "--no-diagnosis", "--out", path(std::string("archive/") + unit),
            "--sequence", TURNCAL_SOURCE_DIR "/sequences/forty_minutes.seq", "--quiet"},
           0);
    std::filesystem::create_directories(path("archive/copy"));
    std::filesystem::copy_file(path("archive/SN1/recording.tcr"), path("archive/copy/recording.tcr"));
    write("archive/empty.tcr", "");
    std::string cut = file_text(path("archive/SN2/recording.tcr"));
    write("archive/damaged.tcr", cut.substr(0, 40));
  }
  ProgramResult recalibrate(std::vector<std::string> more) const {
    more.insert(more.begin(), {"recalibrate", path("archive"), "--no-diagnosis"});
    return run(more);
  }
  // A station whose results are kept in results.db.
  std::string station() const {
    return write("line.station",
                 "format = 1\nstation.name = east\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\n"
                 "table.driver = mock\nimu.driver = rig\nmotion.settle_s = 0.5\n"
                 "limit.residual_max = 2\nrecord.database = results.db\n");
  }
  std::set<std::string> below(const std::string& folder) const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(path(folder)))
      names.insert(std::filesystem::relative(entry.path(), path(folder)).string());
    return names;
  }
};

TEST_F(Archive, DoesEachRecordingOnce) {
  const ProgramResult first = recalibrate({"--out", path("store")});
  EXPECT_EQ(first.code, 0) << first.err;
  EXPECT_SAYS(first.out, "2 done, 1 already done, 0 cannot be calibrated, 2 cannot be read");
  const std::set<std::string> names = below("store");
  EXPECT_EQ(names.size(), 1U + 2U * 3U + 1U);  // the version, two folders of two files each, recordings.csv
  const ProgramResult second = recalibrate({"--out", path("store")});
  EXPECT_SAYS(second.out, "0 done, 3 already done");
  EXPECT_EQ(below("store"), names);
}

TEST_F(Archive, SaysWhatBecameOfEachRecording) {
  ASSERT_EQ(recalibrate({"--out", path("store"), "--as-version", "v", "--threads", "1"}).code, 0);
  const std::string table = file_text(path("store/v/recordings.csv"));
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 1 + 5) << table;
  EXPECT_SAYS(table, "\ndone," + path("archive/SN1") + ",");
  EXPECT_SAYS(table, "\nthere," + path("archive/copy") + ",");
  EXPECT_SAYS(table, "\nunreadable," + path("archive/empty.tcr") + ",,");
}

TEST_F(Archive, DamagedCopiesAreNamedAndNotCounted) {
  std::string bytes = file_text(path("archive/SN1/recording.tcr"));
  write("archive/cut.tcr", bytes.substr(0, bytes.size() / 2));
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 0x10);
  write("archive/flipped.tcr", bytes);
  const ProgramResult result = recalibrate({"--out", path("store"), "--as-version", "v"});
  EXPECT_SAYS(result.out, "2 done, 1 already done, 0 cannot be calibrated, 4 cannot be read");
  const std::string table = file_text(path("store/v/recordings.csv"));
  EXPECT_SAYS(table, "1 damaged records dropped");
  EXPECT_SAYS(table, "no end mark");
  // What has lost its result is done again.
  for (const auto& entry : std::filesystem::directory_iterator(path("store/v")))
    if (entry.is_directory()) std::filesystem::remove(entry.path() / "parameters.conf");
  EXPECT_SAYS(recalibrate({"--out", path("store"), "--as-version", "v"}).out, "2 done, 1 already done");
}

TEST_F(Archive, SaysThatSlurmIsNotThere) {
  ::setenv("PATH", "/nonexistent", 1);
  expect_refused({"recalibrate", path("archive"), "--out", path("x"), "--engine", "slurm"}, "sbatch is not installed",
                 50);
}

TEST_F(Archive, CountsCopiesOnceAlsoWhenTwoThreadsTakeThemAtOnce) {
  std::filesystem::create_directories(path("copies"));
  for (const char* name : {"a.tcr", "b.tcr", "c.tcr", "d.tcr"})
    std::filesystem::copy_file(path("archive/SN1/recording.tcr"), path(std::string("copies/") + name));
  const ProgramResult result = ends({"recalibrate", path("copies"), "--no-diagnosis", "--out", path("store")}, 0);
  EXPECT_SAYS(result.out, "1 done, 3 already done");
}

TEST_F(Archive, ChunksAndTwoAtOnceMakeTheSame) {
  ASSERT_EQ(recalibrate({"--out", path("store")}).code, 0);
  for (const char* k : {"0", "1"}) ASSERT_EQ(recalibrate({"--out", path("chunks"), "--chunk", k, "2"}).code, 0);
  std::set<std::string> whole = below("store"), chunks = below("chunks");
  std::erase_if(whole, [](const std::string& name) { return name.ends_with(".csv"); });
  std::erase_if(chunks, [](const std::string& name) { return name.ends_with(".csv"); });
  EXPECT_EQ(chunks, whole);

  const std::vector<std::string> command = {"recalibrate", path("archive"), "--no-diagnosis", "--out", path("both")};
  const pid_t one = start(command), other = start(command);
  EXPECT_EQ(finish(one).code, 0);
  int status = 0;
  ::waitpid(other, &status, 0);
  EXPECT_EQ(status, 0);
  std::set<std::string> both = below("both");
  std::erase_if(both, [](const std::string& name) { return name.ends_with(".csv"); });
  EXPECT_EQ(both, whole);
}

TEST_F(Archive, SaysWhatChanged) {
  ASSERT_EQ(recalibrate({"--out", path("store"), "--as-version", "old"}).code, 0);
  const ProgramResult result = recalibrate({"--out", path("store"), "--as-version", "new", "--against", "old"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_SAYS(result.out, "from version old to new: 2 recordings in both, 0 only in the first");
  EXPECT_SAYS(result.out, "N01        0.000  0.000    0.000");
}

TEST_F(Archive, RefusesWhatItDoesNotUnderstand) {
  write("list.csv", "path,station\nSN1,a\n");
  expect_refused({"recalibrate", path("list.csv"), "--out", path("x")},
                 "list.csv:1: 'path': expected a list that begins with the column recording");
  write("list.csv", "recording,colour\nSN1,a\n");
  expect_refused({"recalibrate", path("list.csv"), "--out", path("x")}, "'colour': expected station, lot");
  write("list.csv", "recording,station\nSN1\n");
  expect_refused({"recalibrate", path("list.csv"), "--out", path("x")}, "list.csv:2: 1 cells: expected 2");
  write("list.csv", "recording,measured_utc\narchive/SN1,yesterday\n");
  expect_refused({"recalibrate", path("list.csv"), "--out", path("x")}, "measured_utc = 'yesterday'");
  expect_refused({"recalibrate", path("archive"), "--out", path("x"), "--chunk", "2", "2"},
                 "--chunk 2 2: expected K N");
  expect_refused({"recalibrate", path("archive"), "--out", path("x"), "--engine", "slurm", "--chunk", "0", "2"},
                 "--engine slurm: makes the chunks itself");
  expect_refused({"recalibrate", path("archive"), "--out", path("x"), "--as-version", "../evil"},
                 "--as-version '../evil'");
  expect_refused({"recalibrate", path("archive"), "--out", path("x"), "--chunks", "2"},
                 "--chunks: expected --engine slurm");
  write("with, comma/recording.tcr", "");
  expect_refused({"recalibrate", path("with, comma"), "--out", path("x"), "--engine", "slurm"}, "without a comma");
  expect_refused({"recalibrate", path("nowhere"), "--out", path("x")}, "nowhere");
  expect_refused({"calibrate", path("archive/SN1"), "--out", path("x"), "--prior", path("archive")},
                 "expected trusted calibrations of 10 other units, found 1");
  expect_refused({"calibrate", path("archive/SN1"), "--out", path("x"), "--part", "P7"}, "--part: expected --prior");
  expect_refused({"fleet", "diagnose", path("archive/copy")}, "expected statistics.tcs");
  expect_refused({"fleet", "diagnose", path("archive"), "--by", "station", "--by", "station"},
                 "--by station: is given twice");
}

// Ten other units and the unit itself: the file says what came from them, and is no history for the next.
TEST_F(Archive, IsAPrior) {
  std::filesystem::create_directories(path("earlier"));
  for (int k = 0; k < 11; ++k)
    ends({"run", "--dry-run", "--unit", "SN" + std::to_string(20 + k), "--rig",
          write("unit.rig", "seed = " + std::to_string(20 + k) + "\n"), "--no-diagnosis", "--station", station(),
          "--out", path("earlier/" + std::to_string(k)), "--sequence",
          TURNCAL_SOURCE_DIR "/sequences/forty_minutes.seq", "--quiet"},
         0);
  const ProgramResult result =
      ends({"calibrate", path("earlier/3"), "--prior", path("earlier"), "--out", path("earlier/with"), "--verbose"}, 0);
  EXPECT_SAYS(result.out, "prior: 10 other units, 0 earlier calibrations of this one");
  EXPECT_SAYS(result.out, "the unit's own history is not used");
  const std::string file = file_text(path("earlier/with/parameters.conf"));
  EXPECT_SAYS(file, "quality.prior.calibrations_of_others = 10");
  EXPECT_SAYS(file, "quality.prior.share.N01 = ");
  EXPECT_TRUE(std::filesystem::exists(path("earlier/with/statistics.tcs")));
  const ProgramResult of_rows = run(
      {"calibrate", path("earlier/3"), "--prior", path("results.db"), "--out", path("earlier/of_rows"), "--verbose"});
  EXPECT_EQ(of_rows.out.substr(0, of_rows.out.find("\nparameters ")),
            result.out.substr(0, result.out.find("\nparameters ")));
  const ProgramResult again =
      run({"calibrate", path("earlier/4"), "--prior", path("earlier"), "--out", path("again"), "--verbose"});
  EXPECT_SAYS(again.out, "prior: 10 other units, 0 earlier");
}

// What the list says stands in the files; the runs' own statistics do as well. (Both rigs have the same noise: together they would not be explained.)
TEST_F(Archive, IsAFleet) {
  write("list.csv",
        "recording,station,lot,measured_utc\narchive/SN1,east,7,2026-01-31T12:00:00Z\narchive/"
        "SN2,west,8,2026-02-01T12:00:00Z\n");
  ASSERT_EQ(run({"recalibrate", path("list.csv"), "--out", path("store"), "--no-diagnosis"}).code, 0);
  const ProgramResult result = ends({"fleet", "diagnose", path("store"), "--by", "station", "--by", "lot", "--by",
                                     "month", "--page", path("fleet.html")},
                                    0);
  EXPECT_SAYS(result.out, "2 recordings of 2 units, 2 stations, 2 lots, 2 months; simulated");
  EXPECT_SAYS(file_text(path("fleet.html")), "station");
  const ProgramResult own = ends({"fleet", "diagnose", path("archive/SN1"), "--format", "json"}, 0);
  EXPECT_EQ(own.out.substr(0, 1), "[");
}

// The rows of a station's database: its recordings are an archive, and what they hold is a fleet, the same as in the files.
TEST_F(Archive, IsAResultsDatabase) {
  for (const char* unit : {"SN3", "SN4"})
    ASSERT_EQ(run({"run", "--dry-run", "--unit", unit, "--lot", std::string("lot ") + unit, "--part", "P7",
                   "--no-diagnosis", "--out", path(std::string("runs/") + unit), "--station", station(), "--sequence",
                   TURNCAL_SOURCE_DIR "/sequences/forty_minutes.seq", "--quiet"})
                  .code,
              0);
  const ProgramResult of_files = run({"fleet", "diagnose", path("runs"), "--format", "csv"});
  const ProgramResult of_rows = ends({"fleet", "diagnose", path("results.db"), "--format", "csv"}, of_files.code);
  EXPECT_EQ(of_rows.out, of_files.out);
  const ProgramResult by_all =
      run({"fleet", "diagnose", path("results.db"), "--by", "lot", "--by", "part", "--by", "version", "--by", "month"});
  EXPECT_SAYS(by_all.out, "2 recordings of 2 units, 2 lots, 1 part, 1 version, 1 month");

  std::filesystem::remove_all(path("runs/SN4"));
  const ProgramResult again = run({"recalibrate", path("results.db"), "--no-diagnosis", "--out", path("store")});
  EXPECT_SAYS(again.out, "1 done, 0 already done, 0 cannot be calibrated, 1 cannot be read") << again.out << again.err;
  EXPECT_EQ(run({"records", "copy", path("results.db"), path("copy.db")}).code, 0);
  EXPECT_EQ(run({"fleet", "diagnose", path("copy.db"), "--format", "csv"}).out, of_files.out);
}

}  // namespace
}  // namespace turncal
