// Yield, reasons, repeatability and stations, on rows made for them.
#include "orchestrator/line/shift_report.h"

#include "imu_io/base/clock.h"
#include "tests/test.h"

namespace turncal {
namespace {

class Line {
 public:
  Line& attempt(const std::string& unit, const std::string& outcome, const std::string& reason = "") {
    AttemptRecord a;
    a.id = std::int64_t(all.size()) + 1;
    a.unit = unit;
    a.outcome = outcome;
    a.reason = reason;
    a.began_utc = format_utc(7200.0 * double(all.size()));
    a.time_utc = format_utc(7200.0 * double(all.size()) + 5400.0);
    all.push_back(a);
    return *this;
  }
  LineYield yield(std::int64_t from = 1) const {
    std::set<std::int64_t> ids;
    for (const AttemptRecord& a : all)
      if (a.id >= from) ids.insert(a.id);
    return line_yield(all, ids);
  }
  std::vector<AttemptRecord> all;
};

TEST(LineYield, FirstPassAndFinal) {
  Line line;
  line.attempt("A", "pass").attempt("B", "fail").attempt("B", "conditional_pass").attempt("C", "hold");
  line.attempt("D", "refused").attempt("D", "pass").attempt("E", "captured").attempt("F", "running");
  const LineYield y = line.yield();
  EXPECT_EQ(y.attempts, 8u);
  EXPECT_EQ(y.units, 6u);
  EXPECT_EQ(y.running, 1u);
  EXPECT_EQ(y.first_pass.part, 2u) << "A and D: a refusal says nothing of the unit";
  EXPECT_EQ(y.first_pass.all, 4u);
  EXPECT_EQ(y.final_pass.part, 3u);
  EXPECT_EQ(y.final_pass.all, 4u);
  EXPECT_DOUBLE_EQ(y.hours, 12.0);
  EXPECT_DOUBLE_EQ(y.hours_lost, 4.5);
  for (AttemptRecord& a : line.all) a.units = 3;
  EXPECT_DOUBLE_EQ(line.yield().hours, 4.0) << "three units of a run share its time";
}

TEST(LineYield, KnowsWhatCameBeforeTheShift) {
  Line line;
  line.attempt("A", "fail").attempt("B", "pass").attempt("A", "pass").attempt("B", "fail");
  const LineYield y = line.yield(3);
  EXPECT_EQ(y.first_pass.all, 1u)
      << "A failed before the shift: its pass is no first pass; B had passed, and comes anew";
  EXPECT_EQ(y.first_pass.part, 0u);
  EXPECT_EQ(y.final_pass.all, 1u) << "A's visit is one of the shift before, and there it has passed in the end";
  EXPECT_EQ(y.final_pass.part, 0u);
  EXPECT_EQ(line.yield().final_pass.part, 2u);
}

// A unit that fails at one station and at another counts at the first: no station's final yield is below that of the first pass.
TEST(LineYield, AVisitCountsWhereItBegan) {
  Line line;
  line.attempt("A", "fail").attempt("B", "pass").attempt("C", "fail").attempt("A", "fail").attempt("C", "pass");
  const std::set<std::int64_t> east = {1, 3}, west = {2, 4, 5};
  const LineYield e = line_yield(line.all, east), w = line_yield(line.all, west);
  EXPECT_EQ(e.first_pass.part, 0u);
  EXPECT_EQ(e.final_pass.part, 1u) << "C passed, at the other";
  EXPECT_EQ(e.final_pass.all, 2u);
  EXPECT_EQ(w.first_pass.all, 1u);
  EXPECT_EQ(w.final_pass.part, 1u);
  EXPECT_EQ(w.final_pass.all, 1u);
}

TEST(LineYield, ReasonsWithoutWhatDiffersFromUnitToUnit) {
  Line line;
  line.attempt("A", "fail", "gyro x bias (N01) 0.310 deg/h, limits -0.2 .. 0.2, guard band 0.0040");
  line.attempt("B", "fail", "gyro x bias (N01) -0.440 deg/h, limits -0.2 .. 0.2; diagnosis unexplained");
  line.attempt("C", "hold", "diagnosis extended: accel_second_order (31 sigma)");
  line.attempt("SN7", "dropped",
               "unit SN7 dropped out at step 4 (4/14) settling, roll at -90 deg: no sample from the IMU for 2 s");
  line.attempt("E", "pass").attempt("G", "failed", "connecting: 127.0.0.1:502: cannot open: Connection refused");
  line.attempt("F", "interrupted",
               "step 5 (5/14) at rest at heading 0.0000 pitch 0.0000 roll 0.0000 deg: paused; rests");
  const LineYield y = line.yield();
  ASSERT_EQ(y.reasons.size(), 5u);
  EXPECT_EQ(y.reasons[0].reason, "fail: gyro x bias (N01)");
  EXPECT_EQ(y.reasons[0].attempts, 2u);
  EXPECT_DOUBLE_EQ(y.reasons[0].share, 2.0 / 6.0);
  EXPECT_DOUBLE_EQ(y.reasons[4].cumulated, 1.0);
  EXPECT_EQ(reason_class(line.all[2]), "hold: diagnosis extended: accel_second_order");
  EXPECT_EQ(reason_class(line.all[3]), "dropped: no sample from the IMU for … s");
  EXPECT_EQ(reason_class(line.all[5]), "failed: connecting: …: cannot open: Connection refused");
  EXPECT_EQ(reason_class(line.all[6]), "interrupted: paused");
}

// Wilson 1927: 19 of 20 is 76.4 to 99.1 %.
TEST(LineYield, IntervalIsWilsons) {
  const auto [low, high] = Share{19, 20}.interval();
  EXPECT_NEAR(low, 0.7639, 1e-4);
  EXPECT_NEAR(high, 0.9911, 1e-4);
  const auto [none, few] = Share{0, 10}.interval();
  EXPECT_DOUBLE_EQ(none, 0.0);
  EXPECT_NEAR(few, 0.2775, 1e-4);
}

TEST(LineYield, AsManyAsTheTargetSaysReachIt) {
  for (std::size_t percent = 1; percent <= 100; ++percent)
    for (std::size_t wanted = percent, all = 100; all < 5000; wanted += percent, all += 100)
      for (const std::size_t part : {wanted - 1, wanted})
        EXPECT_EQ((Share{part, all}.reaches(0.01 * double(percent))), part == wanted) << percent << " % of " << all;
}

StoredCalibration calibration(const std::string& unit, const std::string& station, double day, double n01,
                              double sigma) {
  StoredCalibration c;
  c.unit = unit;
  c.station = station;
  c.time_utc = format_utc(86400.0 * day);
  c.values = {{"N01", n01, sigma, {}, "", {}, ""}};
  return c;
}

TEST(UnitPage, HasControlLimitsFromTwoCalibrationsOn) {
  UnitRecord record{"A", {}, {}, [](const std::string&, const std::string&) { return std::string(); }};
  for (const bool drawn : {false, true}) {
    record.calibrations.push_back(calibration("A", "east", 1.0, 0.1, 0.01));
    EXPECT_EQ(as_page(unit_document(record)).html.find("<svg") != std::string::npos, drawn);
  }
}

// Units of their own bias; turn-on 0.01, calibration 0.004, and a walk of 0.03 in 30 days.
TEST(Repeatability, OfPairsAtTheirInterval) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  std::vector<StoredCalibration> all;
  for (int unit = 0; unit < 400; ++unit) {
    const std::string name = "SN" + std::to_string(unit);
    const double bias = normal(random), moved = 0.03 * normal(random);
    for (const double day : {0.0, 1.0, 31.0})
      all.push_back(calibration(name, "east", day,
                                bias + (day > 2.0 ? moved : 0.0) + std::hypot(0.01, 0.004) * normal(random), 0.004));
  }
  const std::vector<Repeatability> turn_on = repeatability(all, 0.0, turn_on_days);
  ASSERT_EQ(turn_on.size(), 1u);
  EXPECT_EQ(turn_on[0].pairs, 400u);
  EXPECT_NEAR(turn_on[0].spread, std::hypot(0.01, 0.004), 0.001);
  EXPECT_NEAR(turn_on[0].of_unit().value_or(0.0), 0.01, 0.001);
  EXPECT_LT(turn_on[0].low, std::hypot(0.01, 0.004));
  EXPECT_GT(turn_on[0].high, std::hypot(0.01, 0.004));
  const std::vector<Repeatability> month = repeatability(all, month_from_days, month_to_days);
  ASSERT_EQ(month.size(), 1u);
  EXPECT_NEAR(month[0].spread, std::sqrt(0.01 * 0.01 + 0.004 * 0.004 + 0.03 * 0.03 / 2.0), 0.0025);
  for (StoredCalibration& c : all) c.station = c.time_utc > format_utc(0.0) ? "west" : "east";
  EXPECT_EQ(repeatability(all, 0.0, turn_on_days).size(), 0u) << "two stations are no repeat of one";
}

// The interval holds the true value in 95 of 100.
TEST(Repeatability, IntervalHoldsTheTruth) {
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  int held = 0;
  for (int study = 0; study < 400; ++study) {
    std::vector<StoredCalibration> all;
    for (int unit = 0; unit < 12; ++unit)
      for (const double day : {0.0, 1.0})
        all.push_back(calibration("SN" + std::to_string(unit), "east", day, normal(random), 0.1));
    const Repeatability r = repeatability(all, 0.0, turn_on_days).front();
    held += r.low <= 1.0 && 1.0 <= r.high;
  }
  EXPECT_NEAR(held / 400.0, 0.95, 0.035);
}

// West reads 0.05 more, and drifts away by 0.02 in 30 days; units differ by 1 between them.
TEST(StationDifference, OfTheSameUnitsIsSeenThroughTheirSpread) {
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  std::vector<StoredCalibration> same, others;
  for (int unit = 0; unit < 30; ++unit) {
    const double bias = normal(random), day = unit;
    const std::string name = "SN" + std::to_string(unit);
    same.push_back(calibration(name, "east", day, bias + 0.01 * normal(random), 0.01));
    same.push_back(calibration(name, "west", day + 0.5, bias + 0.05 + 0.01 * normal(random), 0.01));
    const double drifted = 0.02 / 30.0 * day;
    others.push_back(calibration(name, "east", day, 0.001 * normal(random), 0.001));
    others.push_back(calibration(name + "W", "west", day, drifted + 0.001 * normal(random), 0.001));
  }
  const std::vector<StationDifference> of_same = station_differences(same);
  ASSERT_EQ(of_same.size(), 1u);
  EXPECT_TRUE(of_same[0].of_the_same_units && of_same[0].stands_out());
  EXPECT_NEAR(of_same[0].difference, 0.05, 5.0 * of_same[0].sigma);
  EXPECT_NEAR(of_same[0].sigma, 0.01 * std::sqrt(2.0 / 30.0), 0.001);
  const std::vector<StationDifference> of_others = station_differences(others);
  ASSERT_EQ(of_others.size(), 1u);
  EXPECT_FALSE(of_others[0].of_the_same_units);
  EXPECT_TRUE(of_others[0].drifts());
  EXPECT_NEAR(of_others[0].drift.value_or(0.0), 0.02, 5.0 * of_others[0].drift_sigma.value_or(0.0));
  same.resize(8);
  EXPECT_TRUE(station_differences(same).empty()) << "four units are too few";
}

TEST(CivilTime, IsReadAsItIsWritten) {
  EXPECT_DOUBLE_EQ(parse_utc("2026-01-01T00:00:00Z").value_or(0.0), 1767225600.0);
  for (const char* text : {"", "2026-01-01", "2026-13-01T00:00:00Z", "2026-02-30T00:00:00Z", "2026-01-01T00:00:00Zx"})
    EXPECT_FALSE(parse_utc(text)) << text;
}

}  // namespace
}  // namespace turncal
