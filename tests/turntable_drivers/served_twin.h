// For tests of the table drivers: a rig, its mock table, the twin that shows it as a real one, and a server in a thread of its own; two very
// different maps, the shipped dialects and those of our own invention.
// The station's time is the rig's and passes only with pass(); the link's time-outs are real.
#pragma once

#include <atomic>
#include <cmath>
#include <functional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "imu_io/base/clock.h"
#include "tests/rig_clock.h"
#include "turntable_drivers/ascii/serial_turntable.h"
#include "turntable_drivers/modbus/modbus_turntable.h"
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

// Three drives on one line, 32 bit, a unit id each, a heartbeat.
inline std::string plain_map_text(const std::string& kind) {
  return "format = 1\nname = three plain drives\ncommissioned = true\nlink.kind = " + kind + R"(
link.response_timeout_s = 1
link.byte_timeout_s = 0.1
link.quiet_s = 0.1
axis.heading.unit = 1
axis.pitch.unit = 2
axis.roll.unit = 3
axis.heading.counts_per_degree = 10000
axis.pitch.counts_per_degree = 10000
axis.roll.counts_per_degree = 10000
axis.pitch.sign = -1
axis.roll.zero_deg = 12.5
words.order = high_first
status.address = 0x100
status.count = 6
position.address = 0x100
rate.address = 0x102
alarm.address = 0x104
alarm.type = u16
alarm.text.0x26 = overload
bit.enabled.address = 0x105
bit.enabled.mask = 1
bit.in_position.address = 0x105
bit.in_position.mask = 2
bit.fault.address = 0x105
bit.fault.mask = 4
bit.moving.address = 0x105
bit.moving.mask = 8
bit.homed.address = 0x105
bit.homed.mask = 0x10
bit.limit_positive.address = 0x105
bit.limit_positive.mask = 0x20
bit.emergency_stop.address = 0x105
bit.emergency_stop.mask = 0x40
bit.emergency_stop.active = low
bit.remote.address = 0x105
bit.remote.mask = 0x8000
write.enable = 0x200 u16 1
write.home = 0x201 u16 1, 0x201 u16 0
write.move = 0x210 s32 position + u32 rate + u32 acceleration, 0x216 u16 1
write.stop = 0x202 u16 1, 0x202 u16 0
write.abort = 0x203 u16 1
write.clear_fault = 0x204 u16 1, 0x204 u16 0
heartbeat.address = 0x220
heartbeat.period_s = 0.2
heartbeat.watchdog_s = 1
)";
}

// One controller that knows only a circle, low word first, bytes swapped, no rate register, ramp times, no moving bit.
inline std::string circle_map_text(const std::string& kind) {
  return "format = 1\nname = one odd controller\ncommissioned = true\nlink.kind = " + kind + R"(
link.quiet_s = 0.1
axis.heading.unit = 7
axis.pitch.unit = 7
axis.roll.unit = 7
axis.pitch.address_offset = 0x100
axis.roll.address_offset = 0x200
axis.heading.counts_per_degree = 36000
axis.pitch.counts_per_degree = 36000
axis.roll.counts_per_degree = 36000
axis.heading.modulo_deg = 360
axis.pitch.sign = -1
axis.pitch.zero_deg = 5
axis.pitch.modulo_deg = 360
axis.roll.modulo_deg = 360
axis.heading.acceleration_scale = 100000
axis.pitch.acceleration_scale = 100000
axis.roll.acceleration_scale = 100000
acceleration.kind = ramp_time
words.order = low_first
words.swap_bytes = true
status.function = 4
status.address = 10
status.count = 3
position.address = 11
position.type = u32
bit.enabled.address = 10
bit.enabled.mask = 1
bit.in_position.address = 10
bit.in_position.mask = 2
bit.fault.address = 10
bit.fault.mask = 4
bit.fault.active = low
bit.homed.address = 10
bit.homed.mask = 8
write.function = 16
write.enable = 30 u16 1
write.home = 31 u16 1
write.move = 40 s32 distance, 42 f32 rate, 44 u16 acceleration, 46 u16 1, wait 0.001, 46 u16 0
write.stop = 46 u16 2
write.abort = 46 u16 4
write.clear_fault = 47 u16 1
)";
}

inline RegisterMap map_of(const std::string& text) {
  const Result<RegisterMap> map = parse_register_map(text, "test.map");
  EXPECT_TRUE(map.ok()) << (map.ok() ? "" : map.error().message);
  return map.ok() ? *map : RegisterMap();
}

inline Dialect shipped_dialect(const std::string& name, bool tcp = false) {
  const std::string folder =
      name.starts_with("own_") ? "/tests/turntable_drivers/dialects/" : "/turntable_drivers/ascii/dialects/";
  const Result<Dialect> read = read_dialect(TURNCAL_SOURCE_DIR + folder + name + ".dialect");
  EXPECT_TRUE(read.ok()) << (read.ok() ? "" : read.error().message);
  if (!read) return {};
  Dialect dialect = *read;
  EXPECT_FALSE(dialect.verified_on_hardware);
  EXPECT_FALSE(dialect.commissioned);
  dialect.commissioned = true;
  dialect.link.tcp = tcp;
  dialect.link.quiet_s = 0.1;
  return dialect;
}

// With short time-outs.
struct FaultStation : FaultTable<TwinStation, ModbusTurntable> {
  explicit FaultStation(bool tcp, const std::string& more = "") : FaultTable(map_of(map_text(tcp, more))) {}
  explicit FaultStation(const RegisterMap& map) : FaultTable(map) {}
  // Short time-outs, and the lines of `more` in place of those with the same key.
  static std::string map_text(bool tcp, const std::string& more) {
    std::string text = plain_map_text(tcp ? "tcp" : "rtu");
    std::istringstream lines("link.response_timeout_s = 0.15\nlink.byte_timeout_s = 0.03\n" + more);
    for (std::string line; std::getline(lines, line);) {
      const std::size_t old = text.find("\n" + line.substr(0, line.find('=') + 1));
      if (old != std::string::npos) text.erase(old, text.find('\n', old + 1) - old);
      text += line + "\n";
    }
    return text;
  }
};

struct TextTable : FaultTable<DialectStation, SerialTurntable> {
  explicit TextTable(const std::string& name, bool tcp = false) : FaultTable(quick(shipped_dialect(name, tcp))) {}
  explicit TextTable(const Dialect& dialect) : FaultTable(dialect) {}
  static Dialect quick(Dialect dialect) {
    dialect.link.reply_timeout_s = 0.15;
    dialect.link.quiet_s = 0.06;
    return dialect;
  }
};

inline bool is_read(const ModbusRequest& request) { return request.function == 3; }
inline bool is_read(const std::string& body) { return body == "MNSTS,1"; }  // of own_dollar

using Disturbance = std::function<void(const ModbusRequest&, AnswerPlan&)>;

}  // namespace turncal
