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

// Whatever ends it, the drives are off, and the error says how the table was left; where that cannot be verified, in the time that
// docs/tables.md gives a program that leaves a table.
TEST_F(TableProgram, CommissionEndsSafelyWhateverEndsIt) {
  const char* const left = "the table rests, its drives are off";
  struct Row {
    const char* what;
    std::function<void(pid_t)> happens;
    int code;
    std::vector<const char*> says;
    double within_s = 10.0;  // where a move that takes too long is no earlier
  };
  for (const Row& row : {Row{"SIGTERM", [](pid_t pid) { ::kill(pid, SIGTERM); }, 75, {"told to end", left}},
                         Row{"SIGINT", [](pid_t pid) { ::kill(pid, SIGINT); }, 30, {"stopped by the operator", left}},
                         Row{"signals of a terminal, which would leave a table that turns unwatched",
                             [](pid_t pid) {
                               for (const int signal : {SIGTSTP, SIGTTIN, SIGTTOU}) ::kill(pid, signal);
                               ::usleep(200'000);
                               int status = 0;
                               EXPECT_EQ(::waitpid(pid, &status, WNOHANG | WUNTRACED), 0) << "it stands";
                               ::kill(pid, SIGTERM);
                             },
                             75,
                             {"told to end"}},
                         Row{"another axis turns",
                             [this](pid_t) {
                               const std::lock_guard lock(drives.mutex);
                               LevelDrive& roll = drives.drives[3];
                               roll.pass();
                               roll.target = 45'000.0;
                               roll.rate = 10'000.0;
                             },
                             50,
                             {"roll moves although nothing sent it"}},
                         Row{"a drive goes off",
                             [this](pid_t) {
                               const std::lock_guard lock(drives.mutex);
                               drives.drives[2].write_control(0);
                             },
                             50,
                             {"drive of axis pitch is off", left}},
                         Row{"a failure",
                             [this](pid_t) {
                               drives.exception = 4;
                               ::usleep(300'000);
                               drives.exception = 0;
                             },
                             50,
                             {"exception 4", left}},
                         Row{"drives that stay on",
                             [this](pid_t pid) {
                               drives.refuses_off = 1'000'000;
                               ::kill(pid, SIGTERM);
                             },
                             50,
                             {"told to end", "THE STOP COULD NOT BE VERIFIED"},
                             15.0}}) {
    SCOPED_TRACE(row.what);
    double began_s = 0.0;
    const ProgramResult result = commission([&](pid_t pid) {
      began_s = monotonic_s();
      row.happens(pid);
    });
    EXPECT_LT(monotonic_s() - began_s, row.within_s);
    EXPECT_EQ(result.code, row.code) << result.err;
    EXPECT_EQ(result.err_lines(), 1) << result.err;
    EXPECT_TRUE(result.err.starts_with("turncal: ")) << result.err;
    EXPECT_TRUE(result.out.starts_with("level drives at 127.0.0.1:")) << "what stands there: " << result.out;
    for (const char* words : row.says) EXPECT_SAYS(result.err, words);
    EXPECT_EQ(drives.all_off(), drives.refuses_off == 0);
    EXPECT_LT(drives.drive(3).position, 10'000.0) << "10 deg at 10 deg/s, where a poll takes 0.1 s";
  }
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

// Drives that somebody else left on, or that fail while it looks: a drive that answers with a failure is there.
TEST_F(TableProgram, MonitorSaysHowItLeavesTheDrives) {
  struct Row {
    const char* what;
    std::function<void()> happens;  // after 1.2 s of 2
    int code;
    std::vector<const char*> says;
  };
  for (const Row& row :
       {Row{"they go off", [] {}, 0, {"not ready (on, by somebody else"}},
        Row{"an exception",
            [this] { drives.exception = 4; },
            50,
            {"heading FAULT; pitch FAULT; roll FAULT; ", "exception 4"}},
        Row{"nothing can be read", [this] { drives.reads_answered = false; }, 50, {"THE STOP COULD NOT BE VERIFIED"}},
        Row{"they stay on", [this] { drives.refuses_off = 1'000'000; }, 50, {"THE STOP COULD NOT BE VERIFIED"}}}) {
    SCOPED_TRACE(row.what);
    {
      const std::lock_guard lock(drives.mutex);
      for (auto& [unit, drive] : drives.drives) drive.control = 1;
    }
    const pid_t pid = start("monitor --station level.station --for 2s");
    ::usleep(1'200'000);
    row.happens();
    const ProgramResult result = finish(pid);
    drives.exception = 0;
    drives.reads_answered = true;
    EXPECT_EQ(result.code, row.code) << result.err;
    EXPECT_EQ(result.err_lines(), row.code == 0 ? 0 : 1) << result.err;
    for (const char* words : row.says) EXPECT_SAYS(result.out + result.err, words);
    EXPECT_TRUE(row.code != 0 || drives.all_off());
  }
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
  const ProgramResult result = run({"monitor", "--station", "level.station", "--for", "3s"});
  ended = true;
  unit.join();
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_SAYS(result.out, "samples/s, 0 gaps (0 lost)");
  EXPECT_SAYS_NOT(result.out, "no samples");
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

}  // namespace
}  // namespace turncal
