// An ASCII table that is different in every way: a circle only, other rate scales, numbers of fixed width, a CRC, an echo with another
// line end, an answer of three lines. The contract of every table, and what is special about it.

#include "imu_io/base/clock.h"
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
    const auto pass = [&](double seconds) {  // with a look now and then: a circle tells half a turn at most
      for (double t = 0.0; t < seconds; t += 0.5) {
        s.station.pass(0.5);
        EXPECT_TRUE(s.driver.status(axis).ok());
      }
    };
    pass(6.0);
    const Result<AxisStatus> now = good(s.driver.status(axis));
    EXPECT_NEAR(now->rate_degps, 20.0, 0.1) << to_string(axis);
    pass(20.0);
  }
  for (const Axis axis : all_axes) {
    const Result<AxisStatus> now = good(s.driver.status(axis));
    EXPECT_NEAR(now->position_deg, 400.0, 1e-3) << "more than a turn, of a device that tells less than one";
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

TEST(DialectForms, DefectsAreNamed) {
  const auto expect = [](const std::string& what, const std::string& with, const char* said) {
    EXPECT_TRUE(fails(parse_dialect(replaced(form_text(), what, with), "my.dialect"), said)) << with;
  };
  expect("{distance:12}", "{position:12}", "does not say how many turns");
  expect("axis.pitch.sign = -1", "axis.pitch.sign = -1\naxis.pitch.way = shorter", "not {distance}: way = shorter");
  expect("axis.pitch.modulo_deg = 360", "axis.pitch.way = shorter", "no such key without modulo_deg");
  expect("axis.pitch.sign = -1", "axis.pitch.way = longer", "told or shorter");
  expect("link.crc.polynomial = 0x8005\n", "", "'link.crc.polynomial' is missing");
  expect("link.crc.polynomial = 0x8005", "link.crc.polynomial = 0x18005", "a number of 16 bits");
  expect("link.check = crc16", "link.check = crc32", "none, sum8, xor or crc16");
  expect("link.check = crc16", "link.check = xor", "link.crc.polynomial");
  expect("link.echo_terminator = \\n", "link.echo_terminator =", "at least one character");
  expect("link.echo = true", "link.echo = false", "link.echo_terminator");
  expect("stop.1.expect = OK", "stop.1.expect = OK\\nOK", "a stop waits for no more");
  expect("{axis:1}", "{axis}", "unless they have a width");
  expect("axis.pitch.rate_scale = 60", "axis.pitch.rate_scale = 0", "a number between");
  expect("number.plus = true", "number.plus = yes", "true or false");
  // What a run has to be told must be sayable.
  expect("status.bit.in_position = 2", "status.bit.in_position = 1",
         "a status that can say of an axis that it has arrived");
  expect("status.bit.fault = 5", "status.bit.fault = 0", "a status that can say of an axis that it has arrived");
  expect("status.bit.homed = 3", "status.bit.homed = 0", "on and not homed");
  expect("status.bit.enabled = 0", "status.bit.enabled = 1", "'status.bit.moving'");
  expect("{rate:13}", "1", "{rate} in a sentence of a move");
  expect("{status.roll:4}", "{*:4}", "with {status}, or with {status.heading}");
  expect("{position.roll:12}", "{*:12}", "with {position}, or with {position.heading}");
  expect("axis.roll.name = 3", "axis.roll.name = 3a", "a column that the name of an axis fits: '3a'");
  expect("error.texts = ERR", "error.texts = ERR, 2", "texts that no number holds");
  expect("link.terminator_in = \\r\\n", "link.terminator_in = 0", "a text that no number holds");
  expect("error.texts = ERR", "error.texts = K", "an answer without 'K'");
  expect("axis.heading.units_per_degree = 10", "axis.heading.units_per_degree = 1e-9",
         "a number between 1e-06 and 1000000000");
  expect("axis.pitch.modulo_deg = 360", "axis.pitch.modulo_deg = 5", "0, or a circle of 90 to 3600 deg");
  expect("link.quiet_s = 0.1", "link.quiet_s = 1e-9", "a number between 0.001 and 60");
}

TEST(DialectForms, ADoneBitMayBeBothArrivedAndAtRest) {
  const std::string text =
      replaced(form_text(), "status.bit.moving = 1", "status.bit.moving = 2\nstatus.active_low = moving");
  EXPECT_OK(parse_dialect(text, "my.dialect"));
}

// A code for each state: none may be missing.
TEST(DialectForms, CodesSayEveryState) {
  const auto with = [](const std::string& codes) {
    std::string text = form_text();
    text.erase(text.find("status.kind"));
    const Result<Dialect> dialect = parse_dialect(text + "status.kind = codes\n" + codes, "my.dialect");
    return dialect.ok() ? "" : dialect.error().message;
  };
  EXPECT_EQ(with("status.code.0 = in_position\nstatus.code.1 = moving\n"), "");
  EXPECT_EQ(with("status.code.0 = none\nstatus.code.1 = in_position, enabled\nstatus.code.2 = moving, enabled\n"), "");
  EXPECT_SAYS(with("status.code.0 = in_position, moving\n"), "has arrived");
  EXPECT_SAYS(with("status.code.1 = in_position, enabled\nstatus.code.2 = moving\n"), "that it moves");
  EXPECT_SAYS(with("status.code.1 = in_position, enabled\nstatus.code.2 = moving, enabled\n"), "off and at rest");
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

std::string error_with(const std::string& more) {
  const Result<Dialect> dialect = parse_dialect(plain_text(more), "my.dialect");
  return dialect ? "accepted" : dialect.error().message;
}

void refused_with(const std::string& more, const std::string& said) { EXPECT_SAYS(error_with(more), said) << more; }

TEST(SentenceClash, AStopThatCannotStopIsRefused) {
  refused_with("abort.2 = HALT {axis}", "'abort.2'");
  EXPECT_EQ(error_with("abort.2 = ERR?\nstop.2 = ERR?"), "accepted") << "a question commands nothing";
  for (const char* const line : {"home.1 = HOME", "stop.1 = HALT", "abort.1 = OFF"}) {
    const std::string operation = std::string(line).substr(0, std::string(line).find('.'));
    const std::string said = error_with(line);
    EXPECT_SAYS(said, "expected {axis} in a sentence, or " + operation + ".scope = table");
    EXPECT_EQ(error_with(std::string(line) + "\n" + operation + ".scope = table"), "accepted") << line;
  }
}

TEST(SentenceClash, WhatWouldMoveUnderAnotherNameIsRefused) {
  EXPECT_EQ(error_with(""), "accepted") << "a reset and a question are in several lists";
  for (const char* const number : {"01", "+1", "1.0", "1.", "+01.00"})
    EXPECT_SAYS(error_with(std::string("prepare.2 = SERVO {axis} ") + number), "which is enable") << number;
  for (const char* const other : {"1.5", "-1", "10", "0.1"})
    EXPECT_EQ(error_with(std::string("prepare.2 = SERVO {axis} ") + other), "accepted") << other;
  refused_with("move.2 = GOTO {axis} 5", "either {position} or {distance}");
  EXPECT_EQ(error_with("prepare.2 = SERVO {axis} 1"),
            "my.dialect:24: key 'prepare.2' = 'SERVO {axis} 1': expected no 'SERVO 1 1', which is enable of "
            "axis.heading: it would switch the drive on; send it in enable alone");
  for (const char* const key : {"prepare.2", "identify.1", "status.2", "stop.2", "abort.2", "clear_fault.2"}) {
    for (const auto& [sentence, starts] :
         {std::pair("SERVO {axis} 1", "which is enable"), std::pair("SERVO 3 1", "which is enable"),
          std::pair("VERBOSE 1; SERVO 2 1 ;ECHO 0", "which is enable"), std::pair("HOME {axis}", "which is home"),
          std::pair("RUN 2", "which is move"), std::pair("GOTO {axis} 0", "which is move"),
          std::pair("GOTO 2 -12.5;RUN 9", "which is move")}) {
      const std::string said = error_with(std::string(key) + " = " + sentence);
      EXPECT_SAYS(said, starts) << key << " " << sentence << ": ";
      EXPECT_SAYS(said, std::string("'") + key + "'");
    }
  }
  // As controllers read it: blanks, capitals, leading zeros.
  for (const char* const same : {"SERVO  {axis} 1", "servo {axis} 1", "SERVO {axis} 01", "run 2", "GOTO 2  5"})
    EXPECT_SAYS(error_with(std::string("prepare.2 = ") + same), ", which is ") << same;
  // Where to go is known to a move only.
  refused_with("stop.1 = FETCH {axis} {position}", "'stop.1'");
  refused_with("status.2 = {distance}?", "'status.2'");
  // What only resembles it.
  for (const char* const other : {"SERVO {axis} 0", "SERVO {axis} 10", "HOME? {axis}", "VEL {axis} 5", "RUN 9"})
    EXPECT_EQ(error_with(std::string("prepare.2 = ") + other), "accepted") << other;
}

TEST(SentenceClash, AxesThatOneMoveWouldMoveAreRefused) {
  refused_with("axis.roll.name = 2", "'axis.roll.name' = '2': expected a name of its own, not that of axis.pitch");
  refused_with("axis.roll.name = 02", "'axis.roll.name'");
  EXPECT_EQ(
      error_with("axis.roll.name = 2\nmove.2 = GOTO {position.heading} {position.pitch} {position.roll}\nmove.3 = RUN"),
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
