// `turncal check`: the printed plan, and one line for each reason to refuse.
#include "orchestrator/commands/commands.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace turncal {
namespace {

const std::string source = TURNCAL_SOURCE_DIR;
const std::string station_text =
    "format = 1\nstation.name = test\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = mock\n"
    "imu.driver = rig\nmotion.settle_s = 0.5\n";
const std::string sequence_text =
    "format = 1\nname = test\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1 \"one turn\"\n  determines n11\n"
    "  initial H 0 P 0 R 0\n  align 12000\n  rotate R +360\n  dwell 20000\n"
    "step 2\n  initial H 0 P 0 R 0\n  align 200\n";

struct Outcome {
  int code = -1;
  std::string out;
  std::vector<std::string> problems;  // the lines of the error stream
};

class Check : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("turncal_check_" + std::to_string(::getpid()) + "_" +
                                                        testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string file(const std::string& name, const std::string& text) const {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }

  static Outcome check(const std::string& station, const std::string& sequence) {
    std::ostringstream out;
    std::ostringstream err;
    Outcome outcome;
    outcome.code = run_check({station, sequence}, out, err);
    outcome.out = out.str();
    std::istringstream lines(err.str());
    for (std::string line; std::getline(lines, line);) {
      outcome.problems.push_back(line);
    }
    return outcome;
  }

  std::filesystem::path folder_;
};

// A line of the plan with its blanks collapsed to one.
bool has_line(const std::string& text, const std::string& wanted) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string collapsed;
    for (std::string word; words >> word;) {
      collapsed += (collapsed.empty() ? "" : " ") + word;
    }
    if (collapsed == wanted) {
      return true;
    }
  }
  return false;
}

TEST_F(Check, ShippedSequencesRunOnTheShippedStation) {
  struct Shipped {
    const char* name;
    const char* time;
  };
  for (const Shipped& shipped :
       {Shipped{"fourteen_step", "Total time 1:45:42 (6342 s), of which moving 0:13:22 (802 s)"},
        Shipped{"short_demo", "Total time 0:10:09 (609 s), of which moving 0:05:04 (304 s)"},
        Shipped{"extended", "Total time 3:37:21 (13040.6 s), of which moving 0:43:01 (2580.6 s)"}}) {
    for (const std::string& station : {std::string(), source + "/orchestrator/stations/mock.station"}) {
      const Outcome outcome = check(station, source + "/sequences/" + shipped.name + ".seq");
      EXPECT_EQ(outcome.code, 0);
      EXPECT_TRUE(outcome.problems.empty());
      EXPECT_TRUE(has_line(outcome.out, shipped.time)) << outcome.out;
    }
  }
}

TEST_F(Check, LinesFitATerminal) {
  std::istringstream lines(check("", source + "/sequences/extended.seq").out);
  for (std::string line; std::getline(lines, line);) {
    EXPECT_LE(line.size(), 120U) << line;
  }
}

TEST_F(Check, EachViolationIsOneLineAndThePlanIsStillPrinted) {
  const std::string limits = "axis.roll.soft_max_deg = 180\naxis.roll.wrap_deg = 0\naxis.roll.max_rate_degps = 5\n";
  const std::string station = file("my.station", station_text + limits);
  const std::string sequence = file("my.seq", sequence_text);
  const Outcome outcome = check(station, sequence);
  EXPECT_EQ(outcome.code, 1);
  EXPECT_EQ(outcome.problems,
            (std::vector<std::string>{
                sequence + ":9: step 1: roll goes to 360 deg, soft travel is -540 to 180 deg",
                sequence + ":9: step 1: roll turns at 10 deg/s, the most allowed is 5 deg/s (and 1 more)"}));
  EXPECT_TRUE(has_line(outcome.out, "roll 0 to 360 -540 to 180 360 / no limit 720")) << outcome.out;
  EXPECT_TRUE(has_line(outcome.out, "The station cannot run this sequence."));
}

// As a run does; what needs --partial is not verified behind it.
TEST_F(Check, PlansTheNorthSeekingBehindTheCalibration) {
  const std::string sequence = source + "/sequences/two_axes.seq";
  const std::string narrow = "axis.heading.soft_min_deg = -190\naxis.heading.soft_max_deg = 190\n";
  EXPECT_EQ(check(file("plain.station", station_text + narrow), sequence).code, 0);
  const Outcome outcome = check(file("my.station", station_text + narrow + "verify.run = true\n"), sequence);
  EXPECT_EQ(outcome.code, 1);
  ASSERT_EQ(outcome.problems.size(), 1U);
  EXPECT_TRUE(outcome.problems[0].starts_with("built-in verify.seq:35: step ")) << outcome.problems[0];
  EXPECT_NE(outcome.problems[0].find("heading goes to 270 deg, soft travel is -190 to 190 deg"), std::string::npos);
  const std::string verifying = file("wide.station", station_text + "verify.run = true\n");
  EXPECT_NE(check(verifying, sequence).out.find("two searches"), std::string::npos);
  std::ostringstream asked_for, err;
  EXPECT_EQ(
      run_check({.station = file("not.station", station_text), .sequence = sequence, .verify = true}, asked_for, err),
      0);
  EXPECT_NE(asked_for.str().find("two searches"), std::string::npos) << asked_for.str();
  EXPECT_EQ(check(verifying, file("my.seq", sequence_text)).out.find("two searches"), std::string::npos);
}

// The table alone, without a sequence; and what is only guessed of it.
TEST_F(Check, ExplainsTheTableAndListsItsGuesses) {
  std::ifstream read(source + "/orchestrator/stations/twin.map");
  std::stringstream map;
  map << read.rdbuf();
  std::string text = map.str();
  text.insert(text.find("\n", text.find("write.stop =")), " # [guess]");
  text.insert(text.find("\n", text.find("link.kind =")), " # [guess]");
  const std::string table = file("my.map", text);
  std::string described = station_text;
  described.replace(described.find("table.driver = mock"), 19, "table.driver = modbus\ntable.map = " + table);
  const std::string station = file("my.station", described);
  std::ostringstream out, err;
  EXPECT_EQ(run_check({.station = station, .sequence = "", .explain = true}, out, err), 0);
  EXPECT_NE(out.str().find("unit 2, function 6, register 50 (0x0032)"), std::string::npos) << out.str();
  EXPECT_NE(err.str().find(": write.stop is a guess\n"), std::string::npos) << err.str();
  EXPECT_NE(err.str().find("commission needs --accept-guess"), std::string::npos) << err.str();
  const Result<StationConfig> config = read_station_config(station);
  ASSERT_TRUE(config.ok()) << config.error().message;
  EXPECT_EQ(guesses_of(*config, false).size(), 2u);
  EXPECT_EQ(guesses_of(*config, true).size(), 1u);
  std::ostringstream nothing, asked;
  EXPECT_EQ(run_check({.station = station, .sequence = ""}, nothing, asked), 1);
  EXPECT_NE(asked.str().find("--sequence is required"), std::string::npos) << asked.str();
}

TEST_F(Check, BadFilesAreBothNamedAndNothingIsPrinted) {
  const std::string station = file("my.station", station_text + "motion.speed = 1\n");
  const std::string sequence = file("my.seq", "");
  const Outcome outcome = check(station, sequence);
  EXPECT_EQ(outcome.code, 1);
  ASSERT_EQ(outcome.problems.size(), 2U);
  EXPECT_NE(outcome.problems[0].find(station + ":8: key 'motion.speed'"), std::string::npos) << outcome.problems[0];
  EXPECT_NE(outcome.problems[1].find(sequence + ":1:1: found an empty file"), std::string::npos);
  EXPECT_EQ(outcome.out, "");
}

TEST_F(Check, TheRigFileOfTheStationIsReadToo) {
  const std::string sequence = file("my.seq", sequence_text);
  const std::string station = file("my.station", station_text + "rig.file = my.rig\n");
  const Outcome missing = check(station, sequence);
  EXPECT_EQ(missing.code, 1);
  ASSERT_EQ(missing.problems.size(), 1U);
  EXPECT_NE(missing.problems[0].find("my.rig"), std::string::npos);
  file("my.rig", "no.such.key = 1\n");
  const Outcome bad = check(station, sequence);
  EXPECT_EQ(bad.code, 1);
  ASSERT_EQ(bad.problems.size(), 1U);
  EXPECT_NE(bad.problems[0].find("my.rig:1: key 'no.such.key'"), std::string::npos) << bad.problems[0];
}

}  // namespace
}  // namespace turncal
