// Peers that nobody here wrote: our driver runs a sequence on a table that python3-pymodbus serves, over TCP and, through socat, over
// RTU; mbpoll reads the registers of our twin. scripts/install-deps --tests installs them.
#include <signal.h>
#include <sys/wait.h>

#include "imu_io/base/clock.h"
#include "orchestrator/run/station_run.h"
#include "tests/imu_io/loopback.h"
#include "tests/orchestrator/rig_station.h"
#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

// A program in the background, ended with this object.
class PeerProgram {
 public:
  explicit PeerProgram(const std::vector<std::string>& words) {
    pid_ = ::fork();
    if (pid_ != 0) return;
    std::vector<char*> arguments;
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    ::execvp(arguments[0], arguments.data());
    ::_exit(127);
  }
  ~PeerProgram() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGTERM);
    ::waitpid(pid_, nullptr, 0);
  }
  bool ended() {
    if (pid_ > 0 && ::waitpid(pid_, nullptr, WNOHANG) != 0) pid_ = -1;
    return pid_ <= 0;
  }
  PeerProgram(const PeerProgram&) = delete;
  PeerProgram& operator=(const PeerProgram&) = delete;

 private:
  pid_t pid_ = -1;
};

std::string output_of(const std::string& command, int& status) {
  std::string text;
  FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
  char chunk[256];
  while (std::fgets(chunk, sizeof chunk, pipe) != nullptr) text += chunk;
  status = ::pclose(pipe);
  return text;
}

bool wait_for_port(PeerProgram& server, int port, double seconds) {
  const Deadline deadline(seconds);
  while (!deadline.passed() && !server.ended()) {
    const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address = test::loopback(port);
    const bool there = ::connect(s, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
    ::close(s);
    if (there) return true;
    ::usleep(20000);
  }
  return false;
}

bool wait_for_file(const std::string& path, double seconds) {
  const Deadline deadline(seconds);
  while (!deadline.passed()) {
    if (::access(path.c_str(), F_OK) == 0) return true;
    ::usleep(10000);
  }
  return false;
}

std::string temporary(const std::string& name) {
  return testing::TempDir() + "turncal_" + name + "_" + std::to_string(::getpid());
}

// 200 samples a second of wall time from a unit that feels nothing.
class StillImu : public ImuSource {
 public:
  Status open() override {
    began_s_ = monotonic_s();
    return {};
  }
  Result<ImuIdentity> identify() override { return ImuIdentity{"", "a still unit"}; }
  void describe(RecordingInfo& info) const override {
    info.gyro_increment = info.accel_increment = IncrementKind::physical;
    info.simulated = true;
    info.sample_period_s = period_s;
  }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    const Deadline deadline(timeout_s);
    std::size_t count = 0;
    while (count < out.size() && !deadline.passed()) {
      const double due_s = began_s_ + period_s * double(next_ + 1);
      if (monotonic_s() < due_s) {
        if (count > 0) break;
        ::usleep(500);
        continue;
      }
      out[count] = ImuSample();
      out[count++].counter = next_++;
    }
    return count;
  }
  ImuLinkCounters counters() const override { return {}; }
  void close() override {}

 private:
  static constexpr double period_s = 0.005;
  double began_s_ = 0.0;
  std::int64_t next_ = 0;
};

// What the pair of registers of a position holds, read by mbpoll.
long counts_of(const std::string& link, int unit) {
  int status = 0;
  const std::string text =
      output_of("mbpoll -0 -1 -q -B -t 4:int -a " + std::to_string(unit) + " -r 256 -c 1 " + link, status);
  EXPECT_EQ(status, 0) << text;
  const std::size_t place = text.find("[256]:");
  EXPECT_NE(place, std::string::npos) << text;
  return place == std::string::npos ? 0 : std::strtol(text.c_str() + place + 6, nullptr, 10);
}

void run_a_sequence_on(RegisterMap map) {
  RealClock clock;
  DescribedTurntable driver(map, clock);
  TestRun run(
      "format = 1\nname = short\nrate_degps = 40\nacceleration_degps2 = 100\n"
      "step 1\n  initial H 0 P 0 R 0\n  align 200\n  rotate P +20\n  dwell 200\n  rotate R -10\n");
  run.station.motion.settle_s = 0.1;
  run.station.motion.poll_moving_s = 0.05;
  run.station.dwell.stillness_window_s = 0.1;
  StillImu imu;
  const auto wait = [](double seconds) { ::usleep(unsigned(1e6 * seconds)); };
  ended(run.run({driver, imu, clock, wait}), RunState::done);
  // 10000 counts a degree; pitch counts backwards, roll's zero is at 12.5 deg.
  EXPECT_NEAR(driver.status(Axis::pitch)->position_deg, 20.0, 1e-4);
  EXPECT_NEAR(driver.status(Axis::roll)->position_deg, -10.0, 1e-4);
  EXPECT_EQ(std::ranges::count(run.sink.segments, SegmentKind::still, &Segment::kind), 1);
}

const std::string script = std::string(TURNCAL_SOURCE_DIR) + "/tests/turntable_drivers/modbus/pymodbus_drive.py";

TEST(ModbusPeers, PymodbusServesATableOverTcp) {
  const int port = test::free_port(SOCK_STREAM);
  PeerProgram server({"/usr/bin/python3", script, "tcp", std::to_string(port)});
  ASSERT_TRUE(wait_for_port(server, port, 20.0)) << "python3-pymodbus: scripts/install-deps --tests installs it";
  RegisterMap map = map_of(plain_map_text("tcp"));
  map.link.address = "127.0.0.1:" + std::to_string(port);
  run_a_sequence_on(map);
  const std::string link = "-m tcp -p " + std::to_string(port) + " 127.0.0.1";
  EXPECT_EQ(counts_of(link, 2), -200000);
  EXPECT_EQ(counts_of(link, 3), -225000);
}

TEST(ModbusPeers, SocatCarriesRtuToPymodbus) {
  const int port = test::free_port(SOCK_STREAM);
  const std::string device = temporary("socat");
  PeerProgram server({"/usr/bin/python3", script, "rtu", std::to_string(port)});
  ASSERT_TRUE(wait_for_port(server, port, 20.0)) << "python3-pymodbus: scripts/install-deps --tests installs it";
  const PeerProgram socat({"socat", "PTY,link=" + device + ",raw,echo=0", "TCP:127.0.0.1:" + std::to_string(port)});
  ASSERT_TRUE(wait_for_file(device, 10.0)) << "socat: scripts/install-deps --tests installs it";
  RegisterMap map = map_of(plain_map_text("rtu"));
  map.link.address = device;
  run_a_sequence_on(map);
}

TEST(ModbusPeers, MbpollReadsTheTwinOverTcpAndRtu) {
  for (const bool tcp : {true, false}) {
    RigConfig config = default_rig_config();
    config.table.power_on_deg = {12.0, -34.5, 67.0};
    TwinStation station(map_of(plain_map_text(tcp ? "tcp" : "rtu")), config);
    const std::string link = tcp ? "-m tcp -p " + std::to_string(station.server.port()) + " 127.0.0.1"
                                 : "-m rtu -b 115200 " + station.server.address();
    EXPECT_EQ(counts_of(link, 1), 120000);
    EXPECT_EQ(counts_of(link, 2), 345000);
    EXPECT_EQ(counts_of(link, 3), 545000);
    int status = 0;
    const std::string refused = output_of("mbpoll -0 -1 -q -t 4 -a 1 -r 4000 -c 1 " + link, status);
    EXPECT_SAYS(refused, "Illegal data address");
    // It enables the drive by a write of its own.
    const std::string written = output_of("mbpoll -0 -1 -q -t 4 -a 1 -r 512 " + link + " 1", status);
    EXPECT_EQ(status, 0) << written;
    station.pass(0.01);
    const std::lock_guard lock(station.server.mutex);
    EXPECT_TRUE(station.mock.status(Axis::heading)->enabled);
  }
}

}  // namespace
}  // namespace turncal
