// What a live run needs besides the rig: a driver that gives up on the operator's word, a person who turns the table, keys of the
// station, gravity. The whole over real lines: tests/system/two_units_over_the_wire_test.sh.

#include "imu_io/base/clock.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/jobs/command_context.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

const char* const short_text =
    "format = 1\nname = short\nrate_degps = 10\nacceleration_degps2 = 20\n"
    "step 1 \"there\"\n  initial H 0 P 0 R 0\n  align 1000\n  rotate P +90\n  dwell 1000\n";

struct FrontStation : RigStation {
  explicit FrontStation(const std::string& text = short_text) : RigStation(text), table(devices.table) {}
  FrontTable table;
};

TEST(LiveRun, DriverThatGivesUpOnTheOperatorsWordIsAStopNotALostLink) {
  FrontStation s;
  // As the drivers do: the count goes up while one waits for the device; once a stop was sent they answer again.
  s.table.on_status = [&]() -> Status {
    if (s.rig.time_s() > 10.0) s.stop_requests = 1;
    if (s.stop_requests == 0 || s.table.stops > 0) return {};
    return Error{ErrorKind::aborted, "gave up waiting"};
  };
  const RunOutcome outcome = ended(s.run_on(s.table), RunState::aborted);
  EXPECT_EQ(outcome.error.kind, ErrorKind::aborted);
  EXPECT_FALSE(s.watcher.saw(RunEvent::link_lost));
  EXPECT_EQ(s.watcher.count(RunEvent::operator_stop), 1) << "one request is one stop, not a stop and a fastest stop";
  EXPECT_TRUE(s.at_rest());
}

TEST(LiveRun, MoveThatTheOperatorCutsShortIsAStopToo) {
  FrontStation s;
  s.table.on_move = [&](Axis, double) -> Status {
    s.stop_requests = 1;
    return Error{ErrorKind::aborted, "gave up waiting"};
  };
  ended(s.run_on(s.table), RunState::aborted);
  EXPECT_FALSE(s.watcher.saw(RunEvent::table_fault));
  EXPECT_EQ(s.watcher.count(RunEvent::operator_stop), 1);
}

// A drive that its watchdog, or a fault, stopped: the run that is taken up clears it, another one does not.
TEST(LiveRun, OnlyARunTakenUpClearsAFault) {
  RigStation s(short_text, rig_with({table_fault(RigFaultKind::axis_fault, 9.0)}));
  EXPECT_EQ(exit_code(s.run().error.kind), 50);
  ASSERT_EQ(s.kept.dwells.size(), 1u);
  const RunOutcome another = s.run();
  EXPECT_EQ(exit_code(another.error.kind), 50);
  EXPECT_SAYS(another.error.message, "expected it cleared");
  s.resume = ResumePoint{s.kept.dwells.front(), false};
  s.station.resume_rest_s = 1.0;
  s.taken_up = true;
  s.watcher = Watcher();
  ended(s.run(), RunState::done);
  ASSERT_TRUE(s.watcher.saw(RunEvent::connected));
  EXPECT_SAYS(s.watcher.transitions[1].detail, "clears the fault of axis pitch");
}

TEST(LiveRun, FaultThatStaysIsAFault) {
  FrontStation s;
  s.taken_up = true;
  s.table.on_read = [](Axis, AxisStatus& now) { now.fault = true; };  // the drive takes the request, and does nothing
  const RunOutcome outcome = ended(s.run_on(s.table), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_FALSE(s.watcher.saw(RunEvent::homed));
}

TEST(LiveRun, PersonMayTakeLongerThanAnyMotor) {
  for (const bool by_hand : {true, false}) {
    FrontStation s;
    s.table.by_hand = by_hand;
    double asked_s = -1.0;
    // Turned ten minutes after it was asked for.
    s.table.on_move = [&](Axis, double) -> Status {
      asked_s = s.rig.time_s();
      return {};
    };
    s.table.on_status = [&]() -> Status {
      if (asked_s < 0.0 || s.rig.time_s() < asked_s + 600.0) return {};
      asked_s = -1.0;
      return s.devices.table.move_absolute(Axis::pitch, 90.0, 10.0, 20.0);
    };
    const RunOutcome outcome = s.run_on(s.table);
    EXPECT_EQ(outcome.state, by_hand ? RunState::done : RunState::failed) << outcome.error.message;
    EXPECT_EQ(s.watcher.saw(RunEvent::stall), !by_hand);
  }
}

TEST(LiveRun, TimeRunsAsFastAsTheStationSays) {
  const LiveClock clock(50.0);
  const double began_s = monotonic_s(), at_s = clock.now_s();
  while (monotonic_s() - began_s < 0.02) {
  }
  const double passed_s = clock.now_s() - at_s, wall_s = monotonic_s() - began_s;
  EXPECT_GE(passed_s, 50.0 * 0.02 * 0.999);
  EXPECT_LE(passed_s, 50.0 * wall_s);
}

TEST(LiveRun, GravityIsTheLastSecondsMeanOnceTheUnitRests) {
  Rig rig(default_rig_config());
  RigImu unit(rig);
  GravityWatch watch(unit, 0.005);
  ASSERT_TRUE(watch.open().ok());
  std::vector<ImuSample> samples(100);
  ASSERT_TRUE(watch.read(samples, 0.5).ok());
  EXPECT_FALSE(watch.mean()) << "half a second is not enough";
  ASSERT_TRUE(watch.read(samples, 0.5).ok());
  const auto level = watch.mean();
  ASSERT_TRUE(level);
  const double g = std::hypot((*level)[0], (*level)[1], (*level)[2]);
  EXPECT_NEAR(g, 9.7914 * 0.005 / 0.0005, 0.1 * g);  // pulses, scale factors within 5 %
  EXPECT_GT((*level)[1], 0.99 * g);
  rig.command_move(Axis::pitch, 90.0, 50.0, 100.0);
  bool moved = false;
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(watch.read(samples, 0.5).ok());
    moved = moved || !watch.mean();
  }
  EXPECT_TRUE(moved);
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(watch.read(samples, 0.5).ok());
  ASSERT_TRUE(watch.mean());
  const auto up = *watch.mean();
  EXPECT_GT(up[0], 0.99 * std::hypot(up[0], up[1], up[2])) << "pitch 90: x up";
}

Result<StationConfig> station_with(const std::string& keys) {
  return parse_station_config(live_station(keys, "/dev/x"), "x.station");
}

TEST(LiveRun, TimeRunsFasterForTwinsOnly) {
  const std::string twins = "table.simulated = true\nimu.simulated = true\n";
  const Result<StationConfig> real = good(station_with(""));
  EXPECT_FALSE(real->simulated());
  const Result<StationConfig> fast = good(station_with(twins + "clock.speed_up = 50\n"));
  EXPECT_TRUE(fast->simulated());
  EXPECT_EQ(fast->imu->settings.speedup, 50.0);
  for (const char* one : {"table.simulated = true\n", "imu.simulated = true\n"})
    EXPECT_TRUE(good(station_with(one))->simulated()) << one;
}

}  // namespace
}  // namespace turncal
