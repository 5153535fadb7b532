#include "imu_io/frames/counter_tracker.h"

#include <gtest/gtest.h>
#include <cmath>
#include <random>

#include "imu_io/units/arrival_fit.h"

namespace turncal {
namespace {

constexpr double period = 0.002;

// A STIM300 at 500 Hz: 8 bits in steps of 4, a wrap is 64 samples or 128 ms.
struct CounterTrackerTest : testing::Test {
  CounterTracker tracker{period, 4.0, 256.0};
  double time_s = 10.0;

  void SetUp() override { take(0.0); }
  PlacedCounter take(double raw) { return take(raw, {time_s, time_s}); }
  PlacedCounter take(double raw, const Arrival& arrival) {
    const PlacedCounter placed = tracker.place(raw, arrival);
    if (placed.outcome != CounterOutcome::stray && placed.outcome != CounterOutcome::duplicate)
      tracker.accept(placed, raw, arrival);
    return placed;
  }
};

TEST_F(CounterTrackerTest, TimeTellsTheWrapsOfALongGap) {
  // 1000 samples: 15 wraps and 40.
  for (const double late : {-0.016, 0.0, 0.016}) {
    CounterTracker copy = tracker;
    const double at = time_s + 1000 * period + late;
    const PlacedCounter placed = copy.place((4 * 1000) % 256, {at, at});
    EXPECT_EQ(placed.outcome, CounterOutcome::gap);
    EXPECT_EQ(placed.ahead, 1000) << late;
  }
  // One that is a whole number of wraps looks like a duplicate to the counter alone.
  time_s += 64 * period;
  EXPECT_EQ(take(0.0).ahead, 64);
}

TEST_F(CounterTrackerTest, ABusyReaderIsNoGap) {
  // Nothing was read for 300 ms; the frames of that time are then found all at once, and the last arrivals prove nothing.
  const Arrival late{time_s, time_s + 0.3};
  for (int i = 1; i <= 150; ++i) {
    const PlacedCounter placed = take((4 * i) % 256, late);
    ASSERT_EQ(placed.outcome, CounterOutcome::next);
    ASSERT_EQ(placed.counter, i);
  }
  time_s += 151 * period;
  EXPECT_EQ(take((4 * 151) % 256).outcome, CounterOutcome::next);
}

TEST_F(CounterTrackerTest, BatchesOf16MillisecondsAreNoGap) {
  for (int i = 1; i < 800; i += 8) {
    time_s += 8 * period;
    for (int k = 0; k < 8; ++k) {
      const PlacedCounter placed = take((4 * (i + k)) % 256);
      ASSERT_EQ(placed.outcome, CounterOutcome::next);
      ASSERT_EQ(placed.counter, i + k);
    }
  }
}

TEST_F(CounterTrackerTest, WhatIsOffTheGridOrTooLargeIsNoCounter) {
  time_s += period;
  EXPECT_EQ(tracker.place(6.0, {time_s, time_s}).outcome, CounterOutcome::stray);
  EXPECT_EQ(tracker.place(256.0, {time_s, time_s}).outcome, CounterOutcome::stray);
  EXPECT_EQ(tracker.place(-1.0, {time_s, time_s}).outcome, CounterOutcome::stray);
}

TEST_F(CounterTrackerTest, AfterRejoiningTheCounterGoesOnIfItCan) {
  tracker.rejoin();
  time_s += 1000 * period;
  EXPECT_EQ(take((4 * 1000) % 256).counter, 1000);
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

TEST(ArrivalFit, ShowsTimeThatWasLostForGood) {
  std::mt19937_64 random(3);
  ArrivalFit fit;
  for (int i = 0; i < 200 * 30; ++i) fit.add(0.005 * i, 0.005 * i + delay(random));
  EXPECT_LT(fit.persistent_delay_s(), 0.001);
  for (int i = 200 * 30; i < 200 * 35; ++i) fit.add(0.005 * i, 0.128 + 0.005 * i + delay(random));
  EXPECT_NEAR(fit.persistent_delay_s(), 0.128, 0.002);
}

TEST(ArrivalFit, SaysNothingFromTooLittle) {
  ArrivalFit fit;
  EXPECT_FALSE(fit.estimate().has_value());
  for (int i = 0; i < 200; ++i) fit.add(0.005 * i, 0.005 * i);
  EXPECT_FALSE(fit.estimate().has_value());
}

}  // namespace
}  // namespace turncal
