// An ASCII table that is different in every way: a circle only, other rate scales, numbers of fixed width, a CRC, an echo with another
// line end, an answer of three lines. The contract of every table, and what is special about it.
#include <gtest/gtest.h>

#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/table_contract.h"

namespace turncal {
namespace {

std::string form_text() {
  return "format = 1\nname = fixed columns\ncommissioned = true\nlink.kind = serial\nlink.quiet_s = 0.1\n"
         "link.terminator_out = \\r\nlink.terminator_in = \\r\\n\nlink.echo = true\nlink.echo_terminator = "
         "\\n\nlink.prefix = :\n"
         "link.check = crc16\nlink.check_mark = /\nlink.crc.polynomial = 0x8005\nlink.crc.initial = 0xFFFF\n"
         "link.crc.reflect_input = true\nlink.crc.reflect_output = true\n"
         "axis.heading.name = 1\naxis.pitch.name = 2\naxis.roll.name = 3\n"
         "axis.heading.modulo_deg = 360\naxis.pitch.modulo_deg = 360\naxis.roll.modulo_deg = 360\n"
         "axis.heading.units_per_degree = 10\naxis.pitch.sign = -1\naxis.roll.zero_deg = 12.5\n"
         "axis.pitch.rate_scale = 60\naxis.roll.measured_rate_scale = 3600\naxis.roll.acceleration_scale = 0.1\n"
         "number.decimals = 4\nnumber.plus = true\n"
         "enable.scope = table\nenable.1 = EN1\nenable.1.expect = OK\n"
         "home.scope = table\nhome.1 = HM\nhome.1.expect = OK\n"
         "move.1 = MV{axis:1}{distance:12}{rate:13}{acceleration:13}\nmove.1.expect = OK\n"
         "status.scope = table\nstatus.1 = ST\n"
         "status.1.expect = "
         "H{position.heading:12}{rate.heading:14}{status.heading:4}\\nP{position.pitch:12}{rate.pitch:14}"
         "{status.pitch:4}\\nR{position.roll:12}{rate.roll:14}{status.roll:4}\n"
         "stop.scope = table\nstop.1 = SP\nstop.1.expect = OK\nabort.scope = table\nabort.1 = AB\nabort.1.expect = OK\n"
         "error.texts = ERR\nstatus.kind = bits\nstatus.base = 16\nstatus.bit.enabled = 0\nstatus.bit.moving = 1\n"
         "status.bit.in_position = 2\nstatus.bit.homed = 3\nstatus.bit.fault = 5\nstatus.bit.emergency_stop = 6\n";
}

Dialect parsed(const std::string& text, const std::string& name) {
  const Result<Dialect> dialect = parse_dialect(text, name);
  EXPECT_TRUE(dialect.ok()) << (dialect.ok() ? "" : dialect.error().message);
  return dialect.ok() ? *dialect : Dialect();
}
Dialect form_dialect() { return parsed(form_text(), "form.dialect"); }

template <Dialect (*dialect)()>
struct CircleFactory {
  DialectStation station{dialect()};
  SerialTurntable driver{station.described, station.clock};
  Turntable& table() { return driver; }
  void pass(double seconds) { station.pass(seconds); }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 7201.0;
  static constexpr bool must_home = true, must_enable = true;
};
using FormFactory = CircleFactory<form_dialect>;
INSTANTIATE_TYPED_TEST_SUITE_P(DialectForms, TableContract, FormFactory);

// The same, told positions of its circle, to which it goes the shorter way.
Dialect shorter_dialect() {
  std::string text = form_text() + "axis.heading.way = shorter\naxis.pitch.way = shorter\naxis.roll.way = shorter\n";
  text.replace(text.find("{distance:12}"), 13, "{position:12}");
  return parsed(text, "shorter.dialect");
}

using ShorterFactory = CircleFactory<shorter_dialect>;
INSTANTIATE_TYPED_TEST_SUITE_P(DialectShorterWay, TableContract, ShorterFactory);

using FormTable = FaultTable<DialectStation, SerialTurntable>;

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
    const Result<AxisStatus> now = s.driver.status(axis);
    ASSERT_TRUE(now.ok()) << now.error().message;
    EXPECT_NEAR(now->rate_degps, 20.0, 0.1) << to_string(axis);
    pass(20.0);
  }
  for (const Axis axis : all_axes) {
    const Result<AxisStatus> now = s.driver.status(axis);
    ASSERT_TRUE(now.ok()) << now.error().message;
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
      EXPECT_TRUE(now.ok()) << now.error().message;
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
    dialect.link.reply_timeout_s = 0.1;
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
  EXPECT_NE(with([](std::string& text) { text[text.find("P+") + 5] ^= 1; }).find("checksum"), std::string::npos);
  EXPECT_NE(with([](std::string& text) { text[text.find("\n") - 1] = '!'; }).find("echo"), std::string::npos);
  EXPECT_NE(with([](std::string& text) { text.erase(text.find(":R")); }).find("no answer within"), std::string::npos);
  EXPECT_NE(with([](std::string& text) { text += ":R\r\n"; }).find("more after it"), std::string::npos);
  EXPECT_NE(with([](std::string& text) {
              const std::size_t pitch = text.find(":P"), roll = text.find(":R");
              text = text.substr(0, pitch) + text.substr(roll) + text.substr(pitch, roll - pitch);
            }).find("expected 'H"),
            std::string::npos);
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
  for (const char* const bad : {"{a:0}", "{a:65}", "{a:x}", "{:4}", "{a}{b:4}", "{a:}"}) {
    EXPECT_FALSE(SentenceTemplate::parse(bad)) << bad;
  }
  EXPECT_EQ(SentenceTemplate::parse("{a:4}\n{b}")->lines(), 2);
}

TEST(DialectForms, DefectsAreNamed) {
  const auto expect = [](const std::string& what, const std::string& with, const char* says) {
    std::string text = form_text();
    ASSERT_NE(text.find(what), std::string::npos) << what;
    text.replace(text.find(what), what.size(), with);
    const Result<Dialect> dialect = parse_dialect(text, "my.dialect");
    ASSERT_FALSE(dialect.ok()) << with;
    EXPECT_NE(dialect.error().message.find(says), std::string::npos) << dialect.error().message;
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
  std::string text = form_text();
  text.replace(text.find("status.bit.moving = 1"), 21, "status.bit.moving = 2\nstatus.active_low = moving");
  const Result<Dialect> dialect = parse_dialect(text, "my.dialect");
  EXPECT_TRUE(dialect.ok()) << dialect.error().message;
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
  EXPECT_NE(with("status.code.0 = in_position, moving\n").find("has arrived"), std::string::npos);
  EXPECT_NE(with("status.code.1 = in_position, enabled\nstatus.code.2 = moving\n").find("that it moves"),
            std::string::npos);
  EXPECT_NE(with("status.code.1 = in_position, enabled\nstatus.code.2 = moving, enabled\n").find("off and at rest"),
            std::string::npos);
}

// Sentences, columns and decimals that cannot tell or show a move, said before one is made.
TEST(DialectForms, AMoveIsToldAndShownToTheTolerance) {
  const auto said = [](const std::string& what, const std::string& with, double rate_degps = 20.0,
                       double distance_deg = 22.5) {
    std::string text = form_text();
    if (!what.empty()) text.replace(text.find(what), what.size(), with);
    const Dialect dialect = parsed(text, "my.dialect");
    Moves moves;
    moves[0] = {distance_deg, distance_deg, rate_degps, 50.0};
    const Status status = check_move(dialect, Axis::heading, moves, 0.01);
    return status ? "" : status.error().message;
  };
  const std::string scale = "axis.heading.units_per_degree = 10";
  EXPECT_EQ(said("", ""), "");
  EXPECT_EQ(said("number.decimals = 4", "number.decimals = 0"), "") << "225 units";
  EXPECT_NE(
      said("number.decimals = 4", "number.decimals = 0", 20.0, 22.55).find("number.decimals = 0: tells 225.5 as 226"),
      std::string::npos);
  EXPECT_NE(
      said(scale,
           "axis.heading.units_per_degree = 0.0001\naxis.heading.rate_scale = 1\naxis.heading.acceleration_scale = 1")
          .find("expected an angle told to motion.position_tolerance_deg"),
      std::string::npos);
  EXPECT_NE(said("", "", 1e-6).find("number.decimals or a scale with which the rate"), std::string::npos);
  EXPECT_NE(said("{distance:12}", "{distance:4}").find("numbers that fit"), std::string::npos);
  EXPECT_NE(said("{position.heading:12}", "{position.heading:3}").find("cannot show"), std::string::npos);
  EXPECT_NE(said("{position.heading:12}", "{position.heading:6}").find("cannot show"), std::string::npos);
}

}  // namespace
}  // namespace turncal
