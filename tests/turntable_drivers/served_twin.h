// For tests of the table drivers: a rig, its mock table, the twin that shows it as a real one, and a server in a thread of its own.
// The station's time is the rig's and passes only with pass(); the link's time-outs are real.
#pragma once

#include <atomic>
#include <cmath>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "imu_io/base/clock.h"
#include "tests/rig_clock.h"
#include "turntable_drivers/rig/rig_devices.h"
#include "turntable_drivers/twins/dialect_twin.h"
#include "turntable_drivers/twins/modbus_twin.h"

namespace turncal {

struct RealClock : Clock {
  double now_s() const override { return monotonic_s(); }
  double utc_s() const override { return 0.0; }
};

struct DriveParts {
  using Description = RegisterMap;
  using Server = ModbusServer;
  static ModbusTwin twin(const RegisterMap& map, Turntable& table, const Clock& clock) {
    return ModbusTwin(map, table, clock);
  }
};
struct DialectParts {
  using Description = Dialect;
  using Server = DialectServer;
  static DialectTwin twin(const Dialect& dialect, Turntable& table, const Clock&) {
    return DialectTwin(dialect, table);
  }
};

template <class Parts>
class ServedTwin {
 public:
  using Description = typename Parts::Description;
  // link: of a pseudo-terminal, a name that stays the same; "": none.
  explicit ServedTwin(const Description& description, const RigConfig& config = default_rig_config(),
                      const std::string& link = "")
      : rig(config),
        mock(rig),
        clock(rig),
        twin(Parts::twin(description, mock, clock)),
        server(twin),
        described(description) {
    const Status opened = description.link.tcp ? server.listen_tcp(0) : server.open_pty(link);
    EXPECT_TRUE(opened.ok()) << (opened.ok() ? "" : opened.error().message);
    EXPECT_TRUE(twin.power_on().ok());
    described.link.address = link.empty() ? server.address() : link;
    start();
  }
  ~ServedTwin() { stop(); }
  void pass(double seconds) {
    std::vector<ImuSample> samples(static_cast<std::size_t>(std::lround(seconds / rig.config().sample_period_s)));
    const std::lock_guard lock(server.mutex);
    if (!samples.empty()) rig.advance(samples);
  }
  // The server's thread must not be disturbed while it works.
  void disturb(decltype(Parts::Server::disturb) how) {
    stop();
    server.disturb = std::move(how);
    start();
  }
  // The adapter is back, as another device under its old name.
  void plug_in_again() {
    stop();
    server.hang_up();
    EXPECT_TRUE(server.open_pty(described.link.address).ok());
    start();
  }
  double fastest_axis_degps() {
    const std::lock_guard lock(server.mutex);
    double fastest = 0.0;
    for (const Axis axis : all_axes) fastest = std::max(fastest, std::abs(rig.axis(axis).rate_degps));
    return fastest;
  }

  Rig rig;
  RigTable mock;
  RigClock clock;
  decltype(Parts::twin(Description(), mock, clock)) twin;
  typename Parts::Server server;
  Description described;  // with the server's address

 private:
  void start() {
    ended_ = false;
    thread_ = std::thread([this] {
      while (!ended_) server.run_once(0.01);
    });
  }
  void stop() {
    ended_ = true;
    thread_.join();
  }
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

using TwinStation = ServedTwin<DriveParts>;
using DialectStation = ServedTwin<DialectParts>;

// Angles that differ from axis to axis, so that a value of another one shows.
inline constexpr AxisTriple standing{{10.0, 30.0, -50.0}};

// A driver connected to a twin whose axes stand at three different angles.
template <class Station, class Driver>
struct FaultTable {
  explicit FaultTable(const typename Station::Description& description, const RigConfig& config = default_rig_config())
      : station(description, at_start(config)), driver(station.described, station.clock, &stop_requests) {
    const Status connected = driver.connect();
    EXPECT_TRUE(connected.ok()) << (connected.ok() ? "" : connected.error().message);
  }
  static RigConfig at_start(RigConfig config) {
    config.table.power_on_deg = standing.value;
    return config;
  }
  void make_ready() {
    ASSERT_TRUE(driver.enable().ok());
    ASSERT_TRUE(driver.home().ok());
    for (int i = 0; i < 30; ++i) {
      station.pass(0.5);
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
  // Whatever was read is true. How many readings there were.
  int expect_truth(int rounds) {
    int read = 0;
    for (int i = 0; i < rounds; ++i) {
      for (const Axis axis : all_axes) {
        const Result<AxisStatus> now = driver.status(axis);
        if (!now) {
          last_error = now.error();
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
  Error last_error;
  Station station;
  Driver driver;
};

}  // namespace turncal
