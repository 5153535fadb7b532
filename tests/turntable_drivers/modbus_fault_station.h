// For tests of the Modbus driver's faults: a twin whose axes stand at three different angles, and a driver with short time-outs.
#pragma once

#include <algorithm>
#include <functional>

#include "imu_io/deadline.h"
#include "tests/turntable_drivers/twin_station.h"

namespace turncal {

// Angles that differ from axis to axis, so that a value of another one shows.
inline constexpr AxisTriple standing{{10.0, 30.0, -50.0}};

struct FaultStation {
  explicit FaultStation(bool tcp, const std::string& more = "") : FaultStation(tcp, more, default_rig_config()) {}
  FaultStation(bool tcp, const std::string& more, const RigConfig& config) : FaultStation(map_of(map_text(tcp, more)), config) {}
  FaultStation(const RegisterMap& described, const RigConfig& config)
      : map(described), station(map, at_start(config)), driver(station.driver_map, station.clock, &stop_requests) {
    const Status connected = driver.connect();
    EXPECT_TRUE(connected.ok()) << (connected.ok() ? "" : connected.error().message);
  }
  static std::string map_text(bool tcp, const std::string& more) {
    std::string text = plain_map_text(tcp ? "tcp" : "rtu") + more;
    const auto replace = [&text](const std::string& what, const std::string& with) {
      text.replace(text.find(what), what.size(), with);
    };
    replace("response_timeout_s = 1", "response_timeout_s = 0.15");
    replace("byte_timeout_s = 0.1", "byte_timeout_s = 0.03");
    return text;
  }
  static RigConfig at_start(RigConfig config) {
    config.table.power_on_deg = standing.value;
    return config;
  }
  void make_ready() {
    ASSERT_TRUE(driver.enable().ok());
    ASSERT_TRUE(driver.home().ok());
    for (int i = 0; i < 100; ++i) {
      station.pass(0.1);
      bool homed = true;
      for (const Axis axis : all_axes) {
        const Result<AxisStatus> now = driver.status(axis);
        ASSERT_TRUE(now.ok()) << now.error().message;
        homed = homed && now->homed && !now->moving;
      }
      if (homed) return;
    }
    FAIL() << "not homed";
  }
  double rig_rate() {
    const std::lock_guard lock(station.server.mutex);
    double fastest = 0.0;
    for (const Axis axis : all_axes) fastest = std::max(fastest, std::abs(station.rig.axis(axis).rate_degps));
    return fastest;
  }
  // Whatever was read is true.
  int expect_truth(int rounds) {
    int read = 0;
    for (int i = 0; i < rounds; ++i) {
      for (const Axis axis : all_axes) {
        const Result<AxisStatus> now = driver.status(axis);
        if (!now) {
          EXPECT_EQ(now.error().message.find('\n'), std::string::npos);
          continue;
        }
        ++read;
        EXPECT_NEAR(now->position_deg, standing[axis], 1e-3) << to_string(axis);
      }
    }
    return read;
  }

  std::atomic<int> stop_requests{0};
  RegisterMap map;
  TwinStation station;
  ModbusTurntable driver;
};

inline bool is_read(const ModbusRequest& request) { return request.function == 3; }

using Disturbance = std::function<void(const ModbusRequest&, AnswerPlan&)>;

}  // namespace turncal
