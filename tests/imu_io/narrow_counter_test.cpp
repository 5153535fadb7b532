// A counter of 7 or 8 bits, and a line that stalls, a unit that is reset, samples that are lost: arrival tells them apart, or it is said
// that nothing does.
#include <gtest/gtest.h>

#include "frame_streams.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

// u8 at 200 Hz (wraps in 1.28 s), 7 bits at 1 kHz (128 ms).
struct Narrow {
  const char* name;
  FrameDescription frame;
  std::int64_t modulus;
};
void PrintTo(const Narrow& narrow, std::ostream* out) { *out << narrow.name; }
std::vector<Narrow> narrow_frames() {
  return {{"u8_200_hz", frame_with("laser_gyro", {"counter.type = u8"}), 256},
          {"seven_bits_1_khz", frame_named("kvh1750"), 128}};
}

class NarrowCounter : public testing::TestWithParam<Narrow> {
 protected:
  NarrowCounter() : frame(GetParam().frame), line(frame), encoder(frame) {}
  std::int64_t periods(double seconds) const { return std::llround(seconds / frame.sample_period_s); }
  // The frames of `sent`, all at one moment.
  void burst(const std::vector<ImuSample>& sent) {
    for (const ImuSample& sample : sent) frame_now(sample);
  }
  // At a pace that many times the unit's.
  void faster(const std::vector<ImuSample>& sent, double pace) {
    for (const ImuSample& sample : sent) {
      line.time_s += frame.sample_period_s / pace;
      frame_now(sample);
    }
  }
  void frame_now(const ImuSample& sample) {
    Bytes bytes(encoder.length());
    ASSERT_OK(encoder.encode(sample, bytes));
    line.feed(bytes);
  }
  void expect_all(std::int64_t count) const {
    EXPECT_FALSE(line.restarted) << line.decoder.restart_reason();
    EXPECT_EQ(line.decoder.counters().lost_samples, 0U);
    ASSERT_EQ(line.samples.size(), static_cast<std::size_t>(count));
    EXPECT_EQ(line.samples.back().counter - line.samples.front().counter, count - 1);
  }
  FrameDescription frame;
  Line line;
  FrameEncoder encoder;
};

// An adapter or a network that holds everything back for as long as some wraps, and then delivers it: nothing was lost.
TEST_P(NarrowCounter, AStallThatDeliversEverythingLosesNothing) {
  for (const double stall_s : {0.3, 1.28, 2.0, 5.0}) {
    line.samples.clear();
    const std::int64_t first = 7, before = 200, held = periods(stall_s);
    Line fresh(frame);
    std::swap(line.decoder, fresh.decoder);
    line.feed_frames(frame, numbered(first, before));
    line.time_s += stall_s;
    burst(numbered(first + before, held));
    line.feed_frames(frame, numbered(first + before + held, 100));
    expect_all(before + held + 100);
  }
}

// The same through a line that is little faster than the unit: the backlog comes at twice its pace.
TEST_P(NarrowCounter, ABacklogThatDrainsSlowlyLosesNothing) {
  const std::int64_t held = periods(2.0);
  line.feed_frames(frame, numbered(7, 200));
  line.time_s += 1.0;
  faster(numbered(207, held), 2.0);  // 1 s: what came meanwhile is in it
  line.feed_frames(frame, numbered(207 + held, 100));
  expect_all(200 + held + 100);
}

TEST_P(NarrowCounter, SamplesLostInASilenceAreCounted) {
  const std::int64_t lost = 3 * GetParam().modulus + 40;
  line.feed_frames(frame, numbered(7, 200));
  line.time_s += frame.sample_period_s * static_cast<double>(lost);
  line.feed_frames(frame, numbered(207 + lost, periods(1.0)));
  EXPECT_FALSE(line.restarted) << line.decoder.restart_reason();
  EXPECT_EQ(line.decoder.counters().lost_samples, static_cast<std::uint64_t>(lost));
  ASSERT_EQ(line.samples.size(), 200 + static_cast<std::size_t>(periods(1.0)));
  EXPECT_EQ(line.samples.back().counter - line.samples.front().counter, 199 + lost + periods(1.0));
}

// A unit that is reset is silent for a while and counts from 0.
TEST_P(NarrowCounter, AResetIsNoLoss) {
  for (double away_s = 0.5; away_s < 1.65; away_s += 0.1) {
    Line fresh(frame);
    std::swap(line.decoder, fresh.decoder);
    line.samples.clear();
    line.restarted = false;
    line.feed_frames(frame, numbered(7, 210));
    line.time_s += away_s;
    line.feed_frames(frame, numbered(0, periods(1.0)));
    EXPECT_TRUE(line.restarted) << away_s;
    EXPECT_EQ(line.samples.size(), 210U) << away_s << ": not one of the new ones";
  }
}

// Out of step by a quarter of a wrap and more: neither stalled nor whole wraps.
TEST(NarrowCounters, WhatNothingTellsIsARestart) {
  const FrameDescription frame = frame_with("laser_gyro", {"counter.type = u8"});
  for (const std::int64_t wrong : {60, 128, 200}) {
    Line line(frame);
    line.feed_frames(frame, numbered(7, 200));
    line.time_s += 2.0;
    line.feed_frames(frame, numbered(207 + 400 + wrong, 300));
    EXPECT_TRUE(line.restarted) << wrong;
    EXPECT_EQ(line.samples.size(), 200U);
  }
}

// A frame that came twice is dropped, whoever doubled it; two that differ are both given, since one of them is wrong.
TEST_P(NarrowCounter, DuplicatesThatDifferAreGiven) {
  line.feed_frames(frame, numbered(7, 50));
  frame_now(numbered(56, 1)[0]);
  EXPECT_EQ(line.samples.size(), 50U);
  ImuSample other = numbered(56, 1)[0];
  other.accel[2] = 3.0;
  frame_now(other);
  ASSERT_EQ(line.samples.size(), 51U);
  EXPECT_EQ(line.samples.back().counter, line.samples[49].counter);
  EXPECT_EQ(line.decoder.counters().duplicates, 2U);
}

INSTANTIATE_TEST_SUITE_P(All, NarrowCounter, testing::ValuesIn(narrow_frames()),
                         [](const auto& each) { return std::string(each.param.name); });

}  // namespace
}  // namespace turncal
