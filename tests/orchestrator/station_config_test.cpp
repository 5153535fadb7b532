// The station file: every key arrives, every defect is named, the shipped example is the built-in station.
#include "orchestrator/station/station_config.h"

#include <regex>

#include "tests/orchestrator/program.h"
#include "tests/said.h"

namespace turncal {
namespace {

const std::string minimal = station_head;
const std::string shipped_stations = std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/stations/";

StationConfig parsed(const std::string& text, const std::string& file = "my.station") {
  return *good(parse_station_config(text, file));
}

void expect_equal(const StationConfig& a, const StationConfig& b) {
  const auto all = [](const StationConfig& s) {
    const MotionConfig& m = s.motion;
    const DwellConfig& d = s.dwell;
    std::vector<double> numbers = {s.latitude_deg, s.gravity_mps2, s.imu_timeout_s, double(d.max_repeats)};
    for (const AxisLimits& x : s.axis)
      numbers.insert(numbers.end(),
                     {x.soft_min_deg, x.soft_max_deg, x.max_rate_degps, x.max_acceleration_degps2, x.wrap_deg});
    numbers.insert(numbers.end(), {m.position_tolerance_deg, m.settle_rate_degps, m.settle_s, m.poll_moving_s,
                                   m.poll_idle_s, m.stall_s, m.deadline_margin_s});
    numbers.insert(numbers.end(), {d.stillness_window_s, d.max_gyro_std_degps, d.max_gyro_peak_degps,
                                   d.max_accel_std_mps2, d.max_accel_peak_mps2});
    return std::tuple(numbers, s.table.driver, s.imu.has_value(), s.rig_file);
  };
  EXPECT_EQ(all(a), all(b));
}

TEST(StationConfig, TheShippedExampleIsTheBuiltInStation) {
  const Result<StationConfig> station = good(read_station_config(shipped_stations + "mock.station"));
  expect_equal(*station, default_station_config());
  EXPECT_EQ(station->name, "mock");
  EXPECT_EQ(default_station_config().motion.settle_s, 0.5);
}

TEST(StationConfig, MinimalFileHasTheDefaults) {
  StationConfig expected = default_station_config();
  expected.motion.settle_s = 1.0;
  expect_equal(parsed(minimal), expected);
}

TEST(StationConfig, EveryKeyArrives) {
  const StationConfig station = parsed(
      "format = 1\nstation.name = hall 2\nsite.latitude_deg = -33.5\nsite.gravity_mps2 = 9.79\ntable.driver = mock\n"
      "imu.driver = rig\nimu.timeout_s = 3\nrig.file = my.rig\n"
      "axis.heading.soft_min_deg = -1\naxis.heading.soft_max_deg = 2\naxis.heading.max_rate_degps = 3\n"
      "axis.heading.max_acceleration_degps2 = 4\naxis.heading.wrap_deg = 5\n"
      "axis.pitch.soft_min_deg = -11\naxis.pitch.soft_max_deg = 12\naxis.pitch.max_rate_degps = 13\n"
      "axis.pitch.max_acceleration_degps2 = 14\naxis.pitch.wrap_deg = 15\n"
      "axis.roll.soft_min_deg = -21\naxis.roll.soft_max_deg = 22\naxis.roll.max_rate_degps = 23\n"
      "axis.roll.max_acceleration_degps2 = 24\naxis.roll.wrap_deg = 0\n"
      "motion.position_tolerance_deg = 0.02\nmotion.settle_rate_degps = 0.03\nmotion.settle_s = 1.5\n"
      "motion.poll_moving_s = 0.2\nmotion.poll_idle_s = 0.6\nmotion.stall_s = 4\nmotion.deadline_margin_s = 20\n"
      "dwell.max_repeats = 7\ndwell.stillness_window_s = 2\ndwell.max_gyro_std_degps = 0.004\n"
      "dwell.max_gyro_peak_degps = 0.05\ndwell.max_accel_std_mps2 = 0.006\ndwell.max_accel_peak_mps2 = 0.07\n",
      "stations/my.station");
  StationConfig expected;
  expected.latitude_deg = -33.5;
  expected.gravity_mps2 = 9.79;
  expected.axis = {AxisLimits{-1, 2, 3, 4, 5}, AxisLimits{-11, 12, 13, 14, 15}, AxisLimits{-21, 22, 23, 24, 0}};
  expected.motion = {0.02, 0.03, 1.5, 0.2, 0.6, 4.0, 20.0};
  expected.dwell = {7, 2.0, 0.004, 0.05, 0.006, 0.07};
  expected.imu_timeout_s = 3.0;
  expected.rig_file = "stations/my.rig";  // relative to the station file
  expect_equal(station, expected);
  EXPECT_EQ(station.name, "hall 2");
  EXPECT_EQ(station.file, "stations/my.station");
  EXPECT_EQ(parsed(minimal + "rig.file = my.rig\n", "my.station").rig_file, "my.rig");
  EXPECT_EQ(parsed(minimal + "rig.file = /etc/my.rig\n", "a/my.station").rig_file, "/etc/my.rig");
}

// Beside the shipped ones. live: a table over Modbus, a unit on a line.
TEST(StationConfig, EveryBadValueNamesFileLineKeyAndWhatWasExpected) {
  const std::map<std::string, std::string> texts = {{"minimal", minimal},
                                                    {"no table", replaced(minimal, "table.driver = mock\n", "")},
                                                    {"live", live_station("imu.unit_serial = SN1\n", "/dev/a")}};
  expect_said("orchestrator/stations.said", [&](const std::string& name, const std::string& what,
                                                const std::string& with) {
    const auto station = parse_station_config(replaced(texts.at(name), what, with), shipped_stations + "my.station");
    return std::regex_replace(said_of(station), std::regex(shipped_stations), "");
  });
}

}  // namespace
}  // namespace turncal
