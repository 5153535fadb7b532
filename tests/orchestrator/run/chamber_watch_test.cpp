// ChamberWatch on its own: readings in, verdicts out.
#include <gtest/gtest.h>

#include "orchestrator/run/chamber_watch.h"
#include "tests/test.h"

namespace turncal {
namespace {

ChamberConfig chamber_config() {
  ChamberConfig c;
  c.limit_unit_c = 60.0;
  c.band_c = 0.5;
  c.settle_s = 100.0;
  c.settle_limit_s = 1000.0;
  return c;
}

struct Watched {
  ChamberWatch watch{chamber_config(), {-40.0, 85.0, 3.0, 0.1}};
  Watched() { watch.begin(40.0, 2.0, 0.0); }
  std::string at(double s, double actual_c, double set_c = 40.0, bool on = true, std::optional<double> unit_c = 30.0) {
    return watch.add({actual_c, set_c, on, false, false}, unit_c, s);
  }
};

TEST(ChamberWatch, SettlesWithinTheBandForSoLongAndSaysHowLongItTakes) {
  Watched w;
  EXPECT_EQ(w.at(0.0, 20.0, 24.0, false), "") << "told, and not yet read back";
  EXPECT_EQ(w.at(10.0, 20.0), "");
  EXPECT_NEAR(w.watch.left_s(10.0), 600.0 + 100.0, 1e-9);
  for (double s = 20.0; s <= 600.0; s += 10.0) EXPECT_EQ(w.at(s, 20.0 + s / 30.0), "");
  EXPECT_EQ(w.at(610.0, 40.6), "") << "overshoot";
  for (double s = 620.0; s < 720.0; s += 10.0) {
    EXPECT_EQ(w.at(s, 40.4), "");
    EXPECT_FALSE(w.watch.settled());
  }
  EXPECT_NEAR(w.watch.left_s(710.0), 10.0, 1e-9);
  EXPECT_EQ(w.at(720.0, 39.6), "");
  EXPECT_TRUE(w.watch.settled());
  // Out of it for a moment is no fault, for longer than settle_s it is.
  EXPECT_EQ(w.at(800.0, 42.0), "");
  EXPECT_EQ(w.at(890.0, 42.1), "");
  EXPECT_SAYS(w.at(910.0, 42.2), "it had settled at 40 C and reads 42.2 C");
  w.watch.begin(50.0, 2.0, 1000.0);
  EXPECT_FALSE(w.watch.settled());
}

TEST(ChamberWatch, WaitsForTheUnitThatFollowsTheAir) {
  Watched w;
  double s = 0.0, unit_c = 20.0;
  for (; !w.watch.settled() && s < 900.0; s += 1.0, unit_c += (40.0 - unit_c) / 200.0)
    ASSERT_EQ(w.at(s, 40.0, 40.0, true, unit_c), "");
  // Over the last 100 s it went by no more than the band of 0.5 C: with 200 s of lag it is within 0.8 C of the air.
  EXPECT_GT(unit_c, 39.2);
  EXPECT_LT(unit_c, 39.8);
  // One that never comes to rest is waited for as long as the air is.
  Watched drifts;
  for (s = 0.0; s <= 1000.0; s += 10.0) ASSERT_EQ(drifts.at(s, 40.0, 40.0, true, 20.0 + s / 50.0), "");
  EXPECT_SAYS(drifts.at(1001.0, 40.0, 40.0, true, 40.0),
              "it has not settled at 40 C within chamber.settle_limit_s = 1000: it reads 40.0 C, and the unit 40.0 C");
}

TEST(ChamberWatch, EachFaultIsSaid) {
  EXPECT_SAYS(Watched().watch.add({20.0, 40.0, true, true, false}, {}, 1.0), "door");
  EXPECT_SAYS(Watched().watch.add({20.0, 40.0, true, {}, true}, {}, 1.0), "alarm");
  EXPECT_EQ(Watched().watch.add({20.0, 40.0, true, {}, {}}, {}, 1.0), "")
      << "what the chamber does not tell is no fault";
  EXPECT_SAYS(Watched().at(1.0, 40.0, 40.0, true, 60.1), "the unit is at 60.1 C by its own thermometer");
  EXPECT_SAYS(Watched().at(16.0, 20.0, 24.0, false), "it is off with a set point of 24 C: it was told to hold 40 C");
  Watched other;
  EXPECT_EQ(other.at(1.0, 20.0), "");
  EXPECT_SAYS(other.at(2.0, 20.1, 45.0), "somebody else switched or set it");
  EXPECT_SAYS(other.at(2.0, 20.1, 40.0, false), "somebody else switched or set it");
  Watched dead;
  EXPECT_EQ(dead.at(1.0, 25.0), "");
  EXPECT_EQ(dead.at(180.0, 25.0), "");
  EXPECT_SAYS(dead.at(195.0, 25.0), "its sensor has read 25.0 C for 194 s");
  Watched still;
  for (double s = 1.0; s < 3000.0; s += 10.0) EXPECT_EQ(still.at(s, 40.0), "") << "the same within the band is well";
  Watched never;
  for (double s = 1.0; s < 1000.0; s += 10.0) EXPECT_EQ(never.at(s, 38.0 + 0.01 * s / 10.0), "");
  EXPECT_SAYS(never.at(1001.0, 39.1),
              "it has not settled at 40 C within chamber.settle_limit_s = 1000: it reads 39.1 C");
}

// A chamber whose line hangs must not hold up whoever looks.
TEST(ChamberKeeper, LooksAreNeverHeldUp) {
  struct Hanging : Chamber {
    Status connect() override { return {}; }
    std::string identity() const override { return "hanging"; }
    const ChamberLimits& limits() const override { return l; }
    Result<ChamberStatus> status() override {
      if (hangs) std::this_thread::sleep_for(std::chrono::milliseconds(300));
      return ChamberStatus{24.0, 40.0, !told_off};
    }
    Status set(double, double) override { return {}; }
    Status on() override { return {}; }
    Status off() override {
      told_off = true;
      return {};
    }
    void disconnect() override {}
    ChamberLimits l{-40.0, 85.0, 3.0, 0.1};
    std::atomic<bool> hangs{false}, told_off{false};
  } chamber;
  ChamberKeeper keeper(chamber, chamber_config(), BackgroundQueue::By::thread);
  ASSERT_OK(keeper.connect());
  chamber.hangs = true;
  keeper.bring_to(40.0, 2.0, 0.0);
  double longest_s = 0.0, s = 0.0;
  const auto look = [&] {
    const auto began = std::chrono::steady_clock::now();
    EXPECT_EQ(keeper.look(std::nullopt, s += 0.01), "");
    longest_s = std::max(longest_s, std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count());
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  };
  for (int i = 0; i < 20; ++i) look();
  keeper.switch_off();
  EXPECT_FALSE(keeper.is_off()) << "not before it is read";
  for (int i = 0; i < 400 && !keeper.is_off(); ++i) look();
  EXPECT_TRUE(keeper.is_off());
  EXPECT_LT(longest_s, 0.1);
}

}  // namespace
}  // namespace turncal
