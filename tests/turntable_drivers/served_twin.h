// For tests of the table drivers: a rig, its mock table, the twin that shows it as a real one, and a server in a thread of its own; two very
// different maps, the shipped dialects and those of our own invention.
// The station's time is the rig's and passes only with pass(); the link's time-outs are real.
#pragma once

#include "tests/test.h"

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "tests/turntable_drivers/serving.h"
#include "turntable_drivers/ascii/sentence_codec.h"
#include "turntable_drivers/modbus/register_codec.h"
#include "turntable_drivers/rig/rig_devices.h"
#include "turntable_drivers/table/described_turntable.h"
#include "turntable_drivers/twins/dialect_twin.h"
#include "turntable_drivers/twins/modbus_twin.h"

namespace turncal {

struct RealClock : Clock {
  double now_s() const override { return monotonic_s(); }
  double utc_s() const override { return 0.0; }
};

inline ModbusTwin twin_of(const RegisterMap& map, Turntable& table, const Clock& clock) { return {map, table, clock}; }
inline DialectTwin twin_of(const Dialect& dialect, Turntable& table, const Clock&) { return {dialect, table}; }

template <class Described>
class ServedTwin {
 public:
  using Description = Described;
  using Twin = decltype(twin_of(std::declval<Described>(), std::declval<Turntable&>(), std::declval<Clock&>()));
  // link: of a pseudo-terminal, a name that stays the same; "": none.
  explicit ServedTwin(const Description& description, const RigConfig& config = default_rig_config(),
                      const std::string& link = "")
      : rig(config), mock(rig), clock(rig), twin(twin_of(description, mock, clock)), described(description) {
    const Status opened = description.link.tcp ? server.listen_tcp(0) : server.open_pty(link);
    EXPECT_OK(opened);
    EXPECT_TRUE(twin.power_on().ok());
    described.link.address = link.empty() ? server.address() : link;
    serving_.emplace(twin);
  }
  void pass(double seconds) {
    const std::lock_guard lock(server.mutex);
    pass_time(rig, seconds);
  }
  void disturb(decltype(Twin::disturb) how) {
    serving_->change([&] { twin.disturb = std::move(how); });
  }
  // The adapter is back, as another device under its old name.
  void plug_in_again() {
    serving_->change([&] {
      server.hang_up();
      EXPECT_OK(server.open_pty(described.link.address));
    });
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
  Twin twin;
  LineServer& server = twin;
  Description described;  // with the server's address

 private:
  std::optional<Serving> serving_;
};

using TwinStation = ServedTwin<RegisterMap>;
using DialectStation = ServedTwin<Dialect>;

// Angles that differ from axis to axis, so that a value of another one shows.
inline constexpr AxisTriple standing{{10.0, 30.0, -50.0}};

// A driver connected to a twin whose axes stand at three different angles.
template <class Station>
struct FaultTable {
  explicit FaultTable(const typename Station::Description& description, const RigConfig& config = default_rig_config())
      : station(description, at_start(config)), driver(station.described, station.clock, &stop_requests) {
    EXPECT_OK(driver.connect());
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
        const Result<AxisStatus> now = good(driver.status(axis));
        homed = homed && now->homed && !now->moving;
      }
      if (homed) return;
    }
    FAIL() << "not homed";
  }
  // Ready, and under way to 90 deg for so long.
  void set_off(double seconds, Axis axis = Axis::roll) {
    make_ready();
    EXPECT_OK(driver.move_absolute(axis, 90.0, 10.0, 10.0));
    station.pass(seconds);
  }
  // Whatever was read is true. How many readings there were.
  int expect_truth(int rounds) {
    int read = 0;
    for (int i = 0; i < rounds; ++i) {
      for (const Axis axis : all_axes) {
        const Result<AxisStatus> now = driver.status(axis);
        if (!now) {
          last_error = now.error();
          EXPECT_SAYS_NOT(now.error().message, "\n");
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
  DescribedTurntable driver;
};

// A map of our own invention, over this kind of line; "": that of the file.
inline std::string own_map_text(const std::string& name, const std::string& kind = "") {
  const std::string text = read_whole_file(TURNCAL_SOURCE_DIR "/tests/turntable_drivers/maps/" + name + ".map").value();
  return kind.empty() ? text : replaced(text, "link.kind = tcp", "link.kind = " + kind);
}

// Three drives on one line, 32 bit, a unit id each, a heartbeat.
inline std::string plain_map_text(const std::string& kind) { return own_map_text("three_drives", kind); }
// One controller that knows only a circle, low word first, bytes swapped, no rate register, ramp times, no moving bit.
inline std::string circle_map_text(const std::string& kind) { return own_map_text("circle", kind); }
inline RegisterMap map_of(const std::string& text) { return expect_value(parse_register_map(text, "test.map")); }

inline Dialect shipped_dialect(const std::string& name, bool tcp = false) {
  const std::string folder =
      name.starts_with("own_") ? "/tests/turntable_drivers/dialects/" : "/turntable_drivers/ascii/dialects/";
  Dialect dialect = expect_value(read_dialect(TURNCAL_SOURCE_DIR + folder + name + ".dialect"));
  EXPECT_FALSE(dialect.verified_on_hardware);
  EXPECT_FALSE(dialect.commissioned);
  dialect.commissioned = true;
  dialect.link.tcp = tcp;
  dialect.link.quiet_s = 0.1;
  return dialect;
}

// For the contract of every table (table_contract.h).
template <class Station>
struct DescribedFactory {
  explicit DescribedFactory(const typename Station::Description& description) : station(description) {}
  Station station;
  DescribedTurntable driver{station.described, station.clock};
  Turntable& table() { return driver; }
  void pass(double seconds) { station.pass(seconds); }
  static constexpr double tolerance_deg = 1e-3;
  static constexpr double beyond_limits_deg = 7201.0;  // where a device answers nothing, only the driver can refuse
};

template <const std::string& text>
struct MapFactory : DescribedFactory<TwinStation> {
  MapFactory() : DescribedFactory(map_of(text)) {}
  static constexpr double beyond_limits_deg = 3601.0;  // refused by the twin
};

// With short time-outs.
struct FaultStation : FaultTable<TwinStation> {
  explicit FaultStation(bool tcp, const std::string& more = "") : FaultTable(map_of(map_text(tcp, more))) {}
  explicit FaultStation(const RegisterMap& map) : FaultTable(map) {}
  static std::string map_text(bool tcp, const std::string& more) {
    return with_keys(plain_map_text(tcp ? "tcp" : "rtu"),
                     "link.response_timeout_s = 0.15\nlink.byte_timeout_s = 0.03\n" + more);
  }
};

struct TextTable : FaultTable<DialectStation> {
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
