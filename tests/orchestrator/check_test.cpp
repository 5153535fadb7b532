// `turncal check`: the printed plan, and one line for each reason to refuse.
#include "orchestrator/commands/commands.h"

#include "tests/orchestrator/program.h"
namespace turncal {
namespace {

const std::string tree = TURNCAL_SOURCE_DIR;
const std::string check_station = station_head + "station.name = test\nmotion.settle_s = 0.5\n";
const std::string real_unit = "imu.driver = serial\nimu.frame = laser_gyro\nimu.device = none";
const std::string sequence_text =
    "format = 1\nname = test\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1 \"one turn\"\n  determines n11\n"
    "  initial H 0 P 0 R 0\n  align 12000\n  rotate R +360\n  dwell 20000\n"
    "step 2\n  initial H 0 P 0 R 0\n  align 200\n";

struct Outcome {
  int code = -1;
  std::string out;
  std::vector<std::string> problems;  // the lines of the error stream
};

class Check : public Program {
 protected:
  static Outcome check(const CheckOptions& options) {
    std::ostringstream out, err;
    CommandContext context{.out = out, .err = err};
    if (const Status status = run_check(options, context); !status) context.fail(status.error());
    Outcome outcome{context.exit_code, out.str(), {}};
    for (const std::string& line : lines_of(err.str()))
      outcome.problems.push_back(line.starts_with(error_prefix) ? line.substr(std::string(error_prefix).size()) : line);
    return outcome;
  }
  static Outcome check(const std::string& station, const std::string& sequence) { return check({station, sequence}); }
};

// A line of the plan with its blanks collapsed to one.
bool has_line(const std::string& text, const std::string& wanted) {
  for (const std::string& line : lines_of(text)) {
    std::string collapsed;
    for (const std::string& word : Arguments(line)) collapsed += (collapsed.empty() ? "" : " ") + word;
    if (collapsed == wanted) return true;
  }
  return false;
}

TEST_F(Check, EachViolationIsOneLineAndThePlanIsStillPrinted) {
  const std::string limits = "axis.roll.soft_max_deg = 180\naxis.roll.wrap_deg = 0\naxis.roll.max_rate_degps = 5\n";
  const std::string station = write("my.station", check_station + limits);
  const std::string sequence = write("my.seq", sequence_text);
  const Outcome outcome = check(station, sequence);
  EXPECT_EQ(outcome.code, 1);
  EXPECT_EQ(outcome.problems,
            (std::vector<std::string>{
                sequence + ":9: step 1: roll goes to 360 deg, soft travel is -540 to 180 deg",
                sequence + ":9: step 1: roll turns at 10 deg/s, the most allowed is 5 deg/s (and 1 more)"}));
  EXPECT_TRUE(has_line(outcome.out, "roll 0 to 360 -540 to 180 360 / no limit 720")) << outcome.out;
  EXPECT_TRUE(outcome.out.ends_with("The station cannot run this sequence:\n")) << outcome.out;
}

// The last lines tell what stands against a run, whatever scrolled by above them.
TEST_F(Check, WhatCannotRunYetIsNotCalledRunnable) {
  std::string map = file_text(tree + "/orchestrator/stations/twin.map");
  map.replace(map.find("commissioned = true"), 19, "commissioned = false");
  map.insert(map.find("\n", map.find("write.stop =")), " # [guess]");
  const std::string file = write("my.map", map);
  std::string text = check_station;
  text.replace(text.find("table.driver = mock"), 19,
               "table.driver = modbus\ntable.address = SET-ME:502\ntable.map = " + file);
  text.replace(text.find("imu.driver = rig"), 16, real_unit);
  const Outcome outcome = check(write("my.station", text), write("my.seq", sequence_text));
  EXPECT_EQ(outcome.code, 1);
  EXPECT_TRUE(outcome.out.ends_with("The station cannot run this sequence:\n")) << outcome.out;
  EXPECT_SAYS(outcome.problems.at(0) + outcome.problems.at(1),
              "expected the name of this station's linethe table is not comm");
  EXPECT_SAYS(outcome.problems.back(), "warning: some of these guesses ");
  map.replace(map.find("commissioned = false"), 20, "commissioned = true");
  write("my.map", map);
  text.replace(text.find("SET-ME"), 6, "ttyUSB0");
  const Outcome ready = check(write("my.station", text), write("my.seq", sequence_text));
  EXPECT_EQ(ready.code, 0);
  EXPECT_SAYS(ready.out, "\nThe station can run this sequence");
  EXPECT_SAYS(ready.problems.front() + ready.problems.back(), "write.stop is a guess");
  // What keeps a run from its devices keeps check from calling the station ready.
  std::string one_line = text;
  one_line.replace(one_line.find("ttyUSB0:502"), 11, "/dev/ttyX")
      .replace(one_line.find("device = none"), 13, "device = /dev/ttyX");
  map.replace(map.find("link.kind = tcp"), 15, "link.kind = rtu\nlink.baud = 115200");
  write("my.map", map);
  EXPECT_SAYS(check(write("one.station", one_line), write("my.seq", sequence_text)).problems.at(0),
              "imu.device = '/dev/ttyX': is the line of table.address, too");
  text.replace(text.find("ttyUSB0:502"), 11, "/dev/ttyX");
  text.replace(text.find(real_unit), real_unit.size(), "imu.driver = rig");
  EXPECT_SAYS(check(write("mixed.station", text), write("my.seq", sequence_text)).problems.at(0), "a mock unit (imu");
}

// As a run does; what needs --partial is not verified behind it.
TEST_F(Check, PlansTheNorthSeekingBehindTheCalibration) {
  const std::string sequence = tree + "/sequences/two_axes.seq";
  const std::string narrow = "axis.heading.soft_min_deg = -190\naxis.heading.soft_max_deg = 190\n";
  EXPECT_EQ(check(write("plain.station", check_station + narrow), sequence).code, 0);
  const Outcome outcome = check(write("my.station", check_station + narrow + "verify.run = true\n"), sequence);
  EXPECT_EQ(outcome.code, 1);
  ASSERT_EQ(outcome.problems.size(), 1U);
  EXPECT_TRUE(outcome.problems[0].starts_with("built-in verify.seq:35: step ")) << outcome.problems[0];
  EXPECT_SAYS(outcome.problems[0], "heading goes to 270 deg, soft travel is -190 to 190 deg");
  const std::string verifying = write("wide.station", check_station + "verify.run = true\n");
  EXPECT_SAYS(check(verifying, sequence).out, "two searches");
  const Outcome asked_for =
      check({.station = write("not.station", check_station), .sequence = sequence, .verify = true});
  EXPECT_EQ(asked_for.code, 0);
  EXPECT_SAYS(asked_for.out, "two searches");
  EXPECT_SAYS_NOT(check(verifying, write("my.seq", sequence_text)).out, "two searches");
}

// The table alone, without a sequence; and what is only guessed of it.
TEST_F(Check, ExplainsTheTableAndListsItsGuesses) {
  std::string text = file_text(tree + "/orchestrator/stations/twin.map");
  text.insert(text.find("\n", text.find("write.stop =")), " # [guess]");
  text.insert(text.find("\n", text.find("link.kind =")), " # [guess]");
  const std::string table = write("my.map", text);
  std::string described = check_station;
  described.replace(described.find("table.driver = mock"), 19, "table.driver = modbus\ntable.map = " + table);
  described.replace(described.find("imu.driver = rig"), 16, real_unit);
  const std::string station = write("my.station", described);
  const Outcome explained = check({.station = station, .sequence = "", .explain = true});
  EXPECT_EQ(explained.code, 0);
  EXPECT_SAYS(explained.out, "unit 2, function 6, register 50 (0x0032)");
  ASSERT_EQ(explained.problems.size(), 3U);
  EXPECT_TRUE(explained.problems[1].ends_with(": write.stop is a guess")) << explained.problems[1];
  EXPECT_SAYS(explained.problems.back(), "commission needs --accept-guess");
  const Result<StationConfig> config = good(read_station_config(station));
  EXPECT_EQ(guesses_of(*config, false).size(), 2u);
  EXPECT_EQ(guesses_of(*config, true).size(), 1u);
  const Outcome asked = check(station, "");
  EXPECT_EQ(asked.code, 1);
  EXPECT_SAYS(asked.problems.at(0), "--sequence is required");
}

TEST_F(Check, TheRigFileOfTheStationIsReadToo) {
  const std::string sequence = write("my.seq", sequence_text);
  const std::string station = write("my.station", check_station + "rig.file = my.rig\n");
  for (const char* said : {"my.rig", "my.rig:1: key 'no.such.key'"}) {
    const Outcome refused = check(station, sequence);
    EXPECT_EQ(refused.code, 1);
    ASSERT_EQ(refused.problems.size(), 1U);
    EXPECT_SAYS(refused.problems[0], said);
    write("my.rig", "no.such.key = 1\n");
  }
}

}  // namespace
}  // namespace turncal
