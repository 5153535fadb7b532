// What people's files are like: bad rows, remarks, blanks, late stamps, two files, gyros at the end of their range.
#include <gtest/gtest.h>

#include <cmath>

#include "calib/model/parameters.h"
#include "imu_io/recordings/csv_map_import.h"

namespace turncal {
namespace {

const std::string base_map =
    "gravity_mps2 = 9.81\nunit_serial = s1\n"
    "gyro.columns = gx, gy, gz\ngyro.unit = deg/s\ngyro.offset = 100\n"
    "accel.columns = ax, ay, az\naccel.unit = g\n";

CsvMap map_of(const std::string& more) {
  const Result<CsvMap> map = parse_csv_map(base_map + more, "m.map");
  EXPECT_TRUE(map.ok()) << (map.ok() ? "" : map.error().message);
  return map.ok() ? *map : CsvMap{};
}

TEST(ImportForms, BadRowsAreSkippedAndCounted) {
  std::string csv = "gx,gy,gz,ax,ay,az\n";
  for (int k = 0; k < 14; ++k) csv += k == 12 ? "oops,100,96,0.5,0,1\n" : "102,100,96,0.5,0,1\n";
  CsvMap map = map_of("rate_hz = 100\n");
  EXPECT_FALSE(parse_csv(map, csv, "d.csv").ok());
  map.format.skip_bad_rows = true;
  const Result<CsvImport> c = parse_csv(map, csv, "d.csv");
  ASSERT_TRUE(c.ok()) << c.error().message;
  EXPECT_EQ(c->bad_rows, 1);
  EXPECT_NE(c->first_bad.find("d.csv:14: column 'gx' = 'oops'"), std::string::npos) << c->first_bad;
  ASSERT_EQ(c->samples.size(), 13u);
  EXPECT_EQ(c->samples.back().counter, 13);  // its number is left out
}

TEST(ImportForms, CommentedHeaderAndBlankTemperature) {
  std::string csv = "# gx, gy, gz, ax, ay, az, temp\n";
  for (int k = 0; k < 20; ++k)
    csv += std::string("102,100,96,0.5,0,1,") + (k % 5 == 0 ? "30" : "") + (k == 7 ? "\n# a remark\n" : "\n");
  const Result<CsvImport> c = parse_csv(map_of("rate_hz = 100\ntemperature.column = temp\n"), csv, "d.csv");
  ASSERT_TRUE(c.ok()) << c.error().message;
  ASSERT_EQ(c->samples.size(), 20u);
  EXPECT_EQ(c->samples[5].temperature_c, 30.0F);
  EXPECT_TRUE(std::isnan(c->samples[6].temperature_c));
}

// Stamps that come late by more than a period are no gap when those after them are not late.
TEST(ImportForms, JitteredStampsAreNoGaps) {
  std::string csv = "t,gx,gy,gz,ax,ay,az\n";
  for (int k = 0; k < 100; ++k) {
    if (k == 70) continue;                          // one row lost
    const double late = k % 10 == 3 ? 0.018 : 0.0;  // later than the next one
    csv += std::to_string(0.01 * k + late) + ",102,100,100,0,0,1\n";
  }
  const Result<CsvImport> c = parse_csv(map_of("time.column = t\ntime.increments = period\n"), csv, "d.csv");
  ASSERT_TRUE(c.ok()) << c.error().message;
  EXPECT_EQ(c->gaps, 1);
  EXPECT_EQ(c->samples.back().counter, 99);
  EXPECT_NEAR(c->info.sample_period_s, 0.01, 1e-4);
  EXPECT_FALSE(parse_csv(map_of("time.column = t\n"), csv, "d.csv").ok());  // measured intervals cannot be negative
}

TEST(ImportForms, AccelerometersInAFileOfTheirOwn) {
  const CsvMap map = map_of("time.column = t\n");
  std::string gyro = "t,gx,gy,gz\n";
  std::string same = "t,ax,ay,az\n";
  std::string other = "t,ax,ay,az\n";
  for (int k = 0; k < 50; ++k) {
    gyro += std::to_string(0.01 * k) + ",102,100,96\n";
    same += std::to_string(0.01 * k) + ",0.5,0,1\n";
  }
  for (int k = 0; k < 30; ++k) other += std::to_string(0.004 + 0.02 * k) + "," + std::to_string(0.02 * k) + ",0,1\n";
  const Result<CsvImport> joined = parse_csv(map, gyro, "g.csv", same, "a.csv");
  ASSERT_TRUE(joined.ok()) << joined.error().message;
  ASSERT_EQ(joined->samples.size(), 50u);
  EXPECT_NEAR(joined->samples[9].accel[0], 0.5 * standard_gravity_mps2 * 0.01, 1e-9);
  // A ramp sampled at another rate: the velocity over the common time is kept. A number holds for the interval that it ends.
  const Result<CsvImport> resampled = parse_csv(map, gyro, "g.csv", other, "a.csv");
  ASSERT_TRUE(resampled.ok()) << resampled.error().message;
  EXPECT_EQ(resampled->samples.size(), 49u);  // the first row is before the accelerometers begin
  double velocity = 0.0;
  for (std::size_t k = 1; k < resampled->samples.size(); ++k) velocity += resampled->samples[k].accel[0];
  double expected = 0.0;
  for (int k = 1; k < 30; ++k) {
    const double from = std::max(0.01, 0.004 + 0.02 * (k - 1));
    const double to = std::min(0.49, 0.004 + 0.02 * k);
    if (to > from) expected += 0.02 * k * (to - from);
  }
  EXPECT_NEAR(velocity, expected * standard_gravity_mps2, 1e-6);
}

// A gyro that stands at its extreme value is found on the numbers, whatever the intervals are.
TEST(ImportForms, ClippingIsFoundBesideMeasuredIntervals) {
  std::string csv = "t,gx,gy,gz,ax,ay,az\n";
  double t = 0.0;
  for (int k = 0; k < 400; ++k) {
    const double rate = std::min(2000.0, std::round(3000.0 * std::sin(0.02 * k)));
    csv += std::to_string(t) + "," + std::to_string(100.0 + rate) + ",100,100,0,0,1\n";
    t += k % 2 == 0 ? 0.0099 : 0.0101;
  }
  const Result<CsvImport> c = parse_csv(map_of("time.column = t\n"), csv, "d.csv");
  ASSERT_TRUE(c.ok()) << c.error().message;
  EXPECT_GT(c->clipped, 50);
}

}  // namespace
}  // namespace turncal
