// The program at a table whose control word is its enable (tests/turntable_drivers/level_drives.h): however `commission` and `monitor` end,
// the drives are off, and what is said of them is what was read.
#include <gtest/gtest.h>

#include <cstring>
#include <functional>

#include "imu_io/lines/pty.h"
#include "tests/orchestrator/program.h"
#include "tests/turntable_drivers/level_drives.h"

namespace turncal {
namespace {

class TableProgram : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    Result<Pty> unit = Pty::create();
    ASSERT_TRUE(unit.ok());
    unit_ = std::move(*unit);
    write("level.map", drives.map_text());
    write("level.station",
          "format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = modbus\ntable.map = "
          "level.map\n"
          "imu.driver = serial\nimu.frame = laser_gyro\nimu.device = " +
              unit_.device() + "\n");
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

TEST_F(TableProgram, CommissionThatIsToldToEndSaysSoAndThatTheTableRests) {
  for (const int signal : {SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, SIGINT}) {
    SCOPED_TRACE(strsignal(signal));
    const ProgramResult result = commission([signal](pid_t pid) { ::kill(pid, signal); });
    EXPECT_EQ(result.code, signal == SIGINT ? 30 : 75);
    EXPECT_EQ(result.err_lines(), 1) << result.err;
    EXPECT_NE(result.err.find(signal == SIGINT ? "stopped by the operator" : "told to end"), std::string::npos)
        << result.err;
    EXPECT_NE(result.err.find("the table rests, its drives are off"), std::string::npos) << result.err;
    EXPECT_TRUE(drives.all_off());
  }
}

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
  EXPECT_NE(result.err.find("roll moves although nothing sent it"), std::string::npos) << result.err;
  EXPECT_TRUE(drives.all_off());
  EXPECT_LT(drives.drive(3).position, 10'000.0) << "10 deg at 10 deg/s, where a poll takes 0.1 s";
}

TEST_F(TableProgram, MonitorShowsADriveThatIsOnAndSwitchesItOff) {
  switch_on();
  const ProgramResult result = run({"monitor", "--station", "level.station", "--seconds", "1"});
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_NE(result.out.find("not ready (on, by somebody else"), std::string::npos) << result.out;
  EXPECT_EQ(result.out.find("(off"), std::string::npos) << result.out;
  EXPECT_TRUE(drives.all_off());
}

TEST_F(TableProgram, MonitorSaysThatADriveStaysOn) {
  switch_on();
  drives.refuses_off = 1'000'000;
  const ProgramResult result = run({"monitor", "--station", "level.station", "--seconds", "1"});
  EXPECT_EQ(result.code, 50);
  EXPECT_EQ(result.err_lines(), 1) << result.err;
  EXPECT_NE(result.err.find("THE STOP COULD NOT BE VERIFIED"), std::string::npos) << result.err;
}

TEST_F(TableProgram, MonitorSaysThatItCouldNotReadTheTableAtLast) {
  const pid_t pid = start({"monitor", "--station", "level.station", "--seconds", "2"});
  ::usleep(1'200'000);
  drives.reads_answered = false;
  const ProgramResult result = finish(pid);
  drives.reads_answered = true;
  EXPECT_EQ(result.code, 50);
  EXPECT_EQ(result.err_lines(), 1) << result.err;
  EXPECT_NE(result.err.find("THE STOP COULD NOT BE VERIFIED"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace turncal
