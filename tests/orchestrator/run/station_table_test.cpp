// Faults of the table in a run: it is stopped, and the stop is verified.

#include "orchestrator/jobs/command_context.h"
#include "orchestrator/run/station_run.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

// Stopped soon after it: 7 s is the command of the move. A stall is seen after 2 s without progress, the deadline of a move is
// 90/10 + 2 * 10/20 + 10 = 20 s; the stop is seen to stand for 0.5 s.
TEST(StationRun, AFaultOfTheTableStopsItInTime) {
  struct Fault {
    RigFaultKind kind;
    double time_s;
    RunEvent event;
    double within_s;
    const char* says;
  };
  for (const Fault& fault :
       {Fault{RigFaultKind::stuck_axis, 9.0, RunEvent::stall, 2.5 + TableStop::stand_s, "no progress for 2 s"},
        Fault{RigFaultKind::never_in_position, 8.0, RunEvent::deadline, 19.5 + TableStop::stand_s, "pitch at "},
        Fault{RigFaultKind::axis_fault, 9.0, RunEvent::table_fault, 2.0, "axis pitch"},
        Fault{RigFaultKind::emergency_stop, 1.0, RunEvent::e_stop, 1.5, "emergency stop"},      // homing
        Fault{RigFaultKind::emergency_stop, 9.0, RunEvent::e_stop, 1.5, "emergency stop"},      // moving
        Fault{RigFaultKind::emergency_stop, 16.8, RunEvent::e_stop, 1.5, "emergency stop"},     // settling
        Fault{RigFaultKind::emergency_stop, 20.0, RunEvent::e_stop, 1.5, "emergency stop"}}) {  // dwelling
    SCOPED_TRACE(testing::Message() << to_string(fault.kind) << " at " << fault.time_s);
    RigStation s(two_steps_text, rig_with({table_fault(fault.kind, fault.time_s)}));
    const RunOutcome outcome = ended(s.run(), RunState::failed);
    EXPECT_EQ(exit_code(outcome.error.kind), 50);
    EXPECT_TRUE(s.watcher.saw(fault.event));
    EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
    EXPECT_TRUE(s.at_rest());
    EXPECT_LT(s.clock.now_s(), fault.time_s + fault.within_s);
    EXPECT_SAYS(outcome.error.message, fault.says);
  }
}

RigFault too_fast(double time_s, double rate_factor, double acceleration_factor) {
  return {.kind = RigFaultKind::too_fast,
          .time_s = time_s,
          .axis = 1,
          .rate_factor = rate_factor,
          .acceleration_factor = acceleration_factor};
}
RigFault link_lost_for(double seconds) {
  return {.kind = RigFaultKind::link_lost, .time_s = 9.0, .duration_s = seconds};
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
    EXPECT_SAYS(outcome.error.message, "times the 10 deg/s that were sent (by its own rate)");
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
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_SAYS(outcome.error.message, "at the 20 deg/s^2 that were sent");
  EXPECT_SAYS(outcome.error.message, "heading 0.0000 pitch 0.0000") << "after the second turn";
}

// A move that is made again since samples were lost is felt as a turn, not as the rest before the way back.
TEST(StationRun, TheWayBackOfAMoveThatIsRepeatedIsSupervised) {
  const std::string text =
      "format = 1\nname = moves\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 0 R 0\n  align "
      "1000\n"
      "  rotate P +20\n  rotate P -20\n  rotate P +90\n  dwell 400\n";
  // 13 s: the third move, which loses a sample at 14 s and has settled at 23 s.
  RigStation s(text, rig_with({unit_fault(RigFaultKind::lost_sample, 2400), too_fast(20.0, 1.0, 10.0)}));
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_TRUE(s.watcher.saw(RunEvent::move_bad));
  EXPECT_SAYS(outcome.error.message, "at the 20 deg/s^2 that were sent");
  EXPECT_SAYS(outcome.error.message, "pitch 0.0000") << "the way back";
}

TEST(StationRun, ADriveThatGoesOffInHomingStopsTheRun) {
  RigStation s(two_steps_text, default_rig_config());
  bool off = false;
  s.watcher.on_tick = [&](const RunSnapshot&) {
    if (!off && s.clock.now_s() > 1.0) off = s.devices.table.abort_all().ok();
  };
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_TRUE(s.watcher.saw(RunEvent::table_fault));
  EXPECT_LT(s.clock.now_s(), 3.0);
  EXPECT_SAYS(outcome.error.message, "is off");
}

TEST(StationRun, LostTableLinkIsTriedAgainForTheStopOnly) {
  RigStation s(two_steps_text, rig_with({link_lost_for(2.0)}));
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_TRUE(s.watcher.saw(RunEvent::link_lost));
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
  EXPECT_TRUE(outcome.error.message.ends_with("; the table rests, its drives are off")) << outcome.error.message;
  EXPECT_LT(s.rig.axis(Axis::pitch).position_deg, 80.0) << "stopped before the target: the stop was sent again";
}

TEST(StationRun, StopThatCannotBeVerifiedIsSaid) {
  RigStation s(two_steps_text, rig_with({table_fault(RigFaultKind::link_lost, 9.0)}));
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_FALSE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(outcome.error.message.starts_with("THE STOP COULD NOT BE VERIFIED")) << "whoever cuts the rest";
  EXPECT_SAYS(outcome.error.message, ": the link could not be opened again: ");
  EXPECT_EQ(outcome.error.message.find('\n'), std::string::npos);
}

// One that acknowledges the order to go off and stays on.
TEST(StationRun, DrivesThatStayOnAtTheEndAreSaidOnce) {
  RigStation s(two_steps_text);
  FrontTable table(s.devices.table);
  table.on_abort = [] { return Status(); };
  double parks_s = 0.0;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (parks_s == 0.0 && at.state == RunState::parking) parks_s = at.time_s;
  };
  const RunOutcome outcome = ended(s.run_on(table), RunState::failed);
  EXPECT_TRUE(outcome.stop_failed);
  EXPECT_FALSE(s.sink.finished) << "nothing is made of it";
  EXPECT_TRUE(outcome.error.message.starts_with("THE STOP COULD NOT BE VERIFIED"));
  EXPECT_SAYS(outcome.error.message, "did not switch off");
  EXPECT_LT(s.clock.now_s() - parks_s,
            2.0 * 10.0 / 20.0 + s.station.motion.stall_s + s.station.motion.deadline_margin_s + 1.0);
}

// A table that acknowledges the braking stop and turns on gets the fastest one, long before it is given up.
TEST(StationRun, ATableThatDoesNotBrakeGetsTheFastestStop) {
  RigStation s(two_steps_text);
  FrontTable table(s.devices.table);
  table.on_stop = [] { return Status(); };
  double asked_s = 0.0;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (asked_s > 0.0 || at.state != RunState::moving) return;
    asked_s = at.time_s;
    ++s.stop_requests;
  };
  ended(s.run_on(table), RunState::aborted);
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.clock.now_s() - asked_s, 2.0 * 10.0 / 20.0 + s.station.motion.stall_s + 1.0)
      << "twice the ramp, and a little";
}

// Nor is one left to turn that takes the stop only when its link is back.
TEST(StationRun, ATableThatDoesNotBrakeWhenItsLinkIsBackGetsTheFastestStop) {
  RigStation s(two_steps_text, rig_with({link_lost_for(1.0)}));
  FrontTable table(s.devices.table);
  table.on_stop = [] { return Status(); };
  const RunOutcome outcome = s.run_on(table);
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified)) << outcome.error.message;
  EXPECT_TRUE(s.at_rest());
  EXPECT_LT(s.rig.axis(Axis::pitch).position_deg, 80.0) << "before its target";
}

// Nothing is homed while an axis reads as turning: a run that is taken up at such a table ends, and leaves no drive on.
TEST(StationRun, ATableThatDoesNotComeToRestIsNotHomed) {
  RigStation s(two_steps_text);
  FrontTable table(s.devices.table);
  table.on_read = [](Axis axis, AxisStatus& now) { now.moving = now.moving || axis == Axis::pitch; };
  table.on_home = [] { return device_error("homed"); };
  const RunOutcome outcome = ended(s.run_on(table), RunState::failed);
  EXPECT_EQ(exit_code(outcome.error.kind), 50);
  EXPECT_SAYS(outcome.error.message, "does not come to rest");
  EXPECT_GT(table.aborts, 1) << "the fastest stop goes out until the deadline";
  const MotionConfig& motion = s.station.motion;
  const double stop_s = 2.0 * 10.0 / 20.0 + motion.stall_s;
  EXPECT_LT(s.clock.now_s(), 2.0 * stop_s + motion.deadline_margin_s + 2.0);
}

}  // namespace
}  // namespace turncal
