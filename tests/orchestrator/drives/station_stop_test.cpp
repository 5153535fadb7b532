// A stop goes out within 100 ms of the request in every state of a run, whatever its devices are doing (of the drivers:
// stop_states_test.cpp). Times are of the wall clock.

#include "imu_io/lines/unit_end.h"
#include "imu_io/units/serial_imu.h"
#include "orchestrator/devices/live_devices.h"
#include "tests/imu_io/frame_streams.h"
#include "tests/orchestrator/drives/modbus_run.h"
#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/stop_request.h"

namespace turncal {
namespace {

class StationStop : public testing::TestWithParam<RunState> {};

// The stop is asked for when a state is first seen; the run goes on in the rig's time, the driver and its line in the wall clock's.
TEST_P(StationStop, GoesOutWithin100MsOfARequest) {
  expect_in_time([&] {
    ModbusRun s;
    double asked_s = 0.0;
    std::atomic<double> stop_s{0.0};
    s.watcher.on_tick = [&](const RunSnapshot& now) {
      if (now.state != GetParam() || s.stop_requests != 0) return;
      stop_s = 0.0;  // parking has sent one of its own
      asked_s = monotonic_s();
      ++s.stop_requests;
    };
    s.station.disturb([&](const ModbusRequest& request, AnswerPlan&) {
      if (request.unit == 3 && request.address == 0x202 && stop_s == 0.0) stop_s = monotonic_s();
    });
    const RunOutcome outcome = ended(s.run(), RunState::aborted);
    EXPECT_EQ(outcome.error.kind, ErrorKind::aborted);
    EXPECT_SAYS(outcome.error.message, ": stopped by the operator; the table rests, its drives are off");
    EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
    EXPECT_GT(stop_s, 0.0);
    return stop_s - asked_s;
  });
}
INSTANTIATE_TEST_SUITE_P(All, StationStop,
                         testing::Values(RunState::homing, RunState::moving, RunState::settling, RunState::dwelling,
                                         RunState::parking),
                         [](const auto& which) { return std::string(to_string(which.param)); });

// ---- in real time, on a table that does as it is told here ----

class StubTable : public Turntable {
 public:
  Status connect() override { return link_down ? lost() : Status(); }
  Result<TableIdentity> identify() override { return TableIdentity{"stub", true}; }
  Status enable() override { return {}; }
  Status home() override {
    homing = true;
    return {};
  }
  Status move_absolute(Axis, double, double, double) override { return {}; }
  Status stop_all() override {
    if (stop_s == 0.0) stop_s = monotonic_s();
    return link_down ? lost() : Status();
  }
  Status abort_all() override {
    abort_s = monotonic_s();
    return link_down ? lost() : Status();
  }
  Status clear_fault() override { return {}; }
  Result<AxisStatus> status(Axis) override {
    if (link_down) return lost().error();
    AxisStatus now;
    now.moving = homing && stop_s == 0.0;
    now.enabled = abort_s == 0.0;
    now.remote = true;
    now.time_s = monotonic_s();
    return now;
  }
  static Status lost() { return device_error("link lost"); }
  std::atomic<bool> homing{false}, link_down{false};
  std::atomic<double> stop_s{0.0}, abort_s{0.0};
};

// A live run's clock, waits and unit; the unit is on a line of which nothing comes.
struct SilentStation : TestRun {
  SilentStation() : TestRun(sequence_text), line(std::move(*good(Pty::create()))) {
    station.motion.poll_idle_s = 10.0;  // nothing but the loop itself looks at the request
    station.motion.deadline_margin_s = 2.0;
    station.imu_timeout_s = 100.0;
  }
  RunOutcome run() {
    const FrameDescription frame = test::frame_named("laser_gyro");
    SerialImu imu(frame, {line.device(), "SN1"});
    const LiveClock clock(1.0);
    return TestRun::run({table, imu, clock, LiveDevices::wait_a_little});
  }
  Pty line;
  StubTable table;
};

TEST(StationStop, HomingWithASilentUnit) {
  expect_in_time([] {
    SilentStation s;
    std::thread stopper;
    double asked_s = 0.0;
    s.watcher.on_tick = [&](const RunSnapshot& now) {
      if (now.state != RunState::homing || stopper.joinable()) return;
      stopper = std::thread([&] {
        ::usleep(30000);
        asked_s = monotonic_s();
        ++s.stop_requests;
      });
    };
    const RunOutcome outcome = s.run();
    stopper.join();
    EXPECT_EQ(outcome.state, RunState::aborted) << outcome.error.message;
    return s.table.stop_s - asked_s;
  });
}

// Neither unit nor table is there any more; the second request has to be heard in the pause between two attempts to connect.
TEST(StationStop, BetweenAttemptsToReconnect) {
  expect_in_time([] {
    SilentStation s;
    s.station.motion.poll_idle_s = 0.05;
    s.station.motion.poll_moving_s = 0.5;
    s.station.motion.deadline_margin_s = 1.0;
    std::thread stopper;
    double asked_s = 0.0, abort_s = 0.0;
    s.watcher.on_tick = [&](const RunSnapshot& now) {
      if (now.state == RunState::homing && s.table.homing) s.table.link_down = true;
      if (now.state != RunState::stopping || stopper.joinable()) return;
      s.line.unplug();
      stopper = std::thread([&] {
        ::usleep(200000);
        s.table.abort_s = 0.0;
        asked_s = monotonic_s();
        ++s.stop_requests;
        while (s.table.abort_s == 0.0) ::usleep(1000);
        abort_s = s.table.abort_s;
      });
    };
    const RunOutcome outcome = s.run();
    stopper.join();
    EXPECT_EQ(outcome.state, RunState::failed);
    EXPECT_SAYS(outcome.error.message, "COULD NOT BE VERIFIED");
    return abort_s - asked_s;
  });
}

}  // namespace
}  // namespace turncal
