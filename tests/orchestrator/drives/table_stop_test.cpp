// The last word to every drive: off, read back, on every way out; and the fastest stop where nothing can be read.
#include "turntable_drivers/table/table_stop.h"

#include "orchestrator/devices/live_devices.h"
#include "tests/orchestrator/drives/modbus_run.h"
#include "tests/orchestrator/rig_station.h"
#include "tests/turntable_drivers/level_drives.h"

namespace turncal {
namespace {

struct LastWord : testing::Test {
  LevelDrives drives;
  RealClock clock;
  std::atomic<int> stop_requests{0};
  StationConfig station = default_station_config();

  std::unique_ptr<TableDevice> device(const std::string& more = "") {
    station.table.driver = TableDriver::modbus;
    station.table.map = drives.map(more);
    Result<std::unique_ptr<TableDevice>> made = make_table(station, {clock, &stop_requests});
    EXPECT_TRUE(made.ok());
    return std::move(*made);
  }
  // Connected, homed, its drives on.
  std::unique_ptr<TableDevice> ready() {
    std::unique_ptr<TableDevice> made = device();
    Turntable& table = made->table();
    EXPECT_TRUE(table.connect().ok() && table.enable().ok() && table.home().ok());
    for (int i = 0; i < 5; ++i)
      for (const Axis axis : all_axes) EXPECT_TRUE(table.status(axis).ok());
    EXPECT_FALSE(drives.all_off());
    return made;
  }
  static StopTime within(double brake_s, double deadline_s) {
    return {.now_s = monotonic_s,
            .wait = [](double seconds) { ::usleep(unsigned(1e6 * seconds)); },
            .brake_s = brake_s,
            .deadline_s = deadline_s};
  }
  void expect_no_rest(double read_anew_s) {
    const auto table = ready();
    drives.read_anew_s = read_anew_s;
    const auto creep = [this](double rate) {
      const std::lock_guard lock(drives.mutex);
      drives.drives[3].creep = rate;
    };
    creep(2000.0);
    EXPECT_TRUE(fails(leave_off(table->table(), within(0.2, 1.0)), "does not come to rest"));
    EXPECT_TRUE(drives.all_off()) << "it was told";
    creep(0.0);  // who leaves the table need not wait for it once more
  }
  void begin_move(Turntable& table) {
    ASSERT_OK(table.move_absolute(Axis::pitch, 90.0, 10.0, 10.0));
    ASSERT_NE(drives.drive(2).rate, 0.0);
  }
};

TEST_F(LastWord, AfterADriverThatWasToldOffAStopDoesNotSwitchOn) {
  const auto table = ready();
  ASSERT_TRUE(table->table().abort_all().ok());
  ASSERT_TRUE(table->table().stop_all().ok());
  EXPECT_TRUE(drives.all_off());
  // Nor over a link that was lost and opened anew.
  ASSERT_TRUE(table->table().connect().ok());
  ASSERT_TRUE(table->table().stop_all().ok());
  EXPECT_TRUE(drives.all_off());
}

// A drive that an operator switched off in mid-move stays off when the others are stopped.
TEST_F(LastWord, AStopDoesNotSwitchOnADriveThatReadsOff) {
  const auto table = ready();
  {
    const std::lock_guard lock(drives.mutex);
    drives.drives[3].control = 0;
  }
  ASSERT_TRUE(table->table().status(Axis::roll).ok());
  ASSERT_TRUE(table->table().stop_all().ok());
  EXPECT_EQ(drives.drive(3).control & 1, 0);
  EXPECT_EQ(drives.drive(1).control, 3) << "the others brake";
}

// The end by an exception, and by a signal that nobody handled.
TEST_F(LastWord, ExceptionOrSignalInMidMove) {
  for (const bool signal : {false, true}) {
    stop_requests = 0;
    const auto run = [&] {
      const auto table = ready();
      begin_move(table->table());
      if (signal) ++stop_requests;
      if (!signal) throw std::runtime_error("in mid-move");
    };
    if (signal) {
      run();
    } else {
      EXPECT_THROW(run(), std::runtime_error);
    }
    EXPECT_TRUE(drives.all_off()) << signal;
    EXPECT_EQ(drives.drive(2).rate, 0.0);
    EXPECT_GE(drives.drive(2).words.size(), 2u);
    EXPECT_EQ(drives.drive(2).words.end()[-2], 3) << "it brakes before its drive goes off";
  }
}

// `monitor` enables nothing: it leaves drives that are off untouched, and those that it found on are off.
TEST_F(LastWord, WhoOnlyLooks) {
  const auto look = [&] {
    const auto table = device();
    EXPECT_TRUE(table->table().connect().ok());
    EXPECT_TRUE(table->table().status(Axis::heading).ok());
  };
  look();
  EXPECT_EQ(drives.words(), 0u) << "nothing was written";
  {
    const std::lock_guard lock(drives.mutex);
    for (auto& [unit, drive] : drives.drives) drive.control = 1;
  }
  look();
  EXPECT_TRUE(drives.all_off());
}

// A bit of the status that is stuck: who switched the drives on switches them off, whatever they say.
TEST_F(LastWord, DrivesThatReadOffAreSwitchedOffByWhoSwitchedThemOn) {
  {
    const auto table = ready();
    drives.on_reads_zero = true;
  }
  EXPECT_TRUE(drives.all_off());
}

TEST_F(LastWord, WhatIsRefusedIsSentAgain) {
  {
    const auto table = ready();
    drives.refuses_off = 4;
  }
  EXPECT_TRUE(drives.all_off());
}

TEST_F(LastWord, ADriveThatStaysOnIsSaid) {
  const auto table = ready();
  drives.refuses_off = 1000000;
  EXPECT_TRUE(fails(leave_off(table->table(), within(0.2, 1.0)), "its drives may be on"));
  drives.refuses_off = 0;
}

// Its status says at rest, its rate says 0, its position goes on: that is no rest, and no verified stop.
TEST_F(LastWord, ADriveThatCreepsIsNotAtRest) { expect_no_rest(0.0); }
// Nor is it one when the device finds a new position more seldom than it is asked for it.
TEST_F(LastWord, APositionThatIsReadTwiceIsNoRest) { expect_no_rest(0.3); }

TEST_F(LastWord, AMapThatCannotSwitchOffSaysSo) {
  const RegisterMap map = drives.map("switch_off = false\n");
  EXPECT_SAYS(caution_of(map), "switch_off = false");
  EXPECT_EQ(caution_of(map_of(plain_map_text("tcp"))), "");
  EXPECT_SAYS(caution_of(drives.map()), "write.stop holds the bits of write.enable");
  // The same words for both, and no admission.
  std::string text = plain_map_text("tcp");
  text.replace(text.find("write.abort = 0x203 u16 1"), 25, "write.abort = 0x202 u16 1, 0x202 u16 0");
  const Result<RegisterMap> same = parse_register_map(text, "my.map");
  EXPECT_TRUE(fails(same, "switch_off = false"));
  EXPECT_EQ(same.error().message.find('\n'), std::string::npos);
  EXPECT_TRUE(parse_register_map(text + "switch_off = false\n", "my.map").ok());
}

// Reads are not answered any more, writes work: the fastest stop goes out to every axis, again and again.
TEST_F(LastWord, FastestStopGoesOutWhenNothingCanBeRead) {
  const auto table = ready();
  begin_move(table->table());
  drives.reads_answered = false;
  const double began_s = monotonic_s();
  const Status left = leave_off(table->table(), within(1.0, 4.0));
  EXPECT_FALSE(left.ok()) << "it cannot be verified";
  EXPECT_GE(monotonic_s() - began_s, 4.0) << "to the deadline";
  EXPECT_TRUE(drives.all_off());
  for (const int unit : {1, 2, 3}) {
    const LevelDrive drive = drives.drive(unit);
    EXPECT_EQ(drive.rate, 0.0);
    EXPECT_GE(std::ranges::count(drive.words, 0), 2) << unit;
  }
  drives.reads_answered = true;
}

// The same in a run, whose reconnecting fails as well.
TEST(TableStopInARun, FastestStopGoesOutWhenNothingCanBeRead) {
  ModbusRun s;
  std::map<int, int> aborts;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function == 3 && s.rig_time_s() > in_mid_move_s) plan.pieces.clear();
    if (request.address == 0x203) ++aborts[request.unit];
  });
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_SAYS(outcome.error.message, "COULD NOT BE VERIFIED");
  for (const int unit : {1, 2, 3}) EXPECT_GE(aborts[unit], 3) << unit;
  EXPECT_LT(s.station.rig.axis(Axis::pitch).position_deg, 19.9);
}

// A second axis turns although nothing sent it, or the commanded one runs the wrong way: seen at the next poll.
TEST(StrayAxis, AnotherAxisThatTurnsStopsTheRunWithinOnePoll) {
  for (const bool in_dwell : {false, true}) {
    ModbusRun s;
    double began_s = 0.0;
    s.watcher.on_tick = [&](const RunSnapshot&) {
      if (began_s > 0.0 || s.rig_time_s() < (in_dwell ? 7.0 : in_mid_move_s)) return;
      const std::lock_guard lock(s.station.server.mutex);
      began_s = s.rig_time_s();
      s.station.rig.command_move(Axis::roll, 300.0, 20.0, 1000.0);
    };
    const RunOutcome outcome = ended(s.run(), RunState::failed);
    EXPECT_TRUE(s.watcher.saw(RunEvent::table_fault)) << outcome.error.message;
    EXPECT_SAYS(outcome.error.message, "roll moves although nothing sent it");
    const double turned_deg = s.station.rig.axis(Axis::roll).position_deg;
    // A poll of 0.1 s, in a dwell one of 0.5 s before it; the stop from 20 deg/s at the rig's rate takes up to 2 deg... of its own.
    EXPECT_LT(turned_deg, in_dwell ? 20.0 : 8.0);
    RecordProperty(in_dwell ? "dwell_deg" : "move_deg", std::to_string(turned_deg));
  }
}

TEST(StrayAxis, TheCommandedAxisThatRunsTheWrongWayStopsTheRun) {
  ModbusRun s;
  bool done = false;
  s.watcher.on_tick = [&](const RunSnapshot& at) {
    if (done || at.state != RunState::moving || s.rig_time_s() < 3.2) return;
    done = true;
    const std::lock_guard lock(s.station.server.mutex);
    s.station.rig.command_move(Axis::pitch, -300.0, 20.0, 1000.0);
  };
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_SAYS(outcome.error.message, "pitch runs away");
  EXPECT_GT(s.station.rig.axis(Axis::pitch).position_deg, -30.0);
}

// Heading's position, s32 in the first two registers of the reply (a header of 9 bytes).
void read_off_by(ModbusRun& s, double jump_deg, double from_s, double to_s) {
  s.station.disturb([&s, jump_deg, from_s, to_s](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function != 3 || request.unit != 1 || s.rig_time_s() < from_s || s.rig_time_s() > to_s) return;
    std::vector<std::uint8_t>& bytes = plan.pieces[0].bytes;
    std::uint32_t counts = 0;
    for (std::size_t i = 9; i < 13; ++i) counts = counts << 8 | bytes[i];
    counts += std::uint32_t(std::int32_t(1e4 * jump_deg));
    for (std::size_t i = 13; i-- > 9; counts >>= 8) bytes[i] = std::uint8_t(counts);
  });
}

// Somebody knocks against the table in a dwell: put right, and repeated. An encoder that loses count reads too far away for that.
TEST(StrayAxis, ASlipInADwellIsPutRight) {
  ModbusRun s(rig_with({{.kind = RigFaultKind::table_moved, .time_s = 7.5, .size = 0.9}}));
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_EQ(outcome.repeated_dwells, 1);
}

// The encoder alone says so, the unit stands: less than a fault, and the dwell is repeated.
TEST(StrayAxis, AReadingThatSlipsInADwellRepeatsIt) {
  ModbusRun s;
  read_off_by(s, 0.5, 7.5, 8.5);
  const RunOutcome outcome = ended(s.run(), RunState::done);
  EXPECT_EQ(outcome.repeated_dwells, 1);
}

TEST(StrayAxis, AnEncoderThatJumpsInADwellIsAFault) {
  for (const double jump_deg : {1.1, -90.0}) {
    SCOPED_TRACE(jump_deg);
    ModbusRun s;
    read_off_by(s, jump_deg, 7.5, 1e9);
    const RunOutcome outcome = ended(s.run(), RunState::failed);
    EXPECT_TRUE(s.watcher.saw(RunEvent::table_fault)) << outcome.error.message;
    EXPECT_SAYS(outcome.error.message, "heading moves although nothing sent it: from 0.0000 to");
    EXPECT_NEAR(s.station.rig.axis(Axis::heading).position_deg, 0.0, 1e-6) << "nothing was sent";
  }
}

}  // namespace
}  // namespace turncal
