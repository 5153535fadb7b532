// Faults of an ASCII line, each injected at the twin: the right position or an error, never a garbled number, never another axis's.
// Stops: stop_states_test.cpp.
#include <unistd.h>

#include <algorithm>
#include <functional>

#include <gtest/gtest.h>

#include "imu_io/base/clock.h"
#include "tests/turntable_drivers/dialect_station.h"

namespace turncal {
namespace {

std::string text_of(const AnswerPiece& piece) { return {piece.bytes.begin(), piece.bytes.end()}; }
void set_text(AnswerPiece& piece, const std::string& text) { piece.bytes.assign(text.begin(), text.end()); }
std::string framed_dollar(const std::string& body) {
  return "$" + body + "*" + check_digits(body, SentenceCheck::sum8) + "\r\n";
}

struct TextTable : FaultTable<DialectStation, SerialTurntable> {
  explicit TextTable(const std::string& name, bool tcp = false) : FaultTable(quick(shipped_dialect(name, tcp))) {}
  static Dialect quick(Dialect dialect) {
    dialect.link.reply_timeout_s = 0.15;
    dialect.link.quiet_s = 0.06;
    return dialect;
  }
};

using Disturbance = std::function<void(AnswerPlan&)>;
struct TextFault {
  const char* name;
  Disturbance how;
};
void PrintTo(const TextFault& fault, std::ostream* out) { *out << fault.name; }

std::vector<TextFault> text_faults() {
  const auto change = [](const std::function<std::string(std::string)>& how) {
    return [how](AnswerPlan& plan) { set_text(plan.pieces[0], how(text_of(plan.pieces[0]))); };
  };
  return {
      {"missing", [](AnswerPlan& plan) { plan.pieces.clear(); }},
      {"late", [](AnswerPlan& plan) { plan.pieces[0].delay_s = 0.2; }},
      {"duplicate", [](AnswerPlan& plan) { plan.pieces.push_back(plan.pieces[0]); }},
      {"duplicate_a_little_later",
       [](AnswerPlan& plan) {
         plan.pieces.push_back(plan.pieces[0]);
         plan.pieces[1].delay_s = 0.005;
       }},
      {"digit_flipped", change([](std::string text) {
         const std::size_t digit = text.find_first_of("0123456789", text.size() / 3);
         text[digit] = 'x';
         return text;
       })},
      {"not_a_number", change([](std::string text) {
         const std::size_t begin = text.find_first_of("-0123456789", 7);
         const std::size_t end = text.find_first_not_of("-.0123456789", begin);
         return text.replace(begin, end - begin, "nan");
       })},
      {"cut_short", change([](std::string text) { return text.substr(0, text.size() / 2); })},
      {"no_terminator", change([](std::string text) { return text.substr(0, text.size() - 2); })},
      {"interleaved",
       [](AnswerPlan& plan) {
         plan.pieces.insert(plan.pieces.begin(), {{'$', 'A', 'S', '\r', '\n'}, 0.0});
       }},
      {"control_characters", change([](std::string text) {
         text.insert(text.size() / 2, "\x01\x7f");
         return text;
       })},
      {"split",
       [](AnswerPlan& plan) {
         const std::string text = text_of(plan.pieces[0]);
         set_text(plan.pieces[0], text.substr(0, 4));
         plan.pieces.push_back({{text.begin() + 4, text.end()}, 0.02});
       }},
      {"byte_by_byte",
       [](AnswerPlan& plan) {
         const std::string text = text_of(plan.pieces[0]);
         plan.pieces.clear();
         for (const char c : text) plan.pieces.push_back({{static_cast<std::uint8_t>(c)}, 0.001});
       }},
  };
}

class DialectLineFaults : public testing::TestWithParam<TextFault> {};

TEST_P(DialectLineFaults, NoWrongPositionIsBelieved) {
  TextTable s("own_dollar");
  int answers = 0;
  s.station.disturb([&, how = GetParam().how](const std::string&, AnswerPlan& plan) {
    if (++answers == 3 || answers == 9) how(plan);
  });
  EXPECT_EQ(s.expect_truth(5), 15) << "repeated with success; last error: " << s.last_error.message;
}
INSTANTIATE_TEST_SUITE_P(All, DialectLineFaults, testing::ValuesIn(text_faults()),
                         [](const auto& which) { return std::string(which.param.name); });

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
    const Result<AxisStatus> status = s.driver.status(axis);
    ASSERT_TRUE(status.ok()) << status.error().message;
    EXPECT_EQ(status->drive_on, axis != Axis::roll);
  }
  ASSERT_TRUE(s.driver.stop_all().ok());
  ASSERT_TRUE(s.driver.status(Axis::heading).ok()) << "an answer: all before it was heard";
  s.station.disturb({});
  ASSERT_GE(sent.size(), 3u);
  EXPECT_EQ(std::vector<std::string>(sent.end() - 3, sent.end()),
            (std::vector<std::string>{":MODE:OFF 1", ":MODE:OFF 2", ":INT:OPEN 3"}));
}

TEST(DialectFaults, BadChecksumIsAnError) {
  TextTable s("own_dollar");
  s.station.disturb([](const std::string&, AnswerPlan& plan) {
    std::string text = text_of(plan.pieces[0]);
    text[text.size() - 3] = text[text.size() - 3] == '0' ? '1' : '0';
    set_text(plan.pieces[0], text);
  });
  EXPECT_EQ(s.expect_truth(1), 0);
  const Result<AxisStatus> lost = s.driver.status(Axis::heading);
  ASSERT_FALSE(lost.ok());
  EXPECT_EQ(lost.error().kind, ErrorKind::device);
  EXPECT_NE(lost.error().message.find("link lost"), std::string::npos) << "the third failure in a row";
  EXPECT_FALSE(s.driver.stop_all().ok());
  s.station.disturb(nullptr);
  ASSERT_TRUE(s.driver.connect().ok());
  EXPECT_FALSE(s.driver.status(Axis::heading)->enabled);
}

// A number that is none, under a right checksum: never 0.
TEST(DialectFaults, GarbledNumberUnderAGoodChecksum) {
  for (const char* const bad : {"nan", "inf", "12.3.4", "1e999", "--5", "0x10", "-"}) {
    TextTable s("own_dollar");
    s.station.disturb([&](const std::string& body, AnswerPlan& plan) {
      if (body == "MNSTS,1")
        set_text(plan.pieces[0], framed_dollar(std::string("ASSTS,") + bad + ",0,1,30,0,1,-50,0,1"));
    });
    const Result<AxisStatus> status = s.driver.status(Axis::heading);
    ASSERT_FALSE(status.ok()) << bad;
    EXPECT_NE(status.error().message.find("expected a number"), std::string::npos) << status.error().message;
  }
}

TEST(DialectFaults, UnknownStatusIsNotArrived) {
  TextTable s("newport_esp30x");
  s.make_ready();
  EXPECT_TRUE(s.driver.status(Axis::pitch)->in_position);
  s.station.disturb([](const std::string& body, AnswerPlan& plan) {
    if (body.ends_with("MD?")) set_text(plan.pieces[0], "7\r\n");
  });
  const Result<AxisStatus> now = s.driver.status(Axis::pitch);
  ASSERT_TRUE(now.ok());
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
  const Result<AxisStatus> status = s.driver.status(Axis::heading);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("axis '2' answered"), std::string::npos) << status.error().message;
}

TEST(DialectFaults, JumpIsNotBelieved) {
  TextTable s("newport_esp30x");
  s.make_ready();
  s.station.disturb([](const std::string& body, AnswerPlan& plan) {
    if (body == "01TP?") set_text(plan.pieces[0], "30.0000\r\n");
  });
  const Result<AxisStatus> status = s.driver.status(Axis::heading);
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("not believed"), std::string::npos) << status.error().message;
  EXPECT_TRUE(s.driver.stop_all().ok()) << "the link is not lost";
}

TEST(DialectFaults, DeviceSaysNo) {
  TextTable s("own_prompt");
  s.make_ready();
  const Status refused = s.driver.move_absolute(Axis::pitch, 3700.0, 10.0, 10.0);  // beyond the mock's travel
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.error().message.find("the device says '?'"), std::string::npos) << refused.error().message;
  EXPECT_NE(refused.error().message.find("it stands"), std::string::npos) << refused.error().message;
}

TEST(DialectFaults, MoveIsNeverSentAgain) {
  TextTable s("own_dollar");
  s.make_ready();
  int runs = 0;
  s.station.disturb([&](const std::string& body, AnswerPlan& plan) {
    if (body != "MNRUN,1") return;
    ++runs;
    plan.pieces.clear();
  });
  const Status sent = s.driver.move_absolute(Axis::pitch, 20.0, 10.0, 10.0);
  ASSERT_FALSE(sent.ok());
  EXPECT_NE(sent.error().message.find("it moves"), std::string::npos) << sent.error().message;
  EXPECT_EQ(runs, 1);
}

// After a stop the other axes stay where they are: a sentence for all three must not take their motion up again.
TEST(DialectFaults, StoppedMotionDoesNotResumeWithTheNextMove) {
  TextTable s("own_dollar");
  s.make_ready();
  for (const Axis axis : all_axes) ASSERT_TRUE(s.driver.move_absolute(axis, 90.0, 10.0, 10.0).ok());
  s.station.pass(2.0);
  ASSERT_TRUE(s.driver.stop_all().ok());
  s.station.pass(2.0);
  const double heading_deg = s.driver.status(Axis::heading)->position_deg;
  EXPECT_LT(heading_deg, 40.0);
  ASSERT_TRUE(s.driver.move_absolute(Axis::roll, 0.0, 10.0, 10.0).ok());
  s.station.pass(10.0);
  EXPECT_NEAR(s.driver.status(Axis::heading)->position_deg, heading_deg, 1e-3);
  EXPECT_NEAR(s.driver.status(Axis::roll)->position_deg, 0.0, 1e-3);
}

TEST(DialectFaults, FiveSecondsOfSilence) {
  TextTable s("newport_esp30x");
  s.make_ready();
  ASSERT_TRUE(s.driver.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  s.station.pass(2.0);
  const Deadline silent(5.0);
  s.station.disturb([&](const std::string&, AnswerPlan& plan) {
    if (!silent.passed()) plan.pieces.clear();
  });
  const Result<AxisStatus> lost = s.driver.status(Axis::roll);
  ASSERT_FALSE(lost.ok());
  EXPECT_EQ(lost.error().kind, ErrorKind::device);
  EXPECT_FALSE(silent.passed()) << "given up at its own deadline";
  EXPECT_NE(s.driver.status(Axis::roll).error().message.find("link lost"), std::string::npos);
  EXPECT_TRUE(s.driver.stop_all().ok()) << "but a stop goes out";
  ::usleep(static_cast<unsigned>(1e6 * silent.left_s()));
  s.station.pass(2.0);
  EXPECT_EQ(s.station.fastest_axis_degps(), 0.0);
  EXPECT_FALSE(s.driver.status(Axis::roll).ok()) << "it does not come back by itself";
  ASSERT_TRUE(s.driver.connect().ok());
  EXPECT_FALSE(s.driver.status(Axis::roll)->enabled);
}

TEST(DialectFaults, UnpluggedInMidMove) {
  TextTable s("own_dollar");
  s.make_ready();
  ASSERT_TRUE(s.driver.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  s.station.disturb([](const std::string&, AnswerPlan& plan) {
    plan.pieces[0].bytes.resize(4);
    plan.hang_up = true;
  });
  EXPECT_FALSE(s.driver.status(Axis::roll).ok());
  EXPECT_FALSE(s.driver.stop_all().ok());
  EXPECT_EQ(s.driver.status(Axis::roll).error().kind, ErrorKind::device);
}

}  // namespace
}  // namespace turncal
