// Faults of an ASCII line, each injected at the twin: the right position or an error, never a garbled number, never another axis's.
// Stops: stop_states_test.cpp.

#include "imu_io/base/clock.h"
#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

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
  ::usleep(static_cast<unsigned>(1e6 * silent.left_s()));
  s.station.pass(2.0);
  EXPECT_EQ(s.station.fastest_axis_degps(), 0.0);
  EXPECT_FALSE(s.driver.status(Axis::roll).ok()) << "it does not come back by itself";
  ASSERT_TRUE(s.driver.connect().ok());
  EXPECT_FALSE(s.driver.status(Axis::roll)->enabled);
}

}  // namespace
}  // namespace turncal
