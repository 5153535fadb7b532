// Dialects whose sentences do more than they are called, and a table that was not commissioned.
#include <gtest/gtest.h>

#include <sstream>

#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

// Commands of three kinds: a word and the axis, several in one sentence, a target as text.
std::string plain_text(const std::string& more) {
  std::string text =
      "format = 1\nname = plain\nlink.kind = serial\naxis.heading.name = 1\naxis.pitch.name = 2\naxis.roll.name = 3\n"
      "prepare.1 = VERBOSE 0\nenable.1 = RESET {axis}\nenable.2 = SERVO {axis} 1\nenable.3 = ERR?\nenable.3.expect = "
      "0\n"
      "home.1 = HOME {axis}\nmove.1 = VEL {axis} {rate};ACC {axis} {acceleration}\nmove.2 = GOTO {axis} {position}\n"
      "move.3 = RUN {axis}\nstatus.1 = WHERE? {axis}\nstatus.1.expect = {position} {status}\nstop.1 = HALT {axis}\n"
      "abort.1 = SERVO {axis} 0\nclear_fault.1 = RESET {axis};ERR?\n"
      "status.kind = codes\nstatus.code.0 = in_position\nstatus.code.1 = moving\n";
  std::istringstream lines(more);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t old = text.find("\n" + line.substr(0, line.find('=') + 1));
    if (old != std::string::npos) text.erase(old, text.find('\n', old + 1) - old);
    text += line + "\n";
  }
  return text;
}

std::string error_of(const std::string& more) {
  const Result<Dialect> dialect = parse_dialect(plain_text(more), "my.dialect");
  return dialect ? "accepted" : dialect.error().message;
}

TEST(SentenceClash, AStopThatCannotStopIsRefused) {
  EXPECT_NE(error_of("abort.2 = HALT {axis}").find("'abort.2'"), std::string::npos)
      << error_of("abort.2 = HALT {axis}");
  EXPECT_EQ(error_of("abort.2 = ERR?\nstop.2 = ERR?"), "accepted") << "a question commands nothing";
  for (const char* const line : {"home.1 = HOME", "stop.1 = HALT", "abort.1 = OFF"}) {
    const std::string operation = std::string(line).substr(0, std::string(line).find('.'));
    const std::string said = error_of(line);
    EXPECT_NE(said.find("expected {axis} in a sentence, or " + operation + ".scope = table"), std::string::npos)
        << said;
    EXPECT_EQ(error_of(std::string(line) + "\n" + operation + ".scope = table"), "accepted") << line;
  }
}

TEST(SentenceClash, WhatWouldMoveUnderAnotherNameIsRefused) {
  EXPECT_EQ(error_of(""), "accepted") << "a reset and a question are in several lists";
  for (const char* const number : {"01", "+1", "1.0", "1.", "+01.00"})
    EXPECT_NE(error_of(std::string("prepare.2 = SERVO {axis} ") + number).find("which is enable"), std::string::npos)
        << number;
  for (const char* const other : {"1.5", "-1", "10", "0.1"})
    EXPECT_EQ(error_of(std::string("prepare.2 = SERVO {axis} ") + other), "accepted") << other;
  EXPECT_NE(error_of("move.2 = GOTO {axis} 5").find("either {position} or {distance}"), std::string::npos);
  EXPECT_EQ(error_of("prepare.2 = SERVO {axis} 1"),
            "my.dialect:24: key 'prepare.2' = 'SERVO {axis} 1': expected no 'SERVO 1 1', which is enable of "
            "axis.heading: it would switch the drive on; send it in enable alone");
  for (const char* const key : {"prepare.2", "identify.1", "status.2", "stop.2", "abort.2", "clear_fault.2"}) {
    for (const auto& [sentence, starts] :
         {std::pair("SERVO {axis} 1", "which is enable"), std::pair("SERVO 3 1", "which is enable"),
          std::pair("VERBOSE 1; SERVO 2 1 ;ECHO 0", "which is enable"), std::pair("HOME {axis}", "which is home"),
          std::pair("RUN 2", "which is move"), std::pair("GOTO {axis} 0", "which is move"),
          std::pair("GOTO 2 -12.5;RUN 9", "which is move")}) {
      const std::string said = error_of(std::string(key) + " = " + sentence);
      EXPECT_NE(said.find(starts), std::string::npos) << key << " " << sentence << ": " << said;
      EXPECT_NE(said.find(std::string("'") + key + "'"), std::string::npos) << said;
    }
  }
  // As controllers read it: blanks, capitals, leading zeros.
  for (const char* const same : {"SERVO  {axis} 1", "servo {axis} 1", "SERVO {axis} 01", "run 2", "GOTO 2  5"})
    EXPECT_NE(error_of(std::string("prepare.2 = ") + same).find(", which is "), std::string::npos) << same;
  // Where to go is known to a move only.
  EXPECT_NE(error_of("stop.1 = FETCH {axis} {position}").find("'stop.1'"), std::string::npos);
  EXPECT_NE(error_of("status.2 = {distance}?").find("'status.2'"), std::string::npos);
  // What only resembles it.
  for (const char* const other : {"SERVO {axis} 0", "SERVO {axis} 10", "HOME? {axis}", "VEL {axis} 5", "RUN 9"})
    EXPECT_EQ(error_of(std::string("prepare.2 = ") + other), "accepted") << other;
}

TEST(SentenceClash, AxesThatOneMoveWouldMoveAreRefused) {
  EXPECT_NE(
      error_of("axis.roll.name = 2").find("'axis.roll.name' = '2': expected a name of its own, not that of axis.pitch"),
      std::string::npos)
      << error_of("axis.roll.name = 2");
  EXPECT_NE(error_of("axis.roll.name = 02").find("'axis.roll.name'"), std::string::npos);
  EXPECT_EQ(
      error_of("axis.roll.name = 2\nmove.2 = GOTO {position.heading} {position.pitch} {position.roll}\nmove.3 = RUN"),
      "accepted")
      << "one sentence tells each axis its own place";
}

TEST(Dialect, NothingIsSwitchedOnBeforeItIsCommissioned) {
  for (const char* const name : {"three_axis_dollar", "acutronic_acl", "newport_esp30x", "pi_gcs2"}) {
    Dialect dialect = shipped_dialect(name);
    dialect.commissioned = false;
    DialectStation station(dialect);
    std::vector<std::string> sent;
    station.disturb([&](const std::string& sentence, AnswerPlan&) { sent.push_back(sentence); });
    SerialTurntable driver(station.described, station.clock);
    ASSERT_TRUE(driver.connect().ok()) << name;
    sent.clear();
    for (const Status& refused : {driver.enable(), driver.home(), driver.move_absolute(Axis::pitch, 5.0, 1.0, 1.0)}) {
      ASSERT_FALSE(refused.ok()) << name;
      EXPECT_EQ(refused.error().kind, ErrorKind::input) << name;
      EXPECT_NE(refused.error().message.find("not commissioned"), std::string::npos) << refused.error().message;
    }
    EXPECT_TRUE(sent.empty()) << name << ": " << sent.front();
  }
}

}  // namespace
}  // namespace turncal
