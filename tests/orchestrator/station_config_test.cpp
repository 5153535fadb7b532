// The station file: every key arrives, every defect is named, the shipped example is the built-in station.
#include "orchestrator/station/station_config.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

const std::string minimal = station_head;

StationConfig parsed(const std::string& text, const std::string& file = "my.station") {
  const Result<StationConfig> station = parse_station_config(text, file);
  EXPECT_TRUE(station.ok()) << station.error().message;
  return station.ok() ? *station : StationConfig();
}

std::string config_error(const std::string& text) {
  const Result<StationConfig> station = parse_station_config(text, "my.station");
  if (station.ok()) return "accepted";
  EXPECT_EQ(station.error().kind, ErrorKind::input);
  EXPECT_EQ(station.error().message.find('\n'), std::string::npos);
  return station.error().message;
}

std::string without(const std::string& key) {
  std::string text = minimal;
  const std::size_t begin = text.find(key);
  text.erase(begin, text.find('\n', begin) + 1 - begin);
  return text;
}

void expect_equal(const StationConfig& a, const StationConfig& b) {
  EXPECT_EQ(a.latitude_deg, b.latitude_deg);
  EXPECT_EQ(a.gravity_mps2, b.gravity_mps2);
  EXPECT_EQ(a.table.driver, b.table.driver);
  EXPECT_EQ(a.imu.has_value(), b.imu.has_value());
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(a.axis[i].soft_min_deg, b.axis[i].soft_min_deg);
    EXPECT_EQ(a.axis[i].soft_max_deg, b.axis[i].soft_max_deg);
    EXPECT_EQ(a.axis[i].max_rate_degps, b.axis[i].max_rate_degps);
    EXPECT_EQ(a.axis[i].max_acceleration_degps2, b.axis[i].max_acceleration_degps2);
    EXPECT_EQ(a.axis[i].wrap_deg, b.axis[i].wrap_deg);
  }
  EXPECT_EQ(a.motion.position_tolerance_deg, b.motion.position_tolerance_deg);
  EXPECT_EQ(a.motion.settle_rate_degps, b.motion.settle_rate_degps);
  EXPECT_EQ(a.motion.settle_s, b.motion.settle_s);
  EXPECT_EQ(a.motion.poll_moving_s, b.motion.poll_moving_s);
  EXPECT_EQ(a.motion.poll_idle_s, b.motion.poll_idle_s);
  EXPECT_EQ(a.motion.stall_s, b.motion.stall_s);
  EXPECT_EQ(a.motion.deadline_margin_s, b.motion.deadline_margin_s);
  EXPECT_EQ(a.dwell.max_repeats, b.dwell.max_repeats);
  EXPECT_EQ(a.dwell.stillness_window_s, b.dwell.stillness_window_s);
  EXPECT_EQ(a.dwell.max_gyro_std_degps, b.dwell.max_gyro_std_degps);
  EXPECT_EQ(a.dwell.max_gyro_peak_degps, b.dwell.max_gyro_peak_degps);
  EXPECT_EQ(a.dwell.max_accel_std_mps2, b.dwell.max_accel_std_mps2);
  EXPECT_EQ(a.dwell.max_accel_peak_mps2, b.dwell.max_accel_peak_mps2);
  EXPECT_EQ(a.imu_timeout_s, b.imu_timeout_s);
  EXPECT_EQ(a.rig_file, b.rig_file);
}

TEST(StationConfig, TheShippedExampleIsTheBuiltInStation) {
  const Result<StationConfig> station =
      good(read_station_config(std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/stations/mock.station"));
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

TEST(StationConfig, RequiredKeys) {
  for (const std::string key : {"format", "site.latitude_deg", "site.gravity_mps2", "table.driver", "imu.driver"}) {
    const std::string error = config_error(without(key));
    EXPECT_SAYS(error, "my.station");
    EXPECT_SAYS(error, "'" + key + "'");
  }
}

// The sixth line of the file: a text or a number that cannot be.
std::string refusal_of(const std::string& line) {
  const std::size_t equals = line.find(" =");
  const std::string value = line.size() > equals + 3 ? line.substr(equals + 3) : "";
  return "my.station:6: key '" + line.substr(0, equals) + "' = '" + value + "': expected ";
}

TEST(StationConfig, EveryBadValueNamesFileLineKeyAndWhatWasExpected) {
  std::istringstream lines(
      "motion.settle_s = nan\nmotion.settle_s = 1 s\nmotion.poll_moving_s = 0\nmotion.poll_idle_s = 1e9\n"
      "motion.stall_s = 0\nmotion.deadline_margin_s = inf\nmotion.position_tolerance_deg = 0\n"
      "motion.settle_rate_degps = 2\naxis.roll.max_rate_degps = 0\naxis.roll.max_rate_degps = 1e9\n"
      "axis.roll.max_acceleration_degps2 = 1e300\naxis.roll.wrap_deg = 1e300\n"
      "motion.position_tolerance_deg = 1e-12\nmotion.settle_rate_degps = 1e-12\ntable.tolerance_deg = 1e-12\n"
      "dwell.max_gyro_std_degps = 1e300\ndwell.max_accel_peak_mps2 = 1e-300\n"
      "axis.pitch.max_acceleration_degps2 = -5\naxis.heading.wrap_deg = -1\naxis.heading.soft_max_deg = 4000\n"
      "table.gravity_tolerance_deg = 1e-308\nlimit.N01.max = 1e300\nlimit.N01.sigma_max = 1e-308\n"
      "stop.sigma.n11 = 1e-308\nlimit.residual_max = 1e-308\nlimit.temperature_c.min = -300\n"
      "limit.heading_deg = 1e-308\nlimit.level_deg = 400\ndwell.max_repeats = 1.5\ndwell.max_repeats = -1\n"
      "dwell.stillness_window_s = 0\nimu.timeout_s = 0\n");
  for (std::string line; std::getline(lines, line);) {
    const std::string error = config_error(minimal + line + "\n");
    EXPECT_TRUE(error.starts_with(refusal_of(line))) << error;
  }
  for (const auto& [line, expected] : {std::pair{"motion.settle_s = -1", "0, or a number between 0.001 and 3600"},
                                       {"motion.settle_s = 1e-308", "0, or a number between 0.001 and 3600"},
                                       {"resume.rest_s = 2e-10", "0, or a number between 0.001 and 86400"},
                                       {"axis.roll.wrap_deg = 1e-308", "0, or a number between 1 and 1000000"},
                                       {"limit.guard_factor = 1e-308", "0, or a number between 0.001 and 10"},
                                       {"site.gravity_uncertainty_mps2 = 1e-308", "0, or a number between 1e-09"},
                                       {"motion.poll_idle_s = 2e-10", "a number between 0.001 and 3600"},
                                       {"axis.roll.max_rate_degps = 1e-308", "a number between 0.001"},
                                       {"station.name =", "a text"}}) {
    const std::string error = config_error(minimal + line + "\n");
    EXPECT_TRUE(error.starts_with(refusal_of(line) + expected)) << error;
  }
  for (const std::string key : {"motion.settle", "axis.yaw.soft_max_deg", "table.driver"}) {  // unknown, or twice
    const std::string error = config_error(minimal + key + " = mock\n");
    EXPECT_TRUE(error.starts_with("my.station:6: key '" + key + "'")) << error;
  }
}

TEST(StationConfig, ContradictionsNameBothKeys) {
  EXPECT_EQ(config_error(minimal + "axis.roll.soft_min_deg = 90\naxis.roll.soft_max_deg = 90\n"),
            "my.station:6: key 'axis.roll.soft_min_deg' = '90': expected a number below axis.roll.soft_max_deg (90)");
  EXPECT_EQ(config_error(minimal + "axis.pitch.soft_max_deg = -600\n"),
            "my.station:6: key 'axis.pitch.soft_max_deg' = '-600': expected a number such that "
            "axis.pitch.soft_min_deg (-540, its default) is below it");
  EXPECT_EQ(config_error(minimal + "motion.poll_moving_s = 0.6\n"),
            "my.station:6: key 'motion.poll_moving_s' = '0.6': expected a number not above motion.poll_idle_s "
            "(0.5, its default)");
  EXPECT_EQ(config_error(minimal + "motion.stall_s = 0.15\n"),
            "my.station:6: key 'motion.stall_s' = '0.15': expected a number at least twice motion.poll_moving_s "
            "(0.1, its default)");
  EXPECT_EQ(config_error(minimal + "motion.settle_s = 30\n"),
            "my.station:6: key 'motion.settle_s' = '30': expected a number such that motion.deadline_margin_s "
            "(10, its default) is above it");
  EXPECT_EQ(config_error(minimal + "dwell.max_gyro_peak_degps = 0.001\ndwell.max_gyro_std_degps = 0.002\n"),
            "my.station:6: key 'dwell.max_gyro_peak_degps' = '0.001': expected a number not below "
            "dwell.max_gyro_std_degps (0.002)");
  EXPECT_EQ(config_error(minimal + "dwell.max_accel_std_mps2 = 1\n"),
            "my.station:6: key 'dwell.max_accel_std_mps2' = '1': expected a number such that "
            "dwell.max_accel_peak_mps2 (0.02, its default) is not below it");
}

}  // namespace
}  // namespace turncal
