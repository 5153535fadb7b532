#include "imu_io/frames/counter_tracker.h"

#include "frame_streams.h"
#include "imu_io/units/serial_imu.h"
#include "tests/test.h"

namespace turncal {
namespace {

// A STIM300 at 500 Hz: 8 bits in steps of 4.
TEST(CounterTracker, WhatIsOffTheGridOrTooLargeIsNoCounter) {
  CounterTracker tracker(0.002, 4.0, 256.0);
  tracker.accept(tracker.place(0.0, {0, 0}), 0.0, {0, 0});
  for (const double raw : {6.0, 256.0, -1.0})
    EXPECT_EQ(tracker.place(raw, {0.002, 0.002}).outcome, CounterOutcome::stray) << raw;
}

TEST(CounterTracker, AWideCounterNeedsNoTime) {
  CounterTracker tracker(0.005, 1.0, 4294967296.0);
  tracker.accept(tracker.place(4294967294.0, {0, 0}), 4294967294.0, {0, 0});
  PlacedCounter placed = tracker.place(4294967295.0, {0.005, 0.005});
  EXPECT_EQ(placed.outcome, CounterOutcome::next);
  tracker.accept(placed, 4294967295.0, {0.005, 0.005});
  placed = tracker.place(0.0, {0.01, 0.01});
  EXPECT_EQ(placed.outcome, CounterOutcome::next);
  EXPECT_EQ(placed.counter, 4294967296);
  // The clock stepped, or the reader slept: the counter is the time.
  for (const double step : {-3600.0, 3600.0})
    EXPECT_EQ(tracker.place(0.0, {0.01 + step, 0.01 + step}).outcome, CounterOutcome::next) << step;
  // One flipped bit of the counter.
  EXPECT_EQ(tracker.place(65536.0, {0.01, 0.01}).outcome, CounterOutcome::stray);
  // A unit that was switched off and on while the link was down: it goes on by the time that has passed, with a gap.
  tracker.rejoin();
  placed = tracker.place(7.0, {10.005, 10.005});
  EXPECT_EQ(placed.outcome, CounterOutcome::gap);
  EXPECT_EQ(placed.ahead, 2000);
}

TEST(CounterTracker, ATimeOfTheWeekIsACounter) {
  CounterTracker tracker(0.01, 0.01, 604800.0);
  tracker.accept(tracker.place(604799.985, {0, 0}), 604799.985, {0, 0});
  // The unit's own clock drifts against the receiver's: steps of 0.010001 s, over the end of the week.
  double raw = 604799.985;
  std::int64_t last = tracker.last_counter();
  for (int i = 1; i < 10000; ++i) {
    raw += 0.010001;
    if (raw >= 604800.0) raw -= 604800.0;
    const PlacedCounter placed = tracker.place(raw, {0.01 * i, 0.01 * i});
    ASSERT_EQ(placed.outcome, CounterOutcome::next) << i;
    tracker.accept(placed, raw, {0.01 * i, 0.01 * i});
    ASSERT_EQ(placed.counter, ++last);
  }
}

TEST(CounterTracker, WithoutACounterOnlyBytesAndSilenceTell) {
  CounterTracker tracker(0.005, 1.0, 0.0);
  tracker.accept(tracker.place_uncounted(0.0, {1.0, 1.0}), 0.0, {1.0, 1.0});
  EXPECT_EQ(tracker.place_uncounted(0.0, {1.02, 1.02}).ahead, 1);
  EXPECT_EQ(tracker.place_uncounted(0.9, {1.01, 1.01}).ahead, 2);
  EXPECT_EQ(tracker.place_uncounted(0.0, {2.0, 2.0}).ahead, 200);
  EXPECT_EQ(tracker.place_uncounted(0.0, {1.0, 2.0}).ahead, 1);  // read late, not sent late
}

// ---- offset and skew of the unit's clock ----

// Delays that are exponential with 2 ms on top of 0.3 ms, as a USB adapter's are; now and then the host is away for 50 ms.
double delay(std::mt19937_64& random) {
  std::exponential_distribution<double> usual(1.0 / 0.002);
  return 0.0003 + usual(random) + (random() % 1000 == 0 ? 0.05 : 0.0);
}

TEST(ArrivalFit, FindsOffsetAndSkewBelowTheDelays) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    for (const double skew : {0.0, 37e-6, -150e-6}) {
      std::mt19937_64 random(seed);
      ArrivalFit fit;
      for (int i = 0; i < 200 * 600; ++i) {
        const double t = 0.005 * i;
        fit.add(t, 1000.0 + (1.0 + skew) * t + delay(random));
      }
      const auto got = fit.estimate();
      ASSERT_TRUE(got.has_value());
      // The smallest of 200 delays is 0.01 ms above the least; 0.1 ms over 600 s is 0.17 ppm.
      EXPECT_NEAR(got->skew, skew, 0.2e-6);
      EXPECT_NEAR(got->offset_s, 1000.0003, 0.0001);
      EXPECT_GT(got->span_s, 595.0);
      EXPECT_LT(std::abs(got->skew - skew), 3.0 * got->skew_uncertainty);
      EXPECT_LT(got->skew_uncertainty, 0.2e-6);
      EXPECT_GT(got->largest_delay_s, 0.05);
      EXPECT_LT(got->largest_delay_s, 0.1);
      EXPECT_LT(std::abs(fit.persistent_delay_s()), 0.001);
    }
  }
}

TEST(ArrivalFit, BatchesOf16MillisecondsDoNotPullIt) {
  ArrivalFit fit;
  for (int i = 0; i < 200 * 300; ++i) {
    const double t = 0.005 * i;
    const double arrives = (1.0 + 20e-6) * t;
    fit.add(t, 0.016 * std::ceil(arrives / 0.016));
  }
  const auto got = fit.estimate();
  ASSERT_TRUE(got.has_value());
  EXPECT_NEAR(got->skew, 20e-6, 1e-6);
  EXPECT_LT(std::abs(got->skew - 20e-6), 3.0 * got->skew_uncertainty);
  EXPECT_NEAR(got->largest_delay_s, 0.016, 0.001);
}

TEST(ArrivalFit, ShowsTimeThatWasLostForGoodAndSaysNothingFromTooLittle) {
  std::mt19937_64 random(3);
  ArrivalFit fit;
  EXPECT_FALSE(fit.estimate().has_value());
  for (int i = 0; i < 200 * 30; ++i) {
    fit.add(0.005 * i, 0.005 * i + delay(random));
    EXPECT_TRUE(i != 199 || !fit.estimate().has_value());
  }
  EXPECT_LT(fit.persistent_delay_s(), 0.001);
  for (int i = 200 * 30; i < 200 * 35; ++i) fit.add(0.005 * i, 0.128 + 0.005 * i + delay(random));
  EXPECT_NEAR(fit.persistent_delay_s(), 0.128, 0.002);
}

// ---- counters of 7 or 8 bits

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
    ASSERT_EQ(line.samples.size(), std::size_t(count));
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
  line.time_s += frame.sample_period_s * double(lost);
  line.feed_frames(frame, numbered(207 + lost, periods(1.0)));
  EXPECT_FALSE(line.restarted) << line.decoder.restart_reason();
  EXPECT_EQ(line.decoder.counters().lost_samples, std::uint64_t(lost));
  ASSERT_EQ(line.samples.size(), 200 + std::size_t(periods(1.0)));
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
