// Faults of the table in a run: it is stopped, and the stop is verified.
#include <gtest/gtest.h>

#include "orchestrator/jobs/command_context.h"
#include "orchestrator/run/station_run.h"
#include "tests/orchestrator/run/rig_faults.h"
#include "turntable_drivers/table/limited_turntable.h"

namespace turncal {
namespace {

TEST(StationRun, StuckAxisIsAStall) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::stuck_axis, 9.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::stall));
  // 7 s: command; stuck at 9 s; 2 s without progress, seen at the next poll; the stop is seen to stand for 0.5 s, two polls more.
  EXPECT_LT(s.clock.now_s(), 11.5 + TableStop::stand_s);
  EXPECT_NE(outcome.error.message.find("pitch at 1"), std::string::npos) << outcome.error.message;
  EXPECT_NE(outcome.error.message.find("no progress for 2 s"), std::string::npos) << outcome.error.message;
}

RigFault too_fast(double time_s, double rate_factor, double acceleration_factor) {
  RigFault fault = table_fault(RigFaultKind::too_fast, time_s);
  fault.rate_factor = rate_factor;
  fault.acceleration_factor = acceleration_factor;
  return fault;
}

// Where the drive tells its rate, and where it does not.
TEST(StationRun, ATableThatTurnsTooFastIsStopped) {
  for (const double factor : {1.5, 8.0, 15.0}) {
    RigStation s(two_steps_text, rig_with({too_fast(5.0, factor, factor)}));
    double fastest_degps = 0.0;
    s.watcher.on_tick = [&](const RunSnapshot&) {
      fastest_degps = std::max(fastest_degps, std::abs(s.rig.axis(Axis::pitch).rate_degps));
    };
    const RunOutcome outcome = s.run();
    EXPECT_EQ(outcome.state, RunState::failed) << factor;
    EXPECT_EQ(exit_code(outcome.error.kind), 50);
    EXPECT_NE(outcome.error.message.find("times the 10 deg/s that were sent (by its own rate)"), std::string::npos)
        << outcome.error.message;
    EXPECT_TRUE(s.at_rest());
    // 12.5 deg/s is the limit; a poll of 0.1 s at 20 deg/s^2 times the factor.
    EXPECT_LT(fastest_degps, std::min(10.0 * factor, 12.5 + 0.2 * 20.0 * factor) + 0.1) << factor;
  }
}

TEST(StationRun, ATableThatIsSpedUpTooQuicklyIsStoppedOnceTheUnitsScaleIsKnown) {
  RigStation s(
      "format = 1\nname = turns\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1 \"there and back\"\n"
      "  initial H 0 P 0 R 0\n  align 1000\n  rotate P +90\n  rotate P -90\n  rotate P +90\n  rotate P -90\n"
      "  dwell 1000\n",
      rig_with({too_fast(17.0, 1.0, 10.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_NE(outcome.error.message.find("than the 20 deg/s^2 that were sent"), std::string::npos)
      << outcome.error.message;
  EXPECT_NE(outcome.error.message.find("heading 0.0000 pitch 0.0000"), std::string::npos)
      << "after the second turn: " << outcome.error.message;
}

// A move that is made again since samples were lost is felt as a turn, not as the rest before the way back.
TEST(StationRun, TheWayBackOfAMoveThatIsRepeatedIsSupervised) {
  const std::string text =
      "format = 1\nname = moves\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 0 R 0\n  align "
      "1000\n"
      "  rotate P +20\n  rotate P -20\n  rotate P +90\n  dwell 400\n";
  // 13 s: the third move, which loses a sample at 14 s and has settled at 23 s.
  RigStation s(text, rig_with({unit_fault(RigFaultKind::lost_sample, 2400), too_fast(20.0, 1.0, 10.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_TRUE(s.watcher.saw(RunEvent::move_bad));
  EXPECT_NE(outcome.error.message.find("than the 20 deg/s^2 that were sent"), std::string::npos)
      << outcome.error.message;
  EXPECT_NE(outcome.error.message.find("pitch 0.0000"), std::string::npos) << "the way back: " << outcome.error.message;
}

TEST(StationRun, NeverInPositionRunsIntoTheDeadline) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::never_in_position, 8.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::deadline));
  EXPECT_FALSE(s.watcher.saw(RunEvent::arrived));
  // 90/10 + 2 * 10/20 + 10 = 20 s after the command at 7 s, and the stop.
  EXPECT_NEAR(s.clock.now_s(), 27.0 + TableStop::stand_s, 0.5);
}

TEST(StationRun, LyingInPositionFlagsDoNotFoolIt) {
  for (const InPositionFlag flag : {InPositionFlag::servo_on, InPositionFlag::after_stop, InPositionFlag::stale,
                                    InPositionFlag::late, InPositionFlag::flicker}) {
    RigConfig config = default_rig_config();
    config.table.in_position = flag;
    RigStation s(two_steps_text, config);
    const RunOutcome outcome = s.run();
    ASSERT_EQ(outcome.state, RunState::done) << static_cast<int>(flag) << ": " << outcome.error.message;
    for (const Segment& segment : s.sink.segments) {
      if (segment.kind != SegmentKind::rotate) continue;
      const std::int64_t length = segment.end_sample - segment.start_sample;
      EXPECT_GE(length, 2000) << "flag " << static_cast<int>(flag) << ": arrival was believed too early";
      EXPECT_LE(length, 2000 + 500) << static_cast<int>(flag);
    }
  }
}

TEST(StationRun, AxisFaultStops) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::axis_fault, 9.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::table_fault));
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.clock.now_s(), 11.0);
}

TEST(StationRun, ADriveThatGoesOffInHomingStopsTheRun) {
  RigStation s(two_steps_text, default_rig_config());
  bool off = false;
  s.watcher.on_tick = [&](const RunSnapshot&) {
    if (!off && s.clock.now_s() > 1.0) off = s.devices.table.abort_all().ok();
  };
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_TRUE(s.watcher.saw(RunEvent::table_fault));
  EXPECT_LT(s.clock.now_s(), 3.0);
  EXPECT_NE(outcome.error.message.find("is off"), std::string::npos) << outcome.error.message;
}

TEST(StationRun, EmergencyStopEndsTheRun) {
  for (const double time_s : {1.0, 9.0, 16.8, 20.0}) {  // homing, moving, settling, dwelling
    RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::emergency_stop, time_s)}));
    const RunOutcome outcome = s.run();
    EXPECT_EQ(outcome.state, RunState::failed) << time_s;
    EXPECT_EQ(exit_code(outcome.error.kind), 50);
    EXPECT_TRUE(s.watcher.saw(RunEvent::e_stop)) << time_s;
    EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified)) << time_s;
    EXPECT_TRUE(s.at_rest());
    EXPECT_LT(s.clock.now_s(), time_s + 1.5);
  }
}

TEST(StationRun, LostTableLinkIsTriedAgainForTheStopOnly) {
  RigFault lost = table_fault(RigFaultKind::link_lost, 9.0);
  lost.duration_s = 2.0;
  RigStation s(two_steps_text, rig_with({lost}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::link_lost));
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
  EXPECT_TRUE(outcome.error.message.ends_with("; the table rests, its drives are off")) << outcome.error.message;
  EXPECT_LT(s.rig.axis(Axis::pitch).position_deg, 80.0) << "stopped before the target: the stop was sent again";
}

TEST(StationRun, StopThatCannotBeVerifiedIsSaid) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::link_lost, 9.0)}));
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_FALSE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_NE(outcome.error.message.find("COULD NOT BE VERIFIED"), std::string::npos) << outcome.error.message;
  EXPECT_NE(outcome.error.message.find(": the link could not be opened again: "), std::string::npos)
      << outcome.error.message;
  EXPECT_EQ(outcome.error.message.find('\n'), std::string::npos);
}

// A table that acknowledges the braking stop and turns on gets the fastest one, long before it is given up.
class UnbrakedTable : public LimitedTurntable {
 public:
  explicit UnbrakedTable(Turntable& table) : LimitedTurntable(table, {}) {}
  Status stop_all() override { return {}; }
};

// One that acknowledges the order to go off and stays on.
class KeptOnTable : public LimitedTurntable {
 public:
  explicit KeptOnTable(Turntable& table) : LimitedTurntable(table, {}) {}
  Status abort_all() override { return {}; }
};

TEST(StationRun, DrivesThatStayOnAtTheEndAreSaidOnce) {
  RigStation s(two_steps_text);
  const StationDevices devices = s.devices.devices();
  KeptOnTable table(devices.table);
  double parks_s = 0.0;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (parks_s == 0.0 && at.state == RunState::parking) parks_s = at.time_s;
  };
  const RunOutcome outcome = s.run({table, devices.imu, devices.clock, devices.wait});
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_TRUE(outcome.stop_failed);
  EXPECT_FALSE(s.sink.finished) << "nothing is made of it";
  EXPECT_NE(outcome.error.message.find("did not switch off; THE STOP COULD NOT BE VERIFIED"), std::string::npos)
      << outcome.error.message;
  EXPECT_LT(s.clock.now_s() - parks_s,
            2.0 * 10.0 / 20.0 + s.station.motion.stall_s + s.station.motion.deadline_margin_s + 1.0);
}

TEST(StationRun, ATableThatDoesNotBrakeGetsTheFastestStop) {
  RigStation s(two_steps_text);
  const StationDevices devices = s.devices.devices();
  UnbrakedTable table(devices.table);
  double asked_s = 0.0;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (asked_s > 0.0 || at.state != RunState::moving) return;
    asked_s = at.time_s;
    ++s.stop_requests;
  };
  const RunOutcome outcome = s.run({table, devices.imu, devices.clock, devices.wait});
  EXPECT_EQ(outcome.state, RunState::aborted) << outcome.error.message;
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.clock.now_s() - asked_s, 2.0 * 10.0 / 20.0 + s.station.motion.stall_s + 1.0)
      << "twice the ramp, and a little";
}

// Nor is one left to turn that takes the stop only when its link is back.
TEST(StationRun, ATableThatDoesNotBrakeWhenItsLinkIsBackGetsTheFastestStop) {
  RigFault lost = table_fault(RigFaultKind::link_lost, 9.0);
  lost.duration_s = 1.0;
  RigStation s(two_steps_text, rig_with({lost}));
  const StationDevices devices = s.devices.devices();
  UnbrakedTable table(devices.table);
  const RunOutcome outcome = s.run({table, devices.imu, devices.clock, devices.wait});
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified)) << outcome.error.message;
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.rig.axis(Axis::pitch).position_deg, 80.0) << "before its target";
}

// Nothing is homed while an axis reads as turning: a run that is taken up at such a table ends, and leaves no drive on.
TEST(StationRun, ATableThatDoesNotComeToRestIsNotHomed) {
  struct Turning : LimitedTurntable {
    using LimitedTurntable::LimitedTurntable;
    Result<AxisStatus> status(Axis axis) override {
      Result<AxisStatus> now = LimitedTurntable::status(axis);
      if (now && axis == Axis::pitch) now->moving = true;
      return now;
    }
    Status home() override {
      ADD_FAILURE() << "homed";
      return {};
    }
    Status abort_all() override {
      ++aborts;
      return LimitedTurntable::abort_all();
    }
    int aborts = 0;
  };
  RigStation s(two_steps_text);
  const StationDevices devices = s.devices.devices();
  Turning table(devices.table, {});
  const RunOutcome outcome = s.run({table, devices.imu, devices.clock, devices.wait});
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_NE(outcome.error.message.find("does not come to rest"), std::string::npos) << outcome.error.message;
  EXPECT_GT(table.aborts, 1) << "the fastest stop goes out until the deadline";
  const MotionConfig& motion = s.station.motion;
  const double stop_s = 2.0 * 10.0 / 20.0 + motion.stall_s;
  EXPECT_LT(s.clock.now_s(), 2.0 * stop_s + motion.deadline_margin_s + 2.0);
}

}  // namespace
}  // namespace turncal
