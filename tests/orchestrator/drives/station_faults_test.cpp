// Faults of a drive in the middle of a run: the station's own loop, the Modbus driver, the twin and the rig. Whatever the drive says or
// does, the run ends with the table at rest and an error of the right kind, or goes through with the very plan.

#include "orchestrator/jobs/command_context.h"

#include "tests/orchestrator/drives/modbus_run.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

RigConfig pitch_with(RigFaultKind kind, double time_s) { return rig_with({table_fault(kind, time_s)}); }

// Changes the register at `offset` of pitch's status block (0 to 5) in every reading.
std::function<void(const ModbusRequest&, AnswerPlan&)> in_block(
    const std::function<void(std::vector<std::uint16_t>&)>& how) {
  return [how](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function != 3 || request.unit != 2) return;
    std::vector<std::uint16_t> words;
    const Frame& bytes = plan.pieces[0].bytes;
    for (std::size_t i = 9; i + 1 < bytes.size(); i += 2) words.push_back(std::uint16_t(bytes[i] << 8 | bytes[i + 1]));
    how(words);
    plan.pieces[0].bytes = read_reply(request, words, true);
  };
}

TEST(StationFaults, UndisturbedRunIsThePlan) {
  ModbusRun s;
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_EQ(outcome.units[0].next_sample, s.plan.samples);
}

// A flag that lies: the run goes through, for arrival is more than the flag; and no dwell is taken while the table turns.
TEST(StationFaults, InPositionLies) {
  for (const InPositionFlag flag : {InPositionFlag::servo_on, InPositionFlag::after_stop, InPositionFlag::stale,
                                    InPositionFlag::late, InPositionFlag::flicker}) {
    RigConfig config = default_rig_config();
    config.table.in_position = flag;
    ModbusRun s(config);
    const RunOutcome outcome = s.run();
    ASSERT_EQ(outcome.state, RunState::done) << int(flag) << ": " << outcome.error.message;
    ASSERT_EQ(s.sink.segments.size(), 4u);
    EXPECT_EQ(s.sink.segments[2].end_sample - s.sink.segments[2].start_sample, 400) << "the dwell";
    EXPECT_GE(s.sink.segments[2].start_sample, 200 + 700) << "not before the table stood";
    EXPECT_LE(s.sink.segments[2].start_sample, 200 + 700 + 500) << "nor long after";
    EXPECT_EQ(outcome.repeated_dwells, 0);
  }
}

struct DriveFault {
  const char* name;
  RigConfig config;
  std::function<void(ModbusRun&)> prepare;
  RunEvent event;
  const char* says;
};
void PrintTo(const DriveFault& fault, std::ostream* out) { *out << fault.name; }

std::vector<DriveFault> drive_faults() {
  const auto from_moment = [](double at_s, const std::function<void(std::vector<std::uint16_t>&)>& how) {
    return [=](ModbusRun& s) {
      s.station.disturb(in_block([&s, at_s, how](std::vector<std::uint16_t>& words) {
        if (s.rig_time_s() >= at_s) how(words);
      }));
    };
  };
  const auto frozen = [](ModbusRun& s) {
    s.station.disturb(in_block([&s, kept = std::vector<std::uint16_t>()](std::vector<std::uint16_t>& words) mutable {
      if (s.rig_time_s() < in_mid_move_s) {
        kept = words;
      } else {
        words = kept;
      }
    }));
  };
  using Change = std::function<void(const ModbusRequest&, AnswerPlan&)>;
  const auto reads = [](const Change& how) {  // from mid-move on
    return [how](ModbusRun& s) {
      s.station.disturb([&s, how](const ModbusRequest& request, AnswerPlan& plan) {
        if (request.function == 3 && s.rig_time_s() > in_mid_move_s) how(request, plan);
      });
    };
  };
  const auto moves = [](const Change& how) {
    return [how](ModbusRun& s) {
      s.station.disturb([how](const ModbusRequest& request, AnswerPlan& plan) {
        if (request.function == 16) how(request, plan);
      });
    };
  };
  const auto refused = [](int code) {
    return [code](const ModbusRequest& request, AnswerPlan& plan) {
      plan.pieces[0].bytes = exception_reply(request, code, true);
    };
  };
  const auto from_mid_move = [&](const std::function<void(std::vector<std::uint16_t>&)>& how) {
    return from_moment(in_mid_move_s, how);
  };
  const auto no_answer = [](const ModbusRequest&, AnswerPlan& plan) { plan.pieces.clear(); };
  // Every reading takes half a second of the wall clock: the stop is given up sooner.
  const auto busy = [=](ModbusRun& s) {
    s.config.motion.stall_s = 1.0;
    s.config.motion.deadline_margin_s = 2.0;
    s.config.motion.poll_moving_s = 0.5;
    reads(refused(6))(s);
  };
  const auto stays_further = [](auto& words) { words[1] = std::uint16_t(words[1] - 500); };
  const RigConfig plain = default_rig_config();
  using enum RunEvent;
  using Kind = RigFaultKind;
  return {
      {"never_in_position", pitch_with(Kind::never_in_position, 3.0), {}, deadline, "has not settled"},
      {"position_frozen", plain, frozen, stall, "no progress"},
      {"axis_stuck", pitch_with(Kind::stuck_axis, in_mid_move_s), {}, stall, "no progress"},
      {"drive_fault", pitch_with(Kind::axis_fault, in_mid_move_s), {}, RunEvent::table_fault, "alarm 38 (overload)"},
      {"emergency_stop", pitch_with(Kind::emergency_stop, in_mid_move_s), {}, e_stop, "emergency stop"},
      {"limit", plain, from_mid_move([](auto& words) { words[5] |= 0x20; }), RunEvent::table_fault, "limit switch"},
      {"local_mode", plain, from_mid_move([](auto& words) { words[5] &= 0x7FFF; }), RunEvent::table_fault,
       "not in remote"},
      {"drive_off", plain, from_mid_move([](auto& words) { words[5] &= 0xFFFE; }), RunEvent::table_fault, "is off"},
      {"zero_lost", plain, from_mid_move([](auto& words) { words[5] &= 0xFFEF; }), RunEvent::table_fault,
       "lost its zero"},
      {"words_swapped", plain, from_mid_move([](auto& words) { std::swap(words[0], words[1]); }), RunEvent::table_fault,
       "not believed"},
      {"overshoot_that_stays", plain, from_moment(6.0, stays_further), stall, "no progress"},
      {"silent_in_mid_move", plain, reads(no_answer), link_lost, "no answer within"},
      {"busy_for_ever", plain, busy, RunEvent::table_fault, "exception 6"},
      {"move_refused", plain, moves(refused(4)), RunEvent::table_fault, "exception 4"},
      {"move_refused_as_an_address", plain, moves(refused(2)), RunEvent::table_fault, "exception 2"},
      {"reading_refused_as_a_value", plain, reads(refused(3)), RunEvent::table_fault, "exception 3"},
      {"reading_refused_as_a_failure", plain, reads(refused(4)), RunEvent::table_fault, "exception 4"},
  };
}

class StationDriveFaults : public testing::TestWithParam<DriveFault> {};

TEST_P(StationDriveFaults, TableStopsAndTheRunSaysWhy) {
  const DriveFault& fault = GetParam();
  ModbusRun s(fault.config);
  if (fault.prepare) fault.prepare(s);
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(outcome.error.kind, ErrorKind::device);
  EXPECT_TRUE(s.watcher.saw(fault.event)) << outcome.error.message;
  EXPECT_SAYS(outcome.error.message, fault.says);
  // Nothing was recorded as a rest after the fault.
  for (const Segment& segment : s.sink.segments)
    if (segment.kind == SegmentKind::still) ADD_FAILURE() << "a dwell was recorded";
}
INSTANTIATE_TEST_SUITE_P(All, StationDriveFaults, testing::ValuesIn(drive_faults()),
                         [](const auto& which) { return std::string(which.param.name); });

// Before anything was told to move a register that the drive does not know is a mistake of the map; homing is a motion.
TEST(StationFaults, AnIllegalAddressIsTheMapsUntilSomethingMoves) {
  constexpr int enable_register = 0x200, home_register = 0x201;
  for (const int refused : {enable_register, home_register}) {
    ModbusRun s;
    s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
      if (request.function == 6 && request.address == refused) plan.pieces[0].bytes = exception_reply(request, 2, true);
    });
    const RunOutcome outcome = ended(s.run(), RunState::failed);
    EXPECT_EQ(exit_code(outcome.error.kind), refused == enable_register ? 1 : 50) << outcome.error.message;
    // No angle was read before the enabling.
    EXPECT_EQ(outcome.error.message.find(" at heading ") == std::string::npos, refused == enable_register)
        << outcome.error.message;
  }
}

// An overshoot that comes back, and a flicker of the position after done: the settle time begins anew, the dwell is good.
TEST(StationFaults, OvershootThatComesBack) {
  ModbusRun s;
  s.station.disturb(in_block([&s](std::vector<std::uint16_t>& words) {
    if (s.rig_time_s() > 6.0 && s.rig_time_s() < 6.6) words[1] = std::uint16_t(words[1] - 500);  // 0.05 deg further
  }));
  ended(s.run(), RunState::done);
  EXPECT_GE(s.sink.segments[2].start_sample, 200 + 720);
}

// The table drifts during the dwell: it counts only when it is repeated.
TEST(StationFaults, DriftAfterDone) {
  ModbusRun s(rig_with({{.kind = RigFaultKind::table_moved, .time_s = 7.5, .axis = 1, .size = 0.05}}));
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_EQ(outcome.repeated_dwells, 1);
}

// The heartbeat goes out with the polls, twice a second while the table rests: enough for a watchdog of 1 s.
TEST(StationFaults, WatchdogDoesNotTripInALongDwellNorWhileCalibrating) {
  for (const bool often_enough : {true, false}) {
    ModbusRun s(default_rig_config(), "",
                "format = 1\nname = long\nrate_degps = 10\nacceleration_degps2 = 10\nstep 1\n  initial H 0 P 0 R 0\n"
                "  align 200\n  dwell 24000\n");
    if (!often_enough) s.config.motion.poll_idle_s = 1.3;  // what a station file may not ask for
    bool tripped = false;
    const auto look = [&] {
      const std::lock_guard lock(s.station.server.mutex);
      s.station.twin.tick();
      for (const Axis axis : all_axes) tripped = tripped || s.station.twin.watchdog_tripped(axis);
    };
    s.watcher.on_tick = [&](const RunSnapshot&) { look(); };
    bool calibrated = false;
    s.calibrate = [&](const RunOutcome&) -> Status {
      s.station.pass(600.0);  // nobody talks to the drives, which are off
      look();
      calibrated = true;
      return {};
    };
    const RunOutcome outcome = s.run();
    EXPECT_EQ(tripped, !often_enough);
    EXPECT_EQ(calibrated, often_enough);
    EXPECT_EQ(outcome.state, often_enough ? RunState::done : RunState::failed) << outcome.error.message;
    if (!often_enough) {
      EXPECT_EQ(exit_code(outcome.error.kind), 50);
      EXPECT_SAYS(outcome.error.message, "fault of axis");
      continue;
    }
    // Nothing is left of it for the next run.
    s.sink = MemorySink();
    EXPECT_EQ(s.run().state, RunState::done);
    EXPECT_FALSE(tripped);
  }
}

// The connection drops in mid-move and comes back: the stop is sent over the new one, and the motion is not taken up again.
TEST(StationFaults, LinkDropsInMidMove) {
  ModbusRun s;
  bool dropped = false;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function != 3 || dropped || s.rig_time_s() < in_mid_move_s) return;
    dropped = true;
    plan.pieces[0].bytes.resize(4);
    plan.hang_up = true;
  });
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_TRUE(s.watcher.saw(RunEvent::link_lost)) << outcome.error.message;
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified)) << outcome.error.message;
  EXPECT_LT(s.station.rig.axis(Axis::pitch).position_deg, 19.9);
}

// The same on a serial line: the adapter is pulled in mid-move, and plugged in again while the run tries to reach the table.
TEST(StationFaults, AdapterIsPulledInMidMoveAndComesBack) {
  const TemporaryFolder folder;
  ModbusRun s(default_rig_config(), folder / "adapter");
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function == 3 && s.rig_time_s() >= in_mid_move_s) plan.hang_up = true;
  });
  bool back = false;
  s.watcher.on_tick = [&](const RunSnapshot& now) {
    if (now.state != RunState::stopping || back) return;
    back = true;
    EXPECT_EQ(now.table, TableState::link_lost);
    s.station.disturb(nullptr);
    s.station.plug_in_again();
  };
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(outcome.error.kind, ErrorKind::device);
  EXPECT_TRUE(back);
  EXPECT_TRUE(s.watcher.saw(RunEvent::link_lost)) << outcome.error.message;
  EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified)) << outcome.error.message;
  EXPECT_LT(s.station.rig.axis(Axis::pitch).position_deg, 19.9);
}

}  // namespace
}  // namespace turncal
