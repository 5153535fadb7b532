// Faults of a Modbus line and of the drives behind it, each injected at the twin: what comes out is the right position or an error of
// the right kind, never another axis's position.
#include <sys/file.h>

#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

// A gateway that sends every reply twice: at once, a little later, cut in two, and after the next request. Writes, too, are taken.
TEST(ModbusFaults, RepeatedRepliesOverTcpAreDropped) {
  for (const char* how : {"at once", "later", "in pieces", "after the next request", "after the next reply"}) {
    SCOPED_TRACE(how);
    FaultStation s(true);
    const std::string mode = how;
    s.station.disturb([mode, before = Frame()](const ModbusRequest&, AnswerPlan& plan) mutable {
      const Frame again = mode == "after the next reply" ? before : plan.pieces[0].bytes;
      before = plan.pieces[0].bytes;
      if (again.empty()) return;
      if (mode == "in pieces") {
        plan.pieces.push_back({Frame(again.begin(), again.begin() + 6), 0.0});
        plan.pieces.push_back({Frame(again.begin() + 6, again.end()), 0.005});
      } else {
        plan.pieces.push_back({again, mode == "at once" || again != before ? 0.0 : mode == "later" ? 0.002 : 0.02});
      }
    });
    const double began_s = monotonic_s();
    EXPECT_EQ(s.expect_truth(6), 18);
    EXPECT_LT(monotonic_s() - began_s, 3.0) << "nothing is drained";
    EXPECT_TRUE(s.driver.stop_all().ok());
    EXPECT_TRUE(s.driver.abort_all().ok());
    EXPECT_TRUE(s.driver.enable().ok());
  }
}

// Answers that belong to the request before, from some moment on. Where unit and function are right, only the length of the reply tells which
// register it belongs to.
TEST(ModbusFaults, AnswersOneBehindAreNeverBelieved) {
  const struct {
    const char* what;
    std::string map;
    int least;  // readings of 12 that come true
  } cases[] = {{"several drives, TCP", FaultStation::map_text(true, ""), 0},
               {"several drives, RTU", FaultStation::map_text(false, ""), 0},
               {"one controller, RTU", circle_map_text("rtu"), 1},
               {"one controller, RTU over TCP", own_map_text("one_block"), 12}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.what);
    RegisterMap map = map_of(c.map);
    map.link.reply_timeout_s = 0.15;
    map.link.byte_timeout_s = 0.03;
    if (c.least > 0) map.heartbeat_address.reset();
    FaultStation s(map);
    Frame last;
    s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
      if (request.function != 3 && request.function != 4) return;
      std::swap(plan.pieces[0].bytes, last);
      if (plan.pieces[0].bytes.empty()) plan.pieces.clear();
    });
    EXPECT_GE(s.expect_truth(4), c.least);
  }
}

// A drive that has become slower than the time-out while one axis is polled in motion: the late reply has the right unit, function and
// length, and only the drained line keeps it from being taken for the answer to a later question.
TEST(ModbusFaults, LateReplyOfTheSameRegisterIsNotTheNextAnswer) {
  RegisterMap map = map_of(FaultStation::map_text(false, ""));
  map.heartbeat_address.reset();  // nothing but readings of one register
  FaultStation s(map);
  s.set_off(0.0, Axis::heading);
  std::atomic<int> slow{2};
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (is_read(request) && slow-- > 0) plan.pieces[0].delay_s = 0.2;
  });
  int read = 0;
  for (int i = 0; i < 5; ++i) {
    ::usleep(20000);  // the drive works out its late reply before the table has turned further
    s.station.pass(0.5);
    const Result<AxisStatus> now = s.driver.status(Axis::heading);
    if (!now) continue;
    ++read;
    EXPECT_NEAR(now->position_deg, s.station.rig.axis(Axis::heading).position_deg, 0.01);
  }
  EXPECT_EQ(read, 5) << "the third try is in time";
}

// A late acknowledgement of a write, and an acknowledgement of another address: the command counts as not acknowledged.
TEST(ModbusFaults, WriteAcknowledgements) {
  FaultStation s(false);
  s.make_ready();
  int moves = 0;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function != 16) return;
    ++moves;
    plan.pieces[0].delay_s = 0.2;
  });
  ASSERT_TRUE(fails(s.driver.move_absolute(Axis::pitch, 20.0, 10.0, 10.0), ErrorKind::device, "it stands"));
  EXPECT_EQ(moves, 1) << "never sent again";
  EXPECT_NEAR(s.driver.status(Axis::pitch)->position_deg, 0.0, 1e-3) << "the late answer was swallowed";

  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function != 16) return;
    ModbusRequest other = request;
    other.address = 0x300;
    plan.pieces[0].bytes = write_reply(other, false);
  });
  ASSERT_TRUE(fails(s.driver.move_absolute(Axis::pitch, 20.0, 10.0, 10.0), "another request"));

  // The trigger was carried out, its answer lost: what the drive made of it is read back and said.
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (request.function == 6 && request.address == 0x216) plan.pieces.clear();
  });
  ASSERT_TRUE(fails(s.driver.move_absolute(Axis::pitch, 20.0, 10.0, 10.0), "it moves"));
  EXPECT_TRUE(s.driver.stop_all().ok());
}

class ModbusExceptions : public testing::TestWithParam<int> {};

TEST_P(ModbusExceptions, AreRepeatedOrSaid) {
  const int code = GetParam();
  FaultStation s(true);
  std::atomic<bool> always{false};
  std::atomic<int> once{1};
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (is_read(request) && (always || once-- > 0)) plan.pieces[0].bytes = exception_reply(request, code, true);
  });
  const Result<AxisStatus> first = s.driver.status(Axis::pitch);
  const bool asked_again = code >= 5;
  EXPECT_EQ(first.ok(), asked_again);
  if (first) {
    EXPECT_NEAR(first->position_deg, 30.0, 1e-3);
  }
  always = true;
  const Result<AxisStatus> status = s.driver.status(Axis::pitch);
  ASSERT_TRUE(fails(status, code <= 3 ? ErrorKind::input : ErrorKind::device));
  EXPECT_TRUE(fails(status, "exception " + std::to_string(code)));
  always = false;
  once = 0;
  EXPECT_EQ(s.driver.status(Axis::pitch).ok(), code < 10) << "a gateway that does not reach the drive is a lost link";
}
INSTANTIATE_TEST_SUITE_P(All, ModbusExceptions, testing::Values(1, 2, 3, 4, 5, 6, 10, 11),
                         [](const auto& which) { return "code_" + std::to_string(which.param); });

TEST(ModbusFaults, ThirdFailureInARowIsALostLink) {
  FaultStation s(false);
  std::atomic<int> silent = 2, asked = 0;  // the server's thread counts
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (!is_read(request)) return;
    ++asked;
    if (silent-- > 0) plan.pieces.clear();
  });
  EXPECT_TRUE(s.driver.status(Axis::roll).ok()) << "two retries";
  EXPECT_EQ(asked, 3);
  silent = 3;
  EXPECT_FALSE(s.driver.status(Axis::roll).ok());
  const int before = asked;
  ASSERT_FALSE(s.driver.status(Axis::roll).ok());
  EXPECT_EQ(asked, before) << "nothing is asked on a lost link";
  EXPECT_TRUE(s.driver.stop_all().ok()) << "but a stop goes out";
  ASSERT_TRUE(s.driver.connect().ok());
  EXPECT_FALSE(s.driver.status(Axis::roll)->enabled) << "not ready";
  EXPECT_FALSE(s.driver.move_absolute(Axis::roll, 0.0, 10.0, 10.0).ok());
}

TEST(ModbusFaults, HangUpInMidReplyAndInMidMove) {
  for (const bool tcp : {true, false}) {
    FaultStation s(tcp);
    s.set_off(2.0, Axis::pitch);
    s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
      if (!is_read(request)) return;
      plan.pieces[0].bytes.resize(6);
      plan.hang_up = true;
    });
    const double began_s = monotonic_s();
    const Result<AxisStatus> lost = s.driver.status(Axis::pitch);
    EXPECT_FALSE(lost.ok());
    EXPECT_LT(monotonic_s() - began_s, 2.0);
    if (!lost) {
      EXPECT_EQ(lost.error().kind, ErrorKind::device);
    }
    s.station.disturb(nullptr);
    if (tcp) {  // it takes connections again: the stop makes one for itself, and nothing resumes
      EXPECT_TRUE(s.driver.stop_all().ok());
      s.station.pass(2.0);
      ASSERT_TRUE(s.driver.connect().ok());
      EXPECT_FALSE(s.driver.status(Axis::pitch)->moving);
      EXPECT_FALSE(s.driver.status(Axis::pitch)->enabled);
    } else {
      EXPECT_FALSE(s.driver.stop_all().ok()) << "the adapter is gone";
      EXPECT_FALSE(s.driver.connect().ok());
    }
  }
}

int open_descriptors() {
  int count = 0;
  for (int i = 0; i < 256; ++i) count += ::fcntl(i, F_GETFD) >= 0 ? 1 : 0;
  return count;
}

TEST(ModbusFaults, AdapterComesBackUnderItsName) {
  const std::string name = testing::TempDir() + "turncal_modbus_" + std::to_string(::getpid());
  RegisterMap map = map_of(FaultStation::map_text(false, ""));
  Rig rig(default_rig_config());
  RigTable mock(rig);
  RigClock clock(rig);
  map.link.address = name;
  ModbusTwin twin(map, mock, clock);
  ASSERT_TRUE(twin.power_on().ok());
  DescribedTurntable driver(map, clock);
  EXPECT_FALSE(driver.connect().ok()) << "missing device";
  int descriptors = 0;
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(twin.open_pty(name).ok());
    {
      const Serving serving(twin);
      EXPECT_OK(driver.connect());
      EXPECT_OK(driver.status(Axis::heading));
      if (round == 0) descriptors = open_descriptors();
      EXPECT_EQ(open_descriptors(), descriptors) << "a descriptor leaks with each reconnection";
    }
    twin.hang_up();
    EXPECT_FALSE(driver.status(Axis::heading).ok());
  }
}

TEST(ModbusFaults, MissingForbiddenAndBusy) {
  Rig rig(default_rig_config());
  RigClock clock(rig);
  const auto error_of = [&](bool tcp, const std::string& address) {
    RegisterMap map = map_of(FaultStation::map_text(tcp, ""));
    map.link.address = address;
    DescribedTurntable driver(map, clock);
    const Status status = driver.connect();
    EXPECT_FALSE(status.ok()) << address;
    return status.ok() ? Error() : status.error();
  };
  EXPECT_SAYS(error_of(false, "/dev/no-such-adapter").message, "/dev/no-such-adapter");
  for (const auto& [tcp, address, kind] : {std::tuple(false, "/dev/no-such-adapter", ErrorKind::device),
                                           {false, "", ErrorKind::input},
                                           {true, "127.0.0.1", ErrorKind::input},
                                           {true, "127.0.0.1:1", ErrorKind::device}})  // refused
    EXPECT_EQ(error_of(tcp, address).kind, kind) << address;
  Result<Pty> pty = good(Pty::create());
  const int holder = ::open(pty->device().c_str(), O_RDWR | O_NOCTTY);
  ASSERT_GE(holder, 0);
  ASSERT_EQ(::flock(holder, LOCK_EX | LOCK_NB), 0);
  EXPECT_SAYS(error_of(false, pty->device()).message, "in use");
  ::close(holder);
  const std::string forbidden = testing::TempDir() + "turncal_forbidden_" + std::to_string(::getpid());
  ::close(::open(forbidden.c_str(), O_CREAT | O_WRONLY, 0));
  EXPECT_EQ(error_of(false, forbidden).kind, ErrorKind::device);  // for root it is "not a serial port"
  ::unlink(forbidden.c_str());
}

// A position that the axis cannot have reached since the last reading.
TEST(ModbusFaults, JumpIsNotBelieved) {
  FaultStation s(true, "plausible.rate_degps = 100\n");
  s.make_ready();
  int wrong = 1;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
    if (is_read(request) && request.unit == 1 && wrong-- > 0) plan.pieces[0].bytes[10] ^= 0x40;  // bit 22 of the count
  });
  EXPECT_NEAR(s.driver.status(Axis::heading)->position_deg, 0.0, 1e-3) << "asked again";
  wrong = 1000;
  ASSERT_TRUE(fails(s.driver.status(Axis::heading), "not believed"));
  EXPECT_TRUE(s.driver.stop_all().ok());
}

// ---- modbus stop ----

// A stop goes to all, and a drive stops by itself when its station dies. How soon a stop goes out: stop_states_test.cpp.

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
  std::vector<int> values;
  s.station.disturb([&](const ModbusRequest& request, AnswerPlan&) {
    if (request.address == 0x220 && request.unit == 2) values.push_back(request.values[0]);
  });
  // As long as the station looks, the drive goes on.
  for (int i = 0; i < 30; ++i) {
    s.station.pass(0.1);
    ASSERT_TRUE(s.driver.status(Axis::heading).ok());
  }
  s.station.disturb(nullptr);
  ASSERT_GE(values.size(), 9u);  // every 0.2 or, as the clock rounds, 0.3 s
  EXPECT_EQ(std::ranges::adjacent_find(values), values.end()) << "the same twice";
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

}  // namespace
}  // namespace turncal
