
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

// Two units of a station, a copy of the first, and two files that are no recordings.
class Archive : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    for (const char* unit : {"SN1", "SN2"})
      ends(dry_run(std::string("archive/") + unit, "--no-diagnosis --quiet", unit), 0);
    std::filesystem::create_directories(path("archive/copy"));
    std::filesystem::copy_file(path("archive/SN1/recording.tcr"), path("archive/copy/recording.tcr"));
    write("archive/empty.tcr", "");
    std::string cut = file_text(path("archive/SN2/recording.tcr"));
    write("archive/damaged.tcr", cut.substr(0, 40));
  }
  ProgramResult recalibrate(const Arguments& more) const {
    return run(Arguments{"recalibrate", path("archive"), "--no-diagnosis"} + more);
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

TEST_F(Archive, DoesEachRecordingOnceAndSaysWhatBecameOfIt) {
  const ProgramResult first = recalibrate("--out store --as-version old --threads 1");
  EXPECT_EQ(first.code, 0) << first.err;
  EXPECT_SAYS(first.out, "2 done, 1 already done, 0 cannot be calibrated, 2 cannot be read");
  const std::string table = file_text(path("store/old/recordings.csv"));
  EXPECT_EQ(std::ranges::count(table, '\n'), 1 + 5) << table;
  EXPECT_SAYS(table, "\ndone," + path("archive/SN1") + ",");
  EXPECT_SAYS(table, "\nthere," + path("archive/copy") + ",");
  EXPECT_SAYS(table, "\nunreadable," + path("archive/empty.tcr") + ",,");
  const std::set<std::string> names = below("store");
  EXPECT_EQ(names.size(), 1U + 2U * 3U + 1U);  // the version, two folders of two files each, recordings.csv
  EXPECT_SAYS(recalibrate("--out store --as-version old").out, "0 done, 3 already done");
  EXPECT_EQ(below("store"), names);
  const ProgramResult result = recalibrate("--out store --as-version new --against old");
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_SAYS(result.out, "from version old to new: 2 recordings in both, 0 only in the first");
  EXPECT_SAYS(result.out, "N01        0.000  0.000    0.000");
}

TEST_F(Archive, DamagedCopiesAreNamedAndNotCounted) {
  std::string bytes = file_text(path("archive/SN1/recording.tcr"));
  write("archive/cut.tcr", bytes.substr(0, bytes.size() / 2));
  bytes[bytes.size() / 2] = char(bytes[bytes.size() / 2] ^ 0x10);
  write("archive/flipped.tcr", bytes);
  const ProgramResult result = recalibrate("--out store --as-version v");
  EXPECT_SAYS(result.out, "2 done, 1 already done, 0 cannot be calibrated, 4 cannot be read");
  const std::string table = file_text(path("store/v/recordings.csv"));
  EXPECT_SAYS(table, "1 damaged records dropped");
  EXPECT_SAYS(table, "no end mark");
  // What has lost its result is done again.
  for (const auto& entry : std::filesystem::directory_iterator(path("store/v")))
    if (entry.is_directory()) std::filesystem::remove(entry.path() / "parameters.conf");
  EXPECT_SAYS(recalibrate("--out store --as-version v").out, "2 done, 1 already done");
}

TEST_F(Archive, CountsCopiesOnceAlsoWhenTwoThreadsTakeThemAtOnce) {
  std::filesystem::create_directories(path("copies"));
  for (const char* name : {"a.tcr", "b.tcr", "c.tcr", "d.tcr"})
    std::filesystem::copy_file(path("archive/SN1/recording.tcr"), path(std::string("copies/") + name));
  const ProgramResult result = ends("recalibrate copies --no-diagnosis --out store", 0);
  EXPECT_SAYS(result.out, "1 done, 3 already done");
}

TEST_F(Archive, ChunksAndTwoAtOnceMakeTheSame) {
  ASSERT_EQ(recalibrate("--out store").code, 0);
  for (const char* k : {"0", "1"}) ASSERT_EQ(recalibrate({"--out", path("chunks"), "--chunk", k, "2"}).code, 0);
  const auto made = [this](const std::string& store) {
    std::set<std::string> names = below(store);
    std::erase_if(names, [](const std::string& name) { return name.ends_with(".csv"); });
    return names;
  };
  EXPECT_EQ(made("chunks"), made("store"));

  const std::vector<std::string> command = {"recalibrate", path("archive"), "--no-diagnosis", "--out", path("both")};
  const pid_t one = start(command), other = start(command);
  EXPECT_EQ(finish(one).code, 0);
  int status = 0;
  ::waitpid(other, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(made("both"), made("store"));
}

TEST_F(Archive, RefusesWhatItDoesNotUnderstand) {
  for (const auto& [list, words] :
       {std::pair{"path,station\nSN1,a\n", "list.csv:1: 'path': expected a list that begins with the column recording"},
        {"recording,colour\nSN1,a\n", "'colour': expected station, lot"},
        {"recording,station\nSN1\n", "list.csv:2: 1 cells: expected 2"},
        {"recording,measured_utc\narchive/SN1,yesterday\n", "measured_utc = 'yesterday'"}}) {
    write("list.csv", list);
    expect_refused("recalibrate list.csv --out x", words);
  }
  expect_refused("recalibrate archive --out x --chunk 2 2", "--chunk 2 2: expected K N");
  expect_refused("recalibrate archive --out x --engine slurm --chunk 0 2", "--engine slurm: makes the chunks itself");
  expect_refused("recalibrate archive --out x --as-version ../evil", "--as-version '../evil'");
  expect_refused("recalibrate archive --out x --chunks 2", "--chunks: expected --engine slurm");
  write("with, comma/recording.tcr", "");
  expect_refused({"recalibrate", path("with, comma"), "--out", path("x"), "--engine", "slurm"}, "without a comma");
  expect_refused("recalibrate nowhere --out x", "nowhere");
  expect_refused("calibrate archive/SN1 --out x --prior archive",
                 "expected trusted calibrations of 10 other units, found 1");
  expect_refused("calibrate archive/SN1 --out x --part P7", "--part: expected --prior");
  expect_refused("fleet diagnose archive/copy", "expected statistics.tcs");
  expect_refused("fleet diagnose archive --by station --by station", "--by station: is given twice");
  ::setenv("PATH", "/nonexistent", 1);
  expect_refused("recalibrate archive --out x --engine slurm", "sbatch is not installed", 50);
}

// Ten other units and the unit itself: the file says what came from them, and is no history for the next.
TEST_F(Archive, IsAPrior) {
  std::filesystem::create_directories(path("earlier"));
  for (int k = 0; k < 11; ++k)
    ends(dry_run("earlier/" + std::to_string(k),
                 {"--rig", write("unit.rig", "seed = " + std::to_string(20 + k) + "\n"), "--no-diagnosis", "--station",
                  station(), "--quiet"},
                 "SN" + std::to_string(20 + k)),
         0);
  const ProgramResult result = ends("calibrate earlier/3 --prior earlier --out earlier/with --verbose", 0);
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
  const ProgramResult again = run("calibrate earlier/4 --prior earlier --out again --verbose");
  EXPECT_SAYS(again.out, "prior: 10 other units, 0 earlier");
}

// What the list says stands in the files; the runs' own statistics do as well. (Both rigs have the same noise: together they would not be explained.)
TEST_F(Archive, IsAFleet) {
  write("list.csv",
        "recording,station,lot,measured_utc\narchive/SN1,east,7,2026-01-31T12:00:00Z\narchive/"
        "SN2,west,8,2026-02-01T12:00:00Z\n");
  ASSERT_EQ(run("recalibrate list.csv --out store --no-diagnosis").code, 0);
  const ProgramResult result = ends("fleet diagnose store --by station --by lot --by month --page fleet.html", 0);
  EXPECT_SAYS(result.out, "2 recordings of 2 units, 2 stations, 2 lots, 2 months; simulated");
  EXPECT_SAYS(file_text(path("fleet.html")), "station");
  const ProgramResult own = ends("fleet diagnose archive/SN1 --format json", 0);
  EXPECT_EQ(own.out.substr(0, 1), "[");
}

// The rows of a station's database: its recordings are an archive, and what they hold is a fleet, the same as in the files.
TEST_F(Archive, IsAResultsDatabase) {
  for (const char* unit : {"SN3", "SN4"})
    ends(dry_run(
             std::string("runs/") + unit,
             {"--lot", std::string("lot ") + unit, "--part", "P7", "--no-diagnosis", "--station", station(), "--quiet"},
             unit),
         0);
  const ProgramResult of_files = run("fleet diagnose runs --format csv");
  const ProgramResult of_rows = ends("fleet diagnose results.db --format csv", of_files.code);
  EXPECT_EQ(of_rows.out, of_files.out);
  const ProgramResult by_all = run("fleet diagnose results.db --by lot --by part --by version --by month");
  EXPECT_SAYS(by_all.out, "2 recordings of 2 units, 2 lots, 1 part, 1 version, 1 month");

  std::filesystem::remove_all(path("runs/SN4"));
  const ProgramResult again = run("recalibrate results.db --no-diagnosis --out store");
  EXPECT_SAYS(again.out, "1 done, 0 already done, 0 cannot be calibrated, 1 cannot be read") << again.out << again.err;
  EXPECT_EQ(run("records copy results.db copy.db").code, 0);
  EXPECT_EQ(run("fleet diagnose copy.db --format csv").out, of_files.out);
}

}  // namespace
}  // namespace turncal
