// A stop goes to all, and a drive stops by itself when its station dies. How soon a stop goes out: stop_states_test.cpp.
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>

#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

TEST(ModbusStop, GoesToAllAxesEvenIfOneRefuses) {
  FaultStation s(true);
  s.make_ready();
  std::set<int> asked;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.address != 0x202) return;
    asked.insert(request.unit);
    if (request.unit == 1) plan.pieces[0].bytes = exception_reply(request, 4, true);
  });
  ASSERT_TRUE(s.driver.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  s.station.pass(2.0);
  const Status status = s.driver.stop_all();
  EXPECT_EQ(asked, (std::set<int>{1, 2, 3}));
  ASSERT_TRUE(fails(status, "heading")) << "the one that refused is told";
  s.station.pass(2.0);
  EXPECT_FALSE(s.driver.status(Axis::roll)->moving);
}

TEST(ModbusHeartbeat, DriveStopsWhenTheStationDies) {
  FaultStation s(true);
  s.set_off(0.0);
  // As long as the station looks, the drive goes on.
  for (int i = 0; i < 30; ++i) {
    s.station.pass(0.1);
    ASSERT_TRUE(s.driver.status(Axis::heading).ok());
  }
  EXPECT_FALSE(s.station.twin.watchdog_tripped(Axis::roll));
  EXPECT_NEAR(s.driver.status(Axis::roll)->rate_degps, 10.0, 1e-3);
  // Nobody looks any more: 1 s of watchdog, 1 s of brake.
  for (int i = 0; i < 25; ++i) {
    s.station.pass(0.1);
    const std::lock_guard lock(s.station.server.mutex);
    s.station.twin.tick();
  }
  EXPECT_TRUE(s.station.twin.watchdog_tripped(Axis::roll));
  EXPECT_EQ(s.station.fastest_axis_degps(), 0.0);
  const AxisStatus now = *s.driver.status(Axis::roll);
  EXPECT_TRUE(now.fault);
  EXPECT_LT(now.position_deg, 60.0);
  EXPECT_FALSE(s.driver.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
  ASSERT_TRUE(s.driver.clear_fault().ok());
  ASSERT_TRUE(s.driver.enable().ok());
  EXPECT_TRUE(s.driver.move_absolute(Axis::roll, 90.0, 10.0, 10.0).ok());
}

TEST(ModbusHeartbeat, ValueChangesEachTime) {
  FaultStation s(true);
  std::vector<int> values;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan&) {
    if (request.address == 0x220 && request.unit == 2) values.push_back(request.values[0]);
  });
  for (int i = 0; i < 20; ++i) {
    s.station.pass(0.1);
    ASSERT_TRUE(s.driver.status(Axis::pitch).ok());
  }
  ASSERT_GE(values.size(), 6u);  // every 0.2 or, as the clock rounds, 0.3 s
  for (std::size_t i = 1; i < values.size(); ++i) EXPECT_NE(values[i], values[i - 1]);
}

// The drives were off, and so their last heartbeats may be old: one that is enabled with another has not lost its master.
TEST(ModbusHeartbeat, EnablingOneDriveStartsTheTimeOfAllAnew) {
  Rig rig(default_rig_config());
  RigTable mock(rig);
  RigClock clock(rig);
  ModbusTwin twin(map_of(plain_map_text("tcp")), mock, clock);
  ASSERT_OK(twin.power_on());
  const auto write = [&](int unit, int address) {
    return twin.handle({.unit = unit, .function = 6, .address = address, .count = 1, .values = {1}}).exception;
  };
  for (const int unit : {1, 2, 3}) EXPECT_EQ(write(unit, 0x220), 0) << "a heartbeat";
  pass_time(rig, 0.95);
  EXPECT_EQ(write(1, 0x200), 0) << "heading is enabled";
  pass_time(rig, 0.1);
  twin.tick();
  for (const Axis axis : all_axes) EXPECT_FALSE(twin.watchdog_tripped(axis)) << to_string(axis);
  pass_time(rig, 1.0);
  twin.tick();
  for (const Axis axis : all_axes) EXPECT_TRUE(twin.watchdog_tripped(axis)) << to_string(axis);
}

// Another process moves the table and is killed with the signal that nobody can catch: the watchdog stops the drive.
TEST(ModbusHeartbeat, KilledInMidMove) {
  int to_child[2], from_child[2];
  ASSERT_EQ(::pipe(to_child), 0);
  ASSERT_EQ(::pipe(from_child), 0);
  const pid_t child = ::fork();  // before there are threads
  if (child == 0) {
    int port = 0;
    if (::read(to_child[0], &port, sizeof port) != sizeof port) ::_exit(1);
    RegisterMap map = map_of(plain_map_text("tcp"));
    map.link.address = "127.0.0.1:" + std::to_string(port);
    RealClock clock;
    DescribedTurntable driver(map, clock);
    if (!driver.connect().ok() || !driver.enable().ok() || !driver.home().ok()) ::_exit(2);
    bool sent = false;
    for (;;) {
      const Result<AxisStatus> now = driver.status(Axis::roll);
      if (now && now->homed && !now->moving && !sent) sent = driver.move_absolute(Axis::roll, 90.0, 5.0, 10.0).ok();
      if (now && now->moving && sent && ::write(from_child[1], "m", 1) != 1) ::_exit(3);
      ::usleep(20000);
    }
  }
  {
    RegisterMap map = map_of(plain_map_text("tcp"));
    map.watchdog_s = 4.0;
    TwinStation station(map);
    const int port = station.server.port();
    ASSERT_EQ(::write(to_child[1], &port, sizeof port), static_cast<ssize_t>(sizeof port));
    // The rig's time follows the wall's, twice as fast, and faster when nobody is there any more.
    const auto pass = [&](double seconds) {
      ::usleep(10000);
      station.pass(seconds);
    };
    pollfd told{from_child[0], POLLIN, 0};
    const Deadline deadline(20.0);
    while (::poll(&told, 1, 0) == 0 && !deadline.passed()) pass(0.02);
    ASSERT_FALSE(deadline.passed()) << "the child never moved the table";
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    const auto tripped = [&] {
      const std::lock_guard lock(station.server.mutex);
      return station.twin.watchdog_tripped(Axis::roll);
    };
    EXPECT_FALSE(tripped());
    for (int i = 0; i < 150 && !tripped(); ++i) pass(0.05);
    EXPECT_TRUE(tripped());
    station.pass(1.0);
    const std::lock_guard lock(station.server.mutex);
    EXPECT_EQ(station.rig.axis(Axis::roll).rate_degps, 0.0);
    EXPECT_LT(station.rig.axis(Axis::roll).position_deg, 60.0);
  }
  for (const int end : {to_child[0], to_child[1], from_child[0], from_child[1]}) ::close(end);
}

}  // namespace
}  // namespace turncal
