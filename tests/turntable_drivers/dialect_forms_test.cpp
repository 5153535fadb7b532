// An ASCII table that is different in every way: a circle only, other rate scales, numbers of fixed width, a CRC, an echo with another
// line end, an answer of three lines. The contract of every table, and what is special about it.

#include "imu_io/base/clock.h"
#include "tests/said.h"
#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/table_contract.h"

namespace turncal {
namespace {

std::string form_text() {
  return read_whole_file(TURNCAL_SOURCE_DIR "/tests/turntable_drivers/dialects/own_columns.dialect").value();
}

Dialect form_dialect() { return expect_value(parse_dialect(form_text(), "form.dialect")); }

template <Dialect (*dialect)()>
struct CircleFactory : DescribedFactory<DialectStation> {
  CircleFactory() : DescribedFactory(dialect()) {}
};
using FormFactory = CircleFactory<form_dialect>;
INSTANTIATE_TYPED_TEST_SUITE_P(DialectForms, TableContract, FormFactory);

// The same, told positions of its circle, to which it goes the shorter way.
Dialect shorter_dialect() {
  const std::string ways = "axis.heading.way = shorter\naxis.pitch.way = shorter\naxis.roll.way = shorter\n";
  return expect_value(parse_dialect(replaced(form_text(), "{distance:12}", "{position:12}") + ways, "shorter.dialect"));
}

using ShorterFactory = CircleFactory<shorter_dialect>;
INSTANTIATE_TYPED_TEST_SUITE_P(DialectShorterWay, TableContract, ShorterFactory);

using FormTable = FaultTable<DialectStation>;

TEST(DialectForms, RatesAndPositionsHaveTheirScales) {
  FormTable s(form_dialect());
  EXPECT_EQ(s.expect_truth(3), 9);
  s.make_ready();
  std::string move;
  s.station.disturb([&move](const std::string& body, AnswerPlan&) {
    if (body.starts_with("MV")) move = body;
  });
  for (const Axis axis : all_axes) {
    ASSERT_TRUE(s.driver.move_absolute(axis, 400.0, 20.0, 50.0).ok());
    const char* const expected[] = {"MV1+004000.0000+0000200.0000+0000500.0000",
                                    "MV2-000400.0000+0001200.0000+0000050.0000",
                                    "MV3+000400.0000+0000020.0000+0000005.0000"};
    EXPECT_EQ(move, expected[index(axis)]);
    for (double t = 0.0; t < 26.0; t += 0.5) {  // with a look now and then: a circle tells half a turn at most
      s.station.pass(0.5);
      const AxisStatus now = expect_value(s.driver.status(axis));
      EXPECT_TRUE(t != 6.0 || std::abs(now.rate_degps - 20.0) < 0.1) << to_string(axis);
    }
    EXPECT_NEAR(s.driver.status(axis)->position_deg, 400.0, 1e-3) << "more than a turn, of a device that tells less";
  }
}

TEST(DialectForms, ACircleIsGoneInLegsTheShorterWay) {
  FormTable s(shorter_dialect());
  s.make_ready();
  std::vector<std::string> moves;
  s.station.disturb([&moves](const std::string& body, AnswerPlan&) {
    if (body.starts_with("MV")) moves.push_back(body.substr(0, 15));
  });
  const auto go = [&](Axis axis, double to_deg, double seconds) {
    moves.clear();
    EXPECT_TRUE(s.driver.move_absolute(axis, to_deg, 40.0, 100.0).ok());
    for (double t = 0.0; t < seconds; t += 0.25) {
      s.station.pass(0.25);
      const Result<AxisStatus> now = s.driver.status(axis);
      EXPECT_OK(now);
      const bool there = std::abs(now->position_deg - to_deg) < 1e-3;
      EXPECT_FALSE(now->in_position && !now->moving && !there) << "between two legs, at " << now->position_deg;
      if (now->in_position && !now->moving) return there;
    }
    return false;
  };
  using Texts = std::vector<std::string>;
  EXPECT_TRUE(go(Axis::heading, 390.0, 20.0));
  EXPECT_EQ(moves, (Texts{"MV1+001300.0000", "MV1+002600.0000", "MV1+000300.0000"})) << "3 legs of 130 deg";
  EXPECT_TRUE(go(Axis::heading, 30.0, 20.0)) << "and back by more than a turn";
  EXPECT_EQ(moves.size(), 3U);
  EXPECT_TRUE(go(Axis::pitch, -10.0, 5.0)) << "one leg";
  EXPECT_EQ(moves, Texts{"MV2+000010.0000"}) << "sign -1";
  EXPECT_TRUE(go(Axis::roll, 12.5 + 359.99999, 20.0));
  EXPECT_EQ(moves.back(), "MV3+000000.0000") << "what rounds to a whole turn is 0";
  // A stop ends the way: no leg is sent any more.
  moves.clear();
  ASSERT_TRUE(s.driver.move_absolute(Axis::heading, -330.0, 40.0, 100.0).ok());
  s.station.pass(1.0);
  ASSERT_TRUE(s.driver.stop_all().ok());
  for (int i = 0; i < 20; ++i) {
    s.station.pass(0.25);
    EXPECT_TRUE(s.driver.status(Axis::heading).ok());
  }
  EXPECT_EQ(moves.size(), 1U);
  EXPECT_FALSE(s.driver.status(Axis::heading)->moving);
}

// Each fault in one of the three lines, or in the echo: read again, never believed.
TEST(DialectForms, DamageIsNoticed) {
  const auto with = [](std::function<void(std::string&)> change) {
    Dialect dialect = form_dialect();
    dialect.link.reply_timeout_s = 0.5;  // a busy machine is no silent table
    FormTable s(dialect);
    s.station.disturb([change](const std::string& body, AnswerPlan& plan) {
      if (body != "ST") return;
      std::string text(plan.pieces[0].bytes.begin(), plan.pieces[0].bytes.end());
      change(text);
      plan.pieces[0].bytes.assign(text.begin(), text.end());
    });
    const int read = s.expect_truth(1);
    return std::to_string(read) + " " + s.last_error.message;
  };
  EXPECT_SAYS(with([](std::string& text) { text[text.find("P+") + 5] ^= 1; }), "checksum");
  EXPECT_SAYS(with([](std::string& text) { text[text.find("\n") - 1] = '!'; }), "echo");
  EXPECT_SAYS(with([](std::string& text) { text.erase(text.find(":R")); }), "no answer within");
  EXPECT_SAYS(with([](std::string& text) { text += ":R\r\n"; }), "more after it");
  EXPECT_SAYS(with([](std::string& text) {
                const std::size_t pitch = text.find(":P"), roll = text.find(":R");
                text = text.substr(0, pitch) + text.substr(roll) + text.substr(pitch, roll - pitch);
              }),
              "expected 'H");
  EXPECT_EQ(with([](std::string&) {}), "3 ");
}

TEST(DialectForms, WidthsAndChecks) {
  CrcParameters modbus{16, 0x8005, 0xFFFF, true, true, 0};
  EXPECT_EQ(check_digits("123456789", SentenceCheck::crc16, modbus), "4B37");
  EXPECT_EQ(check_digits("123456789", SentenceCheck::crc16, {16, 0x1021, 0, false, false, 0}), "31C3");
  const auto columns = SentenceTemplate::parse("A{position:8}{rate:6}");
  ASSERT_TRUE(columns);
  const auto filled = [&](const std::string& position, const std::string& rate) {
    return columns->fill([&](const std::string& name) { return name == "rate" ? rate : position; });
  };
  EXPECT_EQ(filled("-1.5", "2"), "A-00001.5000002");
  EXPECT_EQ(filled("x", "+2.0"), "A       x+002.0");
  const auto values = columns->match("A   -1.5+002.0");
  ASSERT_TRUE(columns->match("A    -1.5+002.0"));
  EXPECT_FALSE(values) << "a column short";
  EXPECT_EQ(columns->match("A    -1.5+002.0")->at("position"), "-1.5");
  EXPECT_FALSE(columns->match(filled("-123456.7", "2"))) << "a number that is too wide must not pass";
  EXPECT_FALSE(columns->match("A            2.0")) << "no value";
  for (const char* const bad : {"{a:0}", "{a:65}", "{a:x}", "{:4}", "{a}{b:4}", "{a:}"})
    EXPECT_FALSE(SentenceTemplate::parse(bad)) << bad;
  EXPECT_EQ(SentenceTemplate::parse("{a:4}\n{b}")->lines(), 2);
}

// Sentences, columns and decimals that cannot tell or show a move, said before one is made.
TEST(DialectForms, AMoveIsToldAndShownToTheTolerance) {
  const auto said = [](const std::string& what, const std::string& with, double rate_degps = 20.0,
                       double distance_deg = 22.5) {
    const Dialect dialect = expect_value(parse_dialect(replaced(form_text(), what, with), "my.dialect"));
    Moves moves;
    moves[0] = {distance_deg, distance_deg, rate_degps, 50.0};
    const Status status = check_move(dialect, Axis::heading, moves, 0.01);
    return status ? "" : status.error().message;
  };
  const std::string scale = "axis.heading.units_per_degree = 10";
  EXPECT_EQ(said("", ""), "");
  EXPECT_EQ(said("number.decimals = 4", "number.decimals = 0"), "") << "225 units";
  EXPECT_SAYS(said("number.decimals = 4", "number.decimals = 0", 20.0, 22.55),
              "number.decimals = 0: tells 225.5 as 226");
  EXPECT_SAYS(
      said(scale,
           "axis.heading.units_per_degree = 0.0001\naxis.heading.rate_scale = 1\naxis.heading.acceleration_scale = 1"),
      "expected an angle told to motion.position_tolerance_deg");
  EXPECT_SAYS(said("", "", 1e-6), "number.decimals or a scale with which the rate");
  EXPECT_SAYS(said("{distance:12}", "{distance:4}"), "numbers that fit");
  EXPECT_SAYS(said("{position.heading:12}", "{position.heading:3}"), "cannot show");
  EXPECT_SAYS(said("{position.heading:12}", "{position.heading:6}"), "cannot show");
}

// ---- dialects whose sentences do more than they are called, and a table that was not commissioned ----

// Commands of three kinds: a word and the axis, several in one sentence, a target as text.
const std::string plain =
    "format = 1\nname = plain\nlink.kind = serial\naxis.heading.name = 1\naxis.pitch.name = 2\naxis.roll.name = 3\n"
    "prepare.1 = VERBOSE 0\nenable.1 = RESET {axis}\nenable.2 = SERVO {axis} 1\nenable.3 = ERR?\nenable.3.expect = 0\n"
    "home.1 = HOME {axis}\nmove.1 = VEL {axis} {rate};ACC {axis} {acceleration}\nmove.2 = GOTO {axis} {position}\n"
    "move.3 = RUN {axis}\nstatus.1 = WHERE? {axis}\nstatus.1.expect = {position} {status}\nstop.1 = HALT {axis}\n"
    "abort.1 = SERVO {axis} 0\nclear_fault.1 = RESET {axis};ERR?\n"
    "status.kind = codes\nstatus.code.0 = in_position\nstatus.code.1 = moving\n";
const std::string minimal =
    "format = 1\nname = x\nlink.kind = serial\naxis.heading.name = 1\naxis.pitch.name = 2\naxis.roll.name = 3\n"
    "home.1 = H {axis}\nmove.1 = M {axis} {position} {rate}\nstatus.1 = S {axis}\nstatus.1.expect = {position} "
    "{status}\n"
    "stop.1 = X {axis}\nabort.1 = O {axis}\nstatus.kind = codes\nstatus.code.1 = in_position\nstatus.code.0 = none\n";

// What could not work, cannot say what a run has to be told, could not stop, or would move under another name; and what only resembles it.
TEST(DialectForms, EveryDefectIsNamedInOneLine) {
  const std::string form = form_text();
  const std::map<std::string, std::string> texts = {
      {"plain", plain},
      {"minimal", minimal},
      {"own_columns", form},
      {"codes", form.substr(0, form.find("status.kind")) + "status.kind = codes\n"}};
  expect_said("turntable_drivers/dialects.said", [&](const std::string& name, const std::string& what,
                                                     const std::string& with) {
    const std::string& text = texts.at(name);
    return said_of(parse_dialect(what.empty() ? with_keys(text, with) : replaced(text, what, with), "my.dialect"));
  });
}

TEST(SentenceClash, WhatWouldMoveUnderAnotherNameIsRefusedWhereverItStands) {
  for (const std::string key : {"prepare.2", "identify.1", "status.2", "stop.2", "abort.2", "clear_fault.2"}) {
    for (const auto& [sentence, starts] :
         {std::pair("SERVO {axis} 1", "which is enable"), std::pair("SERVO 3 1", "which is enable"),
          std::pair("VERBOSE 1; SERVO 2 1 ;ECHO 0", "which is enable"), std::pair("HOME {axis}", "which is home"),
          std::pair("RUN 2", "which is move"), std::pair("GOTO {axis} 0", "which is move"),
          std::pair("GOTO 2 -12.5;RUN 9", "which is move")}) {
      const std::string said = said_of(parse_dialect(with_keys(plain, key + " = " + sentence), "my.dialect"));
      EXPECT_SAYS(said, starts) << key << " " << sentence << ": ";
      EXPECT_SAYS(said, "'" + key + "'");
    }
  }
}

TEST(Dialect, NothingIsSwitchedOnBeforeItIsCommissioned) {
  for (const char* const name : {"three_axis_dollar", "acutronic_acl", "newport_esp30x", "pi_gcs2"}) {
    Dialect dialect = shipped_dialect(name);
    dialect.commissioned = false;
    DialectStation station(dialect);
    std::vector<std::string> sent;
    station.disturb([&](const std::string& sentence, AnswerPlan&) { sent.push_back(sentence); });
    DescribedTurntable driver(station.described, station.clock);
    ASSERT_TRUE(driver.connect().ok()) << name;
    sent.clear();
    for (const Status& refused_with :
         {driver.enable(), driver.home(), driver.move_absolute(Axis::pitch, 5.0, 1.0, 1.0)})
      ASSERT_TRUE(fails(refused_with, ErrorKind::input, "not commissioned")) << name;
    EXPECT_TRUE(sent.empty()) << name << ": " << sent.front();
  }
}

// ---- dialect faults ----

// Faults of an ASCII line, each injected at the twin: the right position or an error, never a garbled number, never another axis's.
// Stops: stop_states_test.cpp.

void set_text(AnswerPiece& piece, const std::string& text) { piece.bytes.assign(text.begin(), text.end()); }
std::string framed_dollar(const std::string& body) {
  return "$" + body + "*" + check_digits(body, SentenceCheck::sum8) + "\r\n";
}

// A drive that somebody switched off in mid-run: the others are told to stop, it is told to stay off.
TEST(DialectFaults, AStopDoesNotSwitchOnADriveThatReadsOff) {
  TextTable s("own_bits", true);
  std::vector<std::string> sent;
  s.station.disturb([&](const std::string& body, AnswerPlan& plan) {
    if (body.find('?') == std::string::npos) sent.push_back(body);
    if (body == ":STAT:AXIS? 3") set_text(plan.pieces[0], "130\n");  // all but the lowest bit, which is the drive's
  });
  ASSERT_TRUE(s.driver.enable().ok());
  for (const Axis axis : all_axes) {
    const Result<AxisStatus> status = good(s.driver.status(axis));
    EXPECT_EQ(status->drive_on, axis != Axis::roll);
  }
  ASSERT_TRUE(s.driver.stop_all().ok());
  ASSERT_TRUE(s.driver.status(Axis::heading).ok()) << "an answer: all before it was heard";
  s.station.disturb({});
  ASSERT_GE(sent.size(), 3u);
  EXPECT_EQ(std::vector<std::string>(sent.end() - 3, sent.end()),
            (std::vector<std::string>{":MODE:OFF 1", ":MODE:OFF 2", ":INT:OPEN 3"}));
}

// A number that is none, under a right checksum: never 0.
TEST(DialectFaults, GarbledNumberUnderAGoodChecksum) {
  for (const char* const bad : {"nan", "inf", "12.3.4", "1e999", "--5", "0x10", "-"}) {
    TextTable s("own_dollar");
    s.station.disturb([&](const std::string& body, AnswerPlan& plan) {
      if (body == "MNSTS,1")
        set_text(plan.pieces[0], framed_dollar(std::string("ASSTS,") + bad + ",0,1,30,0,1,-50,0,1"));
    });
    ASSERT_TRUE(fails(s.driver.status(Axis::heading), "expected a number")) << bad;
  }
}

TEST(DialectFaults, UnknownStatusIsNotArrived) {
  TextTable s("newport_esp30x");
  s.make_ready();
  EXPECT_TRUE(s.driver.status(Axis::pitch)->in_position);
  s.station.disturb([](const std::string& body, AnswerPlan& plan) {
    if (body.ends_with("MD?")) set_text(plan.pieces[0], "7\r\n");
  });
  const Result<AxisStatus> now = good(s.driver.status(Axis::pitch));
  EXPECT_FALSE(now->in_position);
  EXPECT_TRUE(now->moving);
  EXPECT_FALSE(now->enabled);
  EXPECT_EQ(now->text, "unknown status");
}

// Answers of another axis: a dialect that names the axis notices; one that does not is protected by what was read before.
TEST(DialectFaults, AnotherAxisAnswers) {
  TextTable s("pi_gcs2");
  s.station.disturb([](const std::string& body, AnswerPlan& plan) {
    if (body == "POS? 1") set_text(plan.pieces[0], "2=30.0000\n");
  });
  ASSERT_TRUE(fails(s.driver.status(Axis::heading), "axis '2' answered"));
}

TEST(DialectFaults, DeviceSaysNo) {
  TextTable s("own_prompt");
  s.make_ready();
  const Status refused = s.driver.move_absolute(Axis::pitch, 3700.0, 10.0, 10.0);  // beyond the mock's travel
  ASSERT_TRUE(fails(refused, "the device says '?'"));
  EXPECT_TRUE(fails(refused, "it stands"));
}

TEST(DialectFaults, FiveSecondsOfSilence) {
  TextTable s("newport_esp30x");
  s.set_off(2.0);
  const Deadline silent(5.0);
  s.station.disturb([&](const std::string&, AnswerPlan& plan) {
    if (!silent.passed()) plan.pieces.clear();
  });
  ASSERT_TRUE(fails(s.driver.status(Axis::roll), ErrorKind::device));
  EXPECT_FALSE(silent.passed()) << "given up at its own deadline";
  EXPECT_TRUE(fails(s.driver.status(Axis::roll), "link lost"));
  EXPECT_TRUE(s.driver.stop_all().ok()) << "but a stop goes out";
  ::usleep(unsigned(1e6 * silent.left_s()));
  s.station.pass(2.0);
  EXPECT_EQ(s.station.fastest_axis_degps(), 0.0);
  EXPECT_FALSE(s.driver.status(Axis::roll).ok()) << "it does not come back by itself";
  ASSERT_TRUE(s.driver.connect().ok());
  EXPECT_FALSE(s.driver.status(Axis::roll)->enabled);
}

}  // namespace
}  // namespace turncal
