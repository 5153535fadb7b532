// The program at a table whose control word is its enable (tests/turntable_drivers/level_drives.h): however `commission` and `monitor` end,
// the drives are off, and what is said of them is what was read.

#include <thread>

#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_encoder.h"
#include "imu_io/lines/unit_end.h"
#include "orchestrator/devices/live_devices.h"
#include "tests/orchestrator/program.h"
#include "tests/turntable_drivers/level_drives.h"

namespace turncal {
namespace {

class TableProgram : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    Result<Pty> unit = good(Pty::create());
    unit_ = std::move(*unit);
    write("level.map", drives.map_text());
    write("level.station",
          "format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = modbus\ntable.map = "
          "level.map\n"
          "imu.driver = serial\nimu.frame = laser_gyro\nimu.device = " +
              unit_.device() + "\n");
  }
  // Five seconds.
  void wait_for_answers() const {
    std::string map = drives.map_text();
    const std::string time = "link.response_timeout_s = 0.1";
    write("level.map", map.replace(map.find(time), time.size(), "link.response_timeout_s = 5"));
  }
  void switch_on() {
    const std::lock_guard lock(drives.mutex);
    for (auto& [unit, drive] : drives.drives) drive.control = 1;
  }
  // What is done once `commission` has homed the table, and rests.
  ProgramResult commission(const std::function<void(pid_t)>& then) {
    for (const int unit : {1, 2, 3}) {
      const std::lock_guard lock(drives.mutex);
      drives.drives[unit] = {};
    }
    const pid_t pid = start({"commission", "--station", "level.station"});
    for (int i = 0; i < 1000 && !drives.drive(3).homed; ++i) ::usleep(10'000);
    ::usleep(500'000);
    EXPECT_FALSE(drives.all_off());
    then(pid);
    return finish(pid);
  }

  LevelDrives drives;
  Pty unit_;  // silent
};

class TableProgramToldToEnd : public TableProgram, public testing::WithParamInterface<int> {};
TEST_P(TableProgramToldToEnd, CommissionSaysSoAndThatTheTableRests) {
  const bool by_operator = GetParam() == SIGINT;
  const ProgramResult result = commission([](pid_t pid) { ::kill(pid, GetParam()); });
  EXPECT_EQ(result.code, by_operator ? 30 : 75);
  EXPECT_EQ(result.err_lines(), 1) << result.err;
  EXPECT_SAYS(result.err, by_operator ? "stopped by the operator" : "told to end");
  EXPECT_SAYS(result.err, "the table rests, its drives are off");
  EXPECT_TRUE(drives.all_off());
}
INSTANTIATE_TEST_SUITE_P(By, TableProgramToldToEnd, testing::Values(SIGTERM, SIGINT),
                         [](const auto& which) { return std::string("SIG") + sigabbrev_np(which.param); });

// A process that is stopped cannot watch a table that turns.
TEST_F(TableProgram, NoTerminalStopsItWhileTheDrivesAreOn) {
  const ProgramResult result = commission([](pid_t pid) {
    for (const int signal : {SIGTSTP, SIGTTIN, SIGTTOU}) ::kill(pid, signal);
    ::usleep(200'000);
    int status = 0;
    EXPECT_EQ(::waitpid(pid, &status, WNOHANG | WUNTRACED), 0) << "it stands";
    ::kill(pid, SIGTERM);
  });
  EXPECT_EQ(result.code, 75) << result.err;
  EXPECT_TRUE(drives.all_off());
}

TEST_F(TableProgram, CommissionStopsWhenAnotherAxisTurns) {
  const ProgramResult result = commission([this](pid_t) {
    const std::lock_guard lock(drives.mutex);
    LevelDrive& roll = drives.drives[3];
    roll.pass();
    roll.target = 45'000.0;
    roll.rate = 10'000.0;
  });
  EXPECT_EQ(result.code, 50);
  EXPECT_SAYS(result.err, "roll moves although nothing sent it");
  EXPECT_TRUE(drives.all_off());
  EXPECT_LT(drives.drive(3).position, 10'000.0) << "10 deg at 10 deg/s, where a poll takes 0.1 s";
}

TEST_F(TableProgram, CommissionStopsWhenADriveGoesOff) {
  double began_s = 0.0;
  const ProgramResult result = commission([&](pid_t) {
    began_s = monotonic_s();
    const std::lock_guard lock(drives.mutex);
    drives.drives[2].write_control(0);
  });
  EXPECT_LT(monotonic_s() - began_s, 10.0) << "not only when a move takes too long, with the look for a sag";
  EXPECT_EQ(result.code, 50);
  EXPECT_SAYS(result.err, "drive of axis pitch is off; the table rests, its drives are off");
}

// 0.005 deg/s, of which neither the status nor the rate tells.
TEST_F(TableProgram, AnAxisThatSagsWithItsDriveOffIsSaid) {
  const Result<StationConfig> station = good(read_station_config((folder_ / "level.station").string()));
  std::atomic<int> stop_requests{0};
  std::ostringstream out;
  Result<std::unique_ptr<LiveDevices>> live = good(LiveDevices::make(*station, stop_requests, out));
  Turntable& table = (*live)->devices().table;
  ASSERT_TRUE(table.connect().ok());
  const auto read = [&] {
    TableStatus axes{};
    for (const Axis axis : all_axes) {
      Result<AxisStatus> status = table.status(axis);
      EXPECT_TRUE(status.ok());
      if (status) axes[index(axis)] = std::move(*status);
    }
    return axes;
  };
  EXPECT_EQ((*live)->sag_since(read()), "");
  {
    const std::lock_guard lock(drives.mutex);
    drives.drives[2].creep = 5.0;  // counts of a thousandth of a degree
  }
  const std::string said = (*live)->sag_since(read());
  EXPECT_TRUE(said.starts_with("pitch turns with its drive off: from ")) << said;
}

TEST_F(TableProgram, MonitorShowsADriveThatIsOnAndSwitchesItOff) {
  switch_on();
  const ProgramResult result = ends("monitor --station level.station --for 1s", 0);
  EXPECT_SAYS(result.out, "not ready (on, by somebody else");
  EXPECT_SAYS_NOT(result.out, "(off");
  EXPECT_TRUE(drives.all_off());
}

TEST_F(TableProgram, MonitorSaysThatADriveStaysOn) {
  switch_on();
  drives.refuses_off = 1'000'000;
  ends("monitor --station level.station --for 1s", 50, "THE STOP COULD NOT BE VERIFIED");
}

TEST_F(TableProgram, MonitorSaysThatItCouldNotReadTheTableAtLast) {
  const pid_t pid = start({"monitor", "--station", "level.station", "--for", "2s"});
  ::usleep(1'200'000);
  drives.reads_answered = false;
  const ProgramResult result = finish(pid);
  drives.reads_answered = true;
  EXPECT_EQ(result.code, 50);
  EXPECT_EQ(result.err_lines(), 1) << result.err;
  EXPECT_SAYS(result.err, "THE STOP COULD NOT BE VERIFIED");
}

// A signal cuts the reading of the moment short: that is no fault of the line, and nothing is said of it.
TEST_F(TableProgram, MonitorThatIsToldToEndDoesNotCallTheLineLost) {
  for (int i = 0; i < 5; ++i) {
    const pid_t pid = start({"monitor", "--station", "level.station"});
    const auto reads = [this] { return file_text(folder_.string() + ".out").find("not ready") != std::string::npos; };
    for (int k = 0; k < 2000 && !reads(); ++k) ::usleep(10'000);
    ::usleep(300'000 + 140'000 * i);
    ::kill(pid, SIGTERM);
    const ProgramResult result = finish(pid);
    EXPECT_EQ(result.code, 0) << result.err;
    EXPECT_SAYS(result.out, "not ready");
    EXPECT_SAYS_NOT(result.out, "link lost");
  }
}

// Nor is it the operator who ends what the system ends.
TEST_F(TableProgram, MonitorThatIsToldToEndWhileItConnectsSaysSo) {
  wait_for_answers();
  drives.reads_answered = false;
  for (const int signal : {SIGTERM, SIGINT}) {
    const pid_t pid = start({"monitor", "--station", "level.station"});
    ::usleep(1'000'000);
    ::kill(pid, signal);
    const ProgramResult result = finish(pid);
    EXPECT_EQ(result.code, signal == SIGTERM ? 75 : 30) << result.err;
    EXPECT_SAYS(result.err, signal == SIGTERM ? "told to end" : "stopped by the operator");
  }
  drives.reads_answered = true;
}

// Three answers take longer than a line is to wait.
TEST_F(TableProgram, MonitorShowsTheUnitOfASlowTable) {
  wait_for_answers();
  const Result<FrameDescription> frame = good(find_frame("laser_gyro"));
  drives.answer_s = 0.4;
  std::atomic<bool> ended = false;
  std::thread unit([&] {
    FrameEncoder encoder(*frame);
    for (ImuSample sample; !ended; ++sample.counter, ::usleep(5000)) {
      std::vector<std::byte> bytes;
      EXPECT_TRUE(encoder.append(sample, bytes).ok());
      static_cast<void>(unit_.write_all(bytes, 0.0).ok());  // nobody may listen
    }
  });
  const ProgramResult result = run({"monitor", "--station", "level.station", "--for", "5s"});
  ended = true;
  unit.join();
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_SAYS(result.out, "samples/s, 0 gaps (0 lost)");
  EXPECT_SAYS_NOT(result.out, "no samples");
}

// A drive that answers with a failure is there.
TEST_F(TableProgram, MonitorSaysFaultOfADriveThatAnswersWithAnException) {
  const pid_t pid = start({"monitor", "--station", "level.station", "--for", "2s"});
  ::usleep(600'000);
  drives.exception = 4;
  const ProgramResult result = finish(pid);
  drives.exception = 0;
  EXPECT_SAYS(result.out, "heading FAULT; pitch FAULT; roll FAULT; ");
  EXPECT_SAYS_NOT(result.out, "link lost");
  EXPECT_EQ(result.code, 50);
  EXPECT_SAYS(result.err, "exception 4");
}

// No position is plausible in the wrong word order, so that connecting fails: what would fit is said all the same.
TEST_F(TableProgram, CommissionSaysWhichWordOrderFitsWhereNoPositionIsPlausible) {
  {
    const std::lock_guard lock(drives.mutex);
    drives.drives[1].position = 30'000.0;
    drives.drives[2].position = 20'000.0;
    drives.drives[3].position = -10'000.0;
  }
  drives.words_swapped = true;
  const ProgramResult result =
      ends({"commission", "--station", "level.station", "--heading", "30", "--pitch", "20", "--roll", "-10"}, 1,
           "expected words.order = low_first");
  EXPECT_SAYS(result.err, "; nothing was moved");
  EXPECT_EQ(drives.words(), 0u) << "nothing was written";
}

// Whatever ended it, the error says how the table was left; and of a twin that it was one.
TEST_F(TableProgram, CommissionThatFailsSaysHowTheTableWasLeft) {
  const ProgramResult rests = commission([this](pid_t) {
    drives.exception = 4;
    ::usleep(300'000);
    drives.exception = 0;
  });
  EXPECT_EQ(rests.code, 50);
  EXPECT_SAYS(rests.err, "exception 4");
  EXPECT_SAYS(rests.err, "the table rests, its drives are off");
  EXPECT_TRUE(rests.err.starts_with("turncal: ")) << rests.err;
  EXPECT_TRUE(drives.all_off());
}

// Said once, when the run's own time for a stop is over: nothing is tried a second time by whoever leaves the table.
TEST_F(TableProgram, RunThatCannotVerifyItsStopSaysSoInItsTime) {
  const std::string station = file_text(path("level.station"));
  write("level.station", station + "imu.timeout_s = 1\nmotion.stall_s = 1\nmotion.deadline_margin_s = 2\n");
  drives.refuses_off = 1'000'000;
  const double began_s = monotonic_s();
  const ProgramResult result =
      ends({"run", "--station", "level.station", "--unit", "U", "--out", "run"}, 50, "no sample from the IMU");
  EXPECT_SAYS(result.err, "THE STOP COULD NOT BE VERIFIED");
  EXPECT_SAYS(result.out, "stopping -> failed  deadline: THE STOP COULD NOT BE VERIFIED");
  EXPECT_LT(monotonic_s() - began_s, 9.0) << "1 s of silence, 1 + 2 s of stop, and the ramps";
}

// Bounded by what docs/tables.md says of a program that leaves a table.
TEST_F(TableProgram, CommissionThatCannotVerifyItsStopEndsAfterTenSeconds) {
  drives.refuses_off = 1'000'000;
  const double began_s = monotonic_s();
  const ProgramResult result = commission([](pid_t pid) { ::kill(pid, SIGTERM); });
  EXPECT_EQ(result.code, 50);
  EXPECT_SAYS(result.err, "told to end");
  EXPECT_SAYS(result.err, "THE STOP COULD NOT BE VERIFIED");
  EXPECT_LT(monotonic_s() - began_s, 15.0);
}

}  // namespace
}  // namespace turncal
