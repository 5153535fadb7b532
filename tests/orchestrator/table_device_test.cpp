// The keys of the table in a station file, the shipped examples, and the table that is made of them.
#include <thread>

#include "orchestrator/devices/commissioning.h"
#include "orchestrator/devices/live_devices.h"
#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

const std::string stations = std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/stations/";
const std::string head = "format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\nimu.driver = rig\n";

TEST(StationLock, EveryNameOfThisMachineIsOneLock) {
  const std::string lock = lock_path_of("127.0.0.1:15020");
  for (const char* const name :
       {"0.0.0.0", "localhost", "127.0.0.2", "127.1", "0", "::", "::1", "[::1]", "::ffff:127.0.0.1", "0:0:0:0:0:0:0:1"})
    EXPECT_EQ(lock_path_of(std::string(name) + ":15020"), lock) << name;
  for (const char* const other : {"127.0.0.1:15021", "192.0.2.1:15020", "2001:db8::1:15020", "/dev/null"})
    EXPECT_NE(lock_path_of(other), lock) << other;
}

// An adapter was pulled out while a process holds its name, and the next one got its number.
TEST(StationLock, ANumberThatIsGivenOutAgainIsAnotherDevice) {
  const TemporaryFolder folder;
  const auto station_at = [&](const char* const name) {
    StationConfig station = default_station_config();
    station.imu.emplace().settings.device = folder / name;
    return station;
  };
  std::filesystem::create_symlink("/dev/null", folder / "first");
  const Result<std::vector<LockFile>> first = good(lock_devices(station_at("first")));
  std::filesystem::remove(folder / "first");
  std::filesystem::create_symlink("/dev/null", folder / "second");
  const Result<std::vector<LockFile>> second = good(lock_devices(station_at("second")));
  EXPECT_FALSE(lock_devices(station_at("first")).ok()) << "the name is still held";

  std::filesystem::create_directory_symlink(folder / ".", folder / "here");
  EXPECT_EQ(lock_path_of(folder / "here/second"), lock_path_of(folder / "second"))
      << "of folders the links are followed";
}

TEST(TableDevice, ShippedExamplesAreReadAndMade) {
  const struct {
    const char* file;
    TableDriver driver;
  } examples[] = {{"modbus", TableDriver::modbus}, {"serial", TableDriver::serial}, {"manual", TableDriver::manual}};
  Rig rig(default_rig_config());
  RigClock clock(rig);
  std::ostringstream out;
  for (const auto& example : examples) {
    const Result<StationConfig> station = good(read_station_config(stations + example.file + ".station"));
    EXPECT_EQ(station->table.driver, example.driver);
    Result<std::unique_ptr<TableDevice>> device = good(make_table(*station, {clock, nullptr, 0, &out}));
    EXPECT_EQ((*device)->table().needs_operator(), example.driver == TableDriver::manual);
    EXPECT_EQ((*device)->manual() != nullptr, example.driver == TableDriver::manual);
    EXPECT_FALSE((*device)->table().status(Axis::pitch).ok()) << "not connected";
  }
  EXPECT_EQ(make_table(default_station_config(), {clock}).error().kind, ErrorKind::input) << "the mock is for dry runs";
}

// From a station file to a table that moves: over a real link to the twin, within the station's limits.
TEST(TableDevice, MovesTheTwinWithinTheStationsLimits) {
  const TemporaryFolder folder;
  std::ofstream(folder / "my.map") << plain_map_text("tcp");
  TwinStation twin(map_of(plain_map_text("tcp")));
  const std::string text =
      head +
      "table.driver = modbus\ntable.map = my.map\ntable.simulated = true\ntable.address = " + twin.server.address() +
      "\naxis.pitch.soft_max_deg = 50\n";
  const Result<StationConfig> station = good(parse_station_config(text, folder / "my.station"));
  Result<std::unique_ptr<TableDevice>> device = good(make_table(*station, {twin.clock}));
  Turntable& table = (*device)->table();
  ASSERT_OK(table.connect());
  EXPECT_TRUE(table.identify()->simulated) << "a recording of a twin never makes a production file";
  ASSERT_TRUE(table.enable().ok());
  ASSERT_TRUE(table.home().ok());
  for (int i = 0; i < 40; ++i) {
    twin.pass(0.1);
    ASSERT_TRUE(table.status(Axis::pitch).ok());
  }
  EXPECT_EQ(table.move_absolute(Axis::pitch, 51.0, 10.0, 10.0).error().kind, ErrorKind::input);
  ASSERT_TRUE(table.move_absolute(Axis::pitch, 5.0, 10.0, 10.0).ok());
  twin.pass(0.5);
  EXPECT_TRUE(table.status(Axis::pitch)->moving);
  std::atomic<bool> left{false};
  std::thread time([&] {
    for (; !left; ::usleep(10'000)) twin.pass(0.01);  // or nobody sees that it rests
  });
  device->reset();
  left = true;
  time.join();

  // The watchdog of this map is 1 s: polls every 0.6 s would let it trip.
  const std::string slow = text + "motion.poll_idle_s = 0.6\n";
  EXPECT_TRUE(fails(parse_station_config(slow, folder / "my.station"), "heartbeat.watchdog_s"));
}

// ---- an axis that is commissioned

// A turn of 5 deg at 1 deg/s and 2 deg/s^2, polled 0.1 s apart; what is told of the rate is that times `scale`. The host sleeps from
// late_s until awake_s, with an answer in its hands that it stamps when it is awake.
Result<double> judged(double scale, bool says_moving, double poll_s = 0.1, double late_s = 9.0, double awake_s = 9.0) {
  const auto at = [&](double t) {
    AxisStatus axis;
    const double end_s = 5.5, ramp_s = 0.5;
    const double up = std::min(t, ramp_s), down = std::clamp(end_s - t, 0.0, ramp_s);
    axis.time_s = t;
    axis.rate_degps = std::min({2.0 * up, 1.0, 2.0 * down});
    axis.position_deg = t <= ramp_s ? t * t : t <= end_s - ramp_s ? 0.25 + (t - ramp_s) : 5.0 - down * down;
    axis.moving = says_moving && axis.rate_degps > 0.0;
    axis.rate_degps *= scale;
    return axis;
  };
  RateCheck check(at(0.0), 5.0);
  for (double t = poll_s; t < 6.0; t += poll_s) {
    AxisStatus read = at(t);
    if (t >= late_s && t < awake_s) t = read.time_s = awake_s;
    check.add(read);
  }
  return check.judge(Axis::pitch, 0.3);
}

TEST(RateCheck, ADeadRateOrMovingBitIsNamed) {
  for (const double scale : {1.0, 1.25}) EXPECT_EQ(*judged(scale, true), 0.0) << "within the tolerance";
  EXPECT_DOUBLE_EQ(*judged(0.0, false, 1.0), 1.0) << "a few readings are not judged";
  for (double late_s = 0.2; late_s < 5.0; late_s += 0.1) {
    for (const double slept_s : {0.3, 0.8, 1.5, 4.0})
      EXPECT_OK(judged(1.0, true, 0.1, late_s, late_s + slept_s)) << slept_s;
    EXPECT_TRUE(fails(judged(0.5, true, 0.1, late_s, late_s + 0.6), "summed up")) << late_s;
  }
  for (const double scale : {0.0, -1.0, 0.1, 60.0, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_TRUE(fails(judged(scale, true), ErrorKind::input, "pitch turned by +5.000 deg while its rate summed up to"));
  EXPECT_TRUE(fails(judged(1.0, false), "its status never showed it"));
  EXPECT_OK(RateCheck(AxisStatus{}, 5.0).judge(Axis::pitch, 0.3)) << "it had no way to go";
}

}  // namespace
}  // namespace turncal
