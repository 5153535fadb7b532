// For tests of a whole run over the Modbus driver: the station's own loop, the driver, the twin and the rig, in the rig's time.
#pragma once

#include "orchestrator/run/station_run.h"
#include "tests/orchestrator/rig_station.h"
#include "tests/turntable_drivers/served_twin.h"
#include "turntable_drivers/table/limited_turntable.h"

namespace turncal {

// Times, with settle 0.5 s, at 10 deg/s and 10 deg/s^2: homing 0..2; align ..3; 20 deg in 3 s and settling ..6.5; dwell ..8.5;
// back ..12.
inline const char* const sequence_text =
    "format = 1\nname = short\nrate_degps = 10\nacceleration_degps2 = 10\n"
    "step 1\n  initial H 0 P 0 R 0\n  align 200\n  rotate P +20\n  dwell 400\n  rotate P -20\n";
inline constexpr double in_mid_move_s = 4.5, in_settling_s = 6.3;

// The rig's unit, read while the server's thread uses the rig too.
class LockedImu : public FrontImu {
 public:
  LockedImu(ImuSource& imu, std::mutex& mutex) : FrontImu(imu), mutex_(mutex) {}
  Status open() override {
    const std::lock_guard lock(mutex_);
    return imu_.open();
  }
  Result<ImuIdentity> identify() override {
    const std::lock_guard lock(mutex_);
    return imu_.identify();
  }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    const std::lock_guard lock(mutex_);
    return imu_.read(out, timeout_s);
  }

 private:
  std::mutex& mutex_;
};

struct ModbusRun : TestRun {
  explicit ModbusRun(const RigConfig& rig_config = default_rig_config(), const std::string& pty_link = "",
                     const std::string& text = sequence_text)
      : TestRun(text),
        station(quick_map(pty_link.empty() ? "tcp" : "rtu"), rig_config, pty_link),
        driver(station.described, station.clock, &stop_requests),
        limited(driver, {}) {}
  static RegisterMap quick_map(const char* kind) {
    RegisterMap map = map_of(plain_map_text(kind));
    map.link.reply_timeout_s = 0.1;
    map.link.byte_timeout_s = 0.03;
    map.link.quiet_s = 0.05;
    return map;
  }
  RunOutcome run() {
    RigImu rig_imu(station.rig);
    LockedImu imu(rig_imu, station.server.mutex);
    const RunOutcome outcome =
        TestRun::run({limited, imu, station.clock, [this](double seconds) { station.pass(std::max(seconds, 0.005)); }});
    const std::lock_guard lock(station.server.mutex);
    for (const Axis axis : all_axes)
      EXPECT_EQ(station.rig.axis(axis).rate_degps, 0.0) << "the table moves on: " << outcome.error.message;
    return outcome;
  }
  double rig_time_s() { return station.rig.time_s(); }

  TwinStation station;
  StationConfig& config = TestRun::station;
  DescribedTurntable driver;
  LimitedTurntable limited;
};

}  // namespace turncal
