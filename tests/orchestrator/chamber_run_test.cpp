// A run in a chamber, on the rig: brought to temperature before anything is recorded, watched, and off at every end.
#include <algorithm>
#include <random>

#include "orchestrator/jobs/run.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/rig_station.h"
#include "turntable_drivers/twins/rig_chamber.h"

namespace turncal {
namespace {

const ChamberLimits own_limits{-40.0, 85.0, 3.0, 0.1};

ChamberConfig chamber_config() {
  ChamberConfig config;
  config.described.limits = own_limits;
  config.temperature_c = 30.0;
  config.limit_unit_c = 60.0;
  config.settle_s = 60.0;
  config.settle_limit_s = 1200.0;
  return config;
}

RigFault chamber_fault(RigFaultKind kind, double time_s, double duration_s = 0.0, double size = 0.0) {
  return {.kind = kind, .time_s = time_s, .duration_s = duration_s, .size = size};
}

// The rig's, and what it was told, in order.
class Noted : public RigChamber {
 public:
  Noted(RigGroup& group, std::vector<std::string>& told) : RigChamber(group, own_limits), told_(told) {}
  Status on() override { return note("on", RigChamber::on()); }
  Status off() override { return note("off", RigChamber::off()); }

 private:
  Status note(const char* what, Status how) {
    told_.push_back(what);
    return how;
  }
  std::vector<std::string>& told_;
};

struct ChamberRun : RigStation {
  explicit ChamberRun(std::vector<RigFault> faults = {}) : RigStation(two_steps_text, rig_with(std::move(faults))) {
    station.chamber = chamber_config();
    temperature_c = 30.0;
    table.on_stop = [this] {
      told.push_back("stop");
      return devices.table.stop_all();
    };
  }
  RunOutcome run() { return run_with(devices.imu); }
  RunOutcome run_with(ImuSource& imu) { return TestRun::run({table, imu, clock, devices.devices().wait, &keeper}); }
  bool heats() const { return rig.chamber().on; }

  std::vector<std::string> told;
  FrontTable table{devices.table};
  Noted chamber{devices.group, told};
  ChamberKeeper keeper{chamber, chamber_config(), BackgroundQueue::By::caller};
};

TEST(ChamberRun, RecordsAtTheTemperatureAndIsOffBeforeAnythingIsCalibrated) {
  ChamberRun s;
  bool off_by_then = false;
  std::string at_rest;
  double eta_s = 0.0;
  s.calibrate = [&](const RunOutcome&) -> Status {
    off_by_then = !s.heats();
    return {};
  };
  s.watcher.on_tick = [&](const RunSnapshot& now) {
    if (now.state != RunState::resting) return;
    if (at_rest.empty()) eta_s = now.eta_s;
    at_rest = phase_words(now, false);
    EXPECT_GE(now.phase_fraction, 0.0);
    EXPECT_LE(now.phase_fraction, 1.0);
  };
  ended(s.run(), RunState::done);
  EXPECT_TRUE(off_by_then);
  EXPECT_EQ(s.told.front(), "on");
  EXPECT_EQ(s.sink.segments.front().kind, SegmentKind::align) << "recorded as without a chamber";
  EXPECT_EQ(s.sink.sample_count, two_steps_samples);
  EXPECT_SAYS(at_rest, "resting: chamber 30");
  EXPECT_GE(eta_s, 60.0 + 40.0) << "the time left counts what is to come";
  const double end_s = s.clock.now_s();
  EXPECT_GT(end_s, 60.0 + 120.0 + 40.0);
  EXPECT_LT(end_s, 600.0);
  EXPECT_GT(s.rig.temperature_c(), 25.0 + 1.5) << "the unit was warmed";
}

struct Scenario {
  const char* name;
  std::vector<RigFault> faults;
  std::string said;
  bool verified = true;
};
void PrintTo(const Scenario& one, std::ostream* out) { *out << one.name; }

std::vector<Scenario> scenarios() {
  using enum RigFaultKind;
  return {{"never_settles",
           {chamber_fault(chamber_never_settles, 0.0, 0.0, 8.0)},
           "has not settled at 30 C within chamber.settle_limit_s = 1200"},
          {"sensor_dead", {chamber_fault(chamber_sensor_dead, 40.0)}, "dead?"},
          {"door_open", {chamber_fault(chamber_door_open, 100.0)}, "its door is open"},
          {"alarm", {chamber_fault(chamber_alarm, 270.0)}, "it shows an alarm"},
          {"unit_too_warm", {chamber_fault(chamber_overheats, 0.0, 0.0, 150.0)}, "above chamber.limit_unit_c = 60"},
          {"link_lost_for_a_while", {chamber_fault(chamber_link_lost, 100.0, 20.0)}, "the link is lost"},
          {"link_lost",
           {chamber_fault(chamber_link_lost, 100.0)},
           "THAT THE CHAMBER IS OFF COULD NOT BE VERIFIED: simulated chamber: the link is lost",
           false},
          {"off_is_taken_late",
           {chamber_fault(chamber_door_open, 100.0), chamber_fault(chamber_stays_on, 0.0, 130.0)},
           "its door is open"},
          {"stays_on",
           {chamber_fault(chamber_door_open, 100.0), chamber_fault(chamber_stays_on, 0.0)},
           "COULD NOT BE VERIFIED: it was told, and reads on",
           false}};
}

class ChamberFaults : public testing::TestWithParam<Scenario> {};

TEST_P(ChamberFaults, StopTheTableThenTheHeaters) {
  ChamberRun s(GetParam().faults);
  const RunOutcome outcome = ended(s.run(), RunState::failed);
  EXPECT_EQ(outcome.error.kind, ErrorKind::device);
  EXPECT_SAYS(outcome.error.message, GetParam().said);
  EXPECT_SAYS_NOT(outcome.error.message, "\n");
  EXPECT_TRUE(s.watcher.saw(RunEvent::chamber_fault)) << "journalled as what it is";
  EXPECT_EQ(!s.heats(), GetParam().verified);
  EXPECT_TRUE(outcome.left.has_value()) << "the table was verified at rest with its drives off";
  EXPECT_FALSE(outcome.stop_failed);
  EXPECT_TRUE(s.at_rest());
  const auto stop = std::ranges::find(s.told, "stop"), off = std::ranges::find(s.told, "off");
  ASSERT_TRUE(stop != s.told.end() && off != s.told.end());
  EXPECT_LT(stop - s.told.begin(), off - s.told.begin()) << "the table first";
}

INSTANTIATE_TEST_SUITE_P(All, ChamberFaults, testing::ValuesIn(scenarios()),
                         [](const auto& which) { return which.param.name; });

TEST(ChamberRun, OneThatAKilledRunLeftOnGoesOffThoughNothingIsUsed) {
  ChamberRun s;
  s.rig.command_chamber(30.0, 3.0, true);
  struct Deaf : FrontImu {
    using FrontImu::FrontImu;
    Status open() override { return device_error("no such line"); }
  } deaf(s.devices.imu);
  const RunOutcome outcome = ended(s.run_with(deaf), RunState::failed);
  EXPECT_SAYS(outcome.error.message, "no such line");
  EXPECT_FALSE(s.heats());
  EXPECT_TRUE(std::ranges::find(s.told, "stop") == s.told.end());
}

TEST(ChamberRun, ADoorThatIsOpenIsSaidBeforeAnythingMoves) {
  ChamberRun s({chamber_fault(RigFaultKind::chamber_door_open, 0.0)});
  EXPECT_SAYS(ended(s.run(), RunState::failed).error.message, "simulated chamber: its door is open");
  EXPECT_FALSE(s.watcher.saw(RunEvent::connected));
}

// Whatever is drawn: faults of chamber, table and unit, a stop, a pause, an end from outside.
TEST(ChamberRun, WhateverIsDrawnTheHeaterIsOffAtTheEnd) {
  using enum RigFaultKind;
  const RigFaultKind kinds[] = {
      chamber_never_settles, chamber_sensor_dead, chamber_door_open, chamber_alarm, chamber_overheats,
      chamber_link_lost,     chamber_stays_on,    axis_fault,        stuck_axis,    link_lost,
      emergency_stop,        imu_unplugged};
  std::mt19937 drawn(20261128);
  const auto below = [&](int n) { return int(drawn() % unsigned(n)); };
  int heated = 0;
  for (int run = 0; run < 60; ++run) {
    std::vector<RigFault> faults;
    std::string what = "run " + std::to_string(run);
    for (int i = below(4); i > 0; --i) {
      const RigFaultKind kind = kinds[below(12)];
      // Of the chamber's line and contactor together shorter than it may take to go off.
      const bool passes = kind == chamber_link_lost || kind == chamber_stays_on;
      faults.push_back(chamber_fault(kind, below(400), passes ? 1 + below(18) : 0.0, 5 + below(90)));
      what += std::string(", ") + to_string(kind) + " at " + std::to_string(faults.back().time_s);
    }
    ChamberRun s(faults);
    const double asked_s = below(600);
    const int how = below(4);
    s.watcher.on_tick = [&](const RunSnapshot&) {
      if (how == 0 || s.clock.now_s() < asked_s) return;
      (how == 1 ? s.pause_requests : s.stop_requests) = 1;
      if (how == 3) s.end_requests = 1;
    };
    const RunOutcome outcome = s.run();
    EXPECT_FALSE(s.heats()) << what << ": " << outcome.error.message;
    heated += std::ranges::find(s.told, "on") != s.told.end();
  }
  EXPECT_GT(heated, 40) << "most of them were switched on";
}

}  // namespace
}  // namespace turncal
