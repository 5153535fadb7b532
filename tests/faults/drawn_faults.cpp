// Runs of the whole program over real lines against a table and a unit that misbehave, and a PC that fails, as drawn from a seed; what
// came of each is judged by what the rig knows to be true (docs/safety.md, Drawn faults).
//
//   drawn_faults --runs N --seed S --jobs J [--only CLASS] [--keep] [--verbose]
// The runs have the seeds S, S + 1 ...: one is drawn again with --runs 1 --seed ITS (and the same --only). Exit code 1: a violation.
#include <sys/prctl.h>
#include <sys/wait.h>

#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_encoder.h"
#include "imu_io/lines/unit_end.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "tests/faults/misbehaving_table.h"
#include "tests/test.h"
#include "turntable_drivers/twins/dialect_twin.h"
#include "turntable_drivers/twins/modbus_twin.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;
const std::string source = TURNCAL_SOURCE_DIR;

// Of the wall clock: what a busy machine may take for a poll, and what a run may take beyond its undisturbed length.
constexpr double slack_s = 0.3, patience_s = 60.0, answer_s = 0.5;
constexpr double speed_up = 50.0, period_s = 0.005;

// --- What is run: one of two sequences over one of five tables.

struct Setting {
  std::uint64_t seed = 0;
  bool calibrates = false;
  int table = 0;
  double length_s = 0.0;  // undisturbed, of the station
  std::array<double, 3> power_on_deg{};
  std::vector<Fault> faults;
  bool tcp() const { return table == 0 || table == 2; }
  bool modbus() const { return table < 2; }
};
constexpr std::array<const char*, 5> tables = {"Modbus TCP", "Modbus RTU", "acutronic_acl, TCP",
                                               "three_axis_dollar, pty", "newport_esp30x, pty"};

Setting draw_setting(std::uint64_t seed, int only) {
  Draw draw(seed);
  Setting setting;
  setting.seed = seed;
  setting.calibrates = draw.chance(0.5);
  setting.table = int(draw.pick(tables.size()));
  setting.length_s = setting.calibrates ? 420.0 : 400.0;
  for (double& angle : setting.power_on_deg) angle = draw.uniform(-20.0, 20.0);
  setting.faults = draw_faults(draw, setting.length_s, only);
  return setting;
}

// The four steps that determine everything; or two long turns, slow enough that minutes of a wrong rate are seconds of the wall.
std::string sequence_text(const Setting& setting) {
  if (setting.calibrates) {
    std::istringstream demo(file_text(source + "/sequences/short_demo.seq"));
    std::string text, line;
    while (std::getline(demo, line) && !line.starts_with("step 5")) {
      if (line.starts_with("rate_degps")) line = "rate_degps = 10";
      if (line.starts_with("acceleration_degps2")) line = "acceleration_degps2 = 10";
      text += line + '\n';
    }
    return text;
  }
  const char* const axis = setting.seed % 3 == 0 ? "H" : setting.seed % 3 == 1 ? "P" : "R";
  return std::string("format = 1\nname = turns\nrate_degps = 4\nacceleration_degps2 = 4\nstep 1 \"turns\"\n") +
         "  initial H 0 P 0 R 0\n  align 2000\n  rotate " + axis + " +720\n  dwell 2000\n  rotate " + axis +
         " -720\n  dwell 2000\n";
}

std::string without_keys(const std::string& path, const std::vector<std::string>& keys) {
  std::istringstream file(file_text(path));
  std::string text, line;
  while (std::getline(file, line))
    if (std::ranges::none_of(keys, [&](const std::string& key) { return line.starts_with(key); })) text += line + '\n';
  return text;
}

// The station's files; the line of the table is known only once it is open.
std::string station_text(const Setting& setting, const fs::path& folder, const std::string& address) {
  const double rate = setting.calibrates ? 12.0 : 5.0, most = setting.calibrates ? 370.0 : 730.0;
  std::string text =
      "format = 1\nstation.name = drawn\ntable.simulated = true\nimu.driver = serial\nimu.simulated = true\n";
  text += setting.modbus() ? "table.driver = modbus\ntable.map = table.map\n"
                           : "table.driver = serial\ntable.dialect = table.dialect\n";
  text += "table.address = " + address + "\nimu.device = " + (folder / "imu").string() + "\nimu.frame = laser_gyro\n" +
          "site.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\nclock.speed_up = " + format_number(speed_up) +
          "\nimu.timeout_s = 100\nmotion.stall_s = 100\nmotion.deadline_margin_s = 200\nmotion.settle_s = 1\n"
          "motion.poll_moving_s = 1\nmotion.poll_idle_s = 5\nresume.rest_s = 10\n";
  for (const char* const axis : {"heading", "pitch", "roll"}) {
    const std::string key = std::string("axis.") + axis + ".";
    text += key + "soft_min_deg = " + format_number(-most) + "\n" + key + "soft_max_deg = " + format_number(most) +
            "\n" + key + "max_rate_degps = " + format_number(rate) + "\n" + key + "max_acceleration_degps2 = 20\n" +
            key + "wrap_deg = 0\n";
  }
  return text;
}
std::string table_text(const Setting& setting) {
  static const std::array<std::string, 5> files = {"orchestrator/stations/twin.map", "orchestrator/stations/twin.map",
                                                   "turntable_drivers/ascii/dialects/acutronic_acl.dialect",
                                                   "turntable_drivers/ascii/dialects/three_axis_dollar.dialect",
                                                   "turntable_drivers/ascii/dialects/newport_esp30x.dialect"};
  const std::string kind = setting.tcp() ? "tcp" : setting.modbus() ? "rtu" : "serial";
  return without_keys(source + "/" + files[std::size_t(setting.table)],
                      {"commissioned", "link.kind", "link.parity", "plausible", "link.address", "heartbeat.period_s",
                       "heartbeat.watchdog_s"}) +
         // Of the rig's seconds: this twin's clock is the rig's.
         (setting.modbus() ? "heartbeat.period_s = 20\nheartbeat.watchdog_s = 200\n" : "") +
         "commissioned = true\nlink.kind = " + kind +
         (kind == "rtu" ? "\nlink.parity = none"
                        : "") +  // a pseudo-terminal has none, and refuses to be set to one twice
         "\nlink.address = " +
         (setting.tcp() ? "127.0.0.1:1" : "/dev/null") + "\nplausible.rate_degps = 1000\nlink.quiet_s = 0.05\n" +
         (setting.modbus() ? "link.response_timeout_s" : "link.reply_timeout_s") + " = " + format_number(answer_s) +
         "\n";
}

// --- Table and unit, served.

// The unit's line, which may be pulled and be there again.
class PulledLine {
 public:
  explicit PulledLine(std::string device) : device_(std::move(device)) { plug(); }
  void plug() {
    if (Result<std::unique_ptr<UnitEnd>> made = open_unit_end(device_)) end_ = std::move(*made);
  }
  void unplug() { end_.reset(); }
  UnitEnd* end() { return end_.get(); }

 private:
  std::string device_;
  std::unique_ptr<UnitEnd> end_;
};

class DrawnStation {
 public:
  DrawnStation(const Setting& setting, const fs::path& folder)
      : setting_(setting), folder_(folder), group_(rig_config(setting), 1), imu_line_((folder / "imu").string()) {
    write_file(folder / "run.seq", sequence_text(setting));
    write_file(folder / (setting.modbus() ? "table.map" : "table.dialect"), table_text(setting));
    write_station(setting.tcp() ? "127.0.0.1:1" : (folder / "table").string());
    Result<StationConfig> read = read_station_config((folder / "run.station").string());
    if (!read) fail(read.error().message);
    station = *read;
    faults_ = setting.faults;
    table_ = std::make_unique<MisbehavingTable>(group_, faults_, station.axis);
    unit_ = std::make_unique<MisbehavingUnit>(faults_, period_s);
    if (station.table.map) {
      auto server = std::make_unique<ModbusTwin>(*station.table.map, *table_, group_);
      if (!server->power_on()) fail("the drives do not come up");
      server->disturb = [this](const ModbusRequest& request, AnswerPlan& plan) { disturb(&request, plan); };
      server_ = std::move(server);
    } else {
      auto server = std::make_unique<DialectTwin>(*station.table.dialect, *table_);
      if (!server->power_on()) fail("the table does not come up");
      server->disturb = [this](const std::string&, AnswerPlan& plan) { disturb(nullptr, plan); };
      server_ = std::move(server);
    }
    if (Status opened = setting.tcp() ? server_->listen_tcp(0) : server_->open_pty((folder / "table").string());
        !opened)
      fail(opened.error().message);
    if (setting.tcp()) write_station(server_->address());
    if (!group_.imu(0).open()) fail("the unit does not open");
  }
  // From here on there are two threads.
  void start() {
    last_pump_s_ = monotonic_s();
    thread_ = std::thread([this] {
      while (!ended_) serve();
    });
  }
  ~DrawnStation() {
    ended_ = true;
    if (thread_.joinable()) thread_.join();
  }
  // Time passes as far as it has on the wall, once a station listens.
  void pump() {
    const double now_s = monotonic_s();
    if (!begun_s_) {
      if (imu_line_.end() == nullptr || !imu_line_.end()->has_peer()) return;
      begun_s_ = last_pump_s_ = now_s;
    }
    if (now_s - last_pump_s_ > 0.02) stalls.push_back({(now_s - *begun_s_) * speed_up, now_s - last_pump_s_});
    const auto due = std::int64_t((now_s - *begun_s_) * speed_up / period_s);
    std::array<ImuSample, 32> samples;
    while (passed_ < due) {
      const auto count = std::size_t(std::min<std::int64_t>(due - passed_, samples.size()));
      passed_ += std::int64_t(count);
      std::vector<ImuSample> made;
      {
        const std::lock_guard lock(server_->mutex);
        const Result<std::size_t> got = group_.imu(0).read(std::span(samples).first(count), double(count) * period_s);
        if (!got) fail(got.error().message);
        table_->pass();
        made = unit_->send(std::span(samples).first(*got));
      }
      transmit(made);
    }
    last_pump_s_ = monotonic_s();
  }
  void heal() {
    const std::lock_guard lock(server_->mutex);
    faults_.clear();
    if (imu_line_.end() == nullptr) imu_line_.plug();
  }
  double now_s() const { return double(passed_) * period_s; }
  MisbehavingTable& table() { return *table_; }
  Rig& rig() { return group_.rig(0); }
  std::mutex& mutex() { return server_->mutex; }

  StationConfig station;
  struct Stall {
    double until_s, length_s;  // of the station; of the wall
  };
  std::vector<Stall> stalls;  // the machine had something else to do
  double longest_stall_s(double from_s, double to_s) const {
    double longest_s = 0.0;
    for (const Stall& stall : stalls)
      if (stall.until_s >= from_s && stall.until_s - speed_up * stall.length_s <= to_s)
        longest_s = std::max(longest_s, stall.length_s);
    return longest_s;
  }
  struct Sent {
    ImuSample sample;
    double time_s;
  };
  std::vector<Sent> sent;

 private:
  [[noreturn]] static void fail(const std::string& what) {
    std::cerr << "drawn_faults: " << what << '\n';
    ::_exit(3);
  }
  static RigConfig rig_config(const Setting& setting) {
    RigConfig config = default_rig_config();
    config.seed = setting.seed;
    config.table.power_on_deg = setting.power_on_deg;
    config.table.home_rate_degps = 4.0;
    config.table.home_acceleration_degps2 = 4.0;
    config.table.limit_min_deg = {-1e6, -1e6, -1e6};
    config.table.limit_max_deg = {1e6, 1e6, 1e6};
    return config;
  }
  void write_station(const std::string& address) {
    write_file(folder_ / "run.station", station_text(setting_, folder_, address));
  }

  void serve() {
    server_->run_once(0.01);
    if (setting_.tcp() || !hung_up_s_ || monotonic_s() < *hung_up_s_) return;
    hung_up_s_.reset();
    (void)server_->open_pty((folder_ / "table").string()).ok();
  }

  // In the table's thread, without the mutex.
  void disturb(const ModbusRequest* request, AnswerPlan& plan) {
    if (plan.pieces.empty()) return;
    const std::vector<std::uint8_t> good = plan.pieces[0].bytes;
    const bool checked = setting_.table == 1 || setting_.table == 3;  // by more than the line's own checksums
    const std::lock_guard lock(server_->mutex);
    for (const Fault& fault : faults_) {
      if (fault.of != FaultClass::answers || !fault.active(table_->now_s()) || !draw_.chance(fault.other_size))
        continue;
      if (plan.pieces.empty()) break;
      std::vector<std::uint8_t>& bytes = plan.pieces[0].bytes;
      const std::string_view how = fault.manner;
      const auto place = bytes.empty() ? 0 : std::size_t(fault.which) % bytes.size();
      const std::array<std::uint8_t, 4> junk = {0x5a, std::uint8_t(fault.which), '7', '\r'};
      if (how == "late") plan.pieces[0].delay_s = fault.size;
      if (how == "doubled") plan.pieces.push_back({good, 0.1 * fault.size});
      if (how == "cut") bytes.resize(place);
      if (how == "split") {
        plan.pieces.push_back({{bytes.begin() + std::ptrdiff_t(place), bytes.end()}, 0.1 * fault.size});
        plan.pieces[0].bytes.resize(place);
      }
      if (how == "junk before" && (checked || setting_.modbus())) bytes.insert(bytes.begin(), junk.begin(), junk.end());
      if (how == "junk after") bytes.insert(bytes.end(), junk.begin(), junk.end());
      if (how == "flipped bit" && checked && !bytes.empty()) bytes[place] ^= std::uint8_t(1 << fault.which % 8);
      if (how == "foreign") {
        if (request != nullptr && fault.which % 3 == 0) {
          // Another unit's, under a good check: the number of its unit is in it.
          ModbusRequest other = *request;
          other.unit = 1 + other.unit % 3;
          bytes = read_reply(other, std::vector<std::uint16_t>(std::size_t(std::clamp(other.count, 1, 120)), 7),
                             setting_.tcp());
        } else if (request != nullptr && fault.which % 3 == 1 && setting_.tcp()) {
          bytes[1] = std::uint8_t(bytes[1] + 1 + fault.which % 200);  // another transaction
        } else if (!before_.empty()) {
          bytes = before_;
        }
      }
      if (how == "exception") {
        static constexpr std::array<int, 8> codes = {1, 2, 3, 4, 5, 6, 10, 11};
        if (request != nullptr) {
          bytes = exception_reply(*request, codes[std::size_t(fault.which) % 8], setting_.tcp());
        } else if (setting_.table == 2) {
          bytes = {'E', 'R', 'R', '\n'};
        }
      }
      if (how == "silence") plan.pieces.clear();
      if (how == "hang-up") {
        plan.hang_up = true;
        hung_up_s_ = monotonic_s() + 3.0 * fault.size;
      }
    }
    before_ = good;
  }

  void transmit(const std::vector<ImuSample>& samples) {
    bool pulled = false, damaged = false;
    double share = 0.0;
    for (const Fault& fault : faults_) {
      if (fault.of != FaultClass::unit || !fault.active(now_s())) continue;
      pulled = pulled || fault.manner == "hang-up";
      damaged = damaged || fault.manner == "damaged bytes";
      if (fault.manner == "damaged bytes") share = fault.other_size;
    }
    if (pulled && imu_line_.end() != nullptr) imu_line_.unplug();
    if (!pulled && imu_line_.end() == nullptr) imu_line_.plug();
    std::vector<std::byte> bytes;
    for (const ImuSample& sample : samples) {
      ImuSample whole = sample;
      whole.counter = std::int64_t(std::uint32_t(sample.counter));
      if (!encoder_.append(whole, bytes)) fail("a sample does not fit the frame");
      sent.push_back({whole, now_s()});
    }
    for (std::byte& byte : bytes)
      if (damaged && unit_draw_.chance(0.03 * share)) byte ^= static_cast<std::byte>(1 << unit_draw_.pick(8));
    // Who does not read is waited for once.
    if (imu_line_.end() != nullptr) is_read_ = imu_line_.end()->write_all(bytes, is_read_ ? 0.5 : 0.0).ok();
  }

  const Setting& setting_;
  fs::path folder_;
  std::vector<Fault> faults_;
  RigGroup group_;
  PulledLine imu_line_;
  std::unique_ptr<MisbehavingTable> table_;
  std::unique_ptr<MisbehavingUnit> unit_;
  std::unique_ptr<LineServer> server_;
  FrameEncoder encoder_{*find_frame("laser_gyro")};
  Draw draw_{7}, unit_draw_{8};
  std::vector<std::uint8_t> before_;
  std::optional<double> hung_up_s_, begun_s_;
  double last_pump_s_ = 0.0;
  std::int64_t passed_ = 0;
  bool is_read_ = true;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

// --- The program, on a PC that may fail.

struct Outcome {
  int code = -1;  // 1000 + signal
  bool hung = false;
  double wall_s = 0.0;
  std::string err;
  std::string last_line() const {
    const std::string trimmed = err.substr(0, err.find_last_not_of('\n') + 1);
    return trimmed.substr(trimmed.rfind('\n') + 1);
  }
};

const char* binary() {
  const char* const other = std::getenv("TURNCAL_BINARY");
  return other != nullptr ? other : TURNCAL_BINARY;
}

const Fault* pc_fault(const std::vector<Fault>& faults) {
  const auto at = std::ranges::find_if(faults, [](const Fault& fault) { return fault.of == FaultClass::pc; });
  return at == faults.end() ? nullptr : &*at;
}

pid_t start_program(const fs::path& folder, const std::string& name, const std::vector<std::string>& arguments,
                    const Fault* pc) {
  std::vector<char*> argv = {const_cast<char*>(binary())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  static const std::map<std::string_view, const char*> modes = {{"sync hangs", "hang_sync"},
                                                                {"write hangs", "hang_write"},
                                                                {"write fails", "fail"},
                                                                {"disk full", "full_for"},
                                                                {"clock stepped", "clock"}};
  const std::string out = (folder / (name + ".out")).string(), err = (folder / (name + ".err")).string();
  std::vector<std::string> settings;
  if (pc != nullptr && modes.count(pc->manner) != 0) {
    const double for_s = std::isfinite(pc->end_s) ? (pc->end_s - pc->begin_s) / speed_up : 0.0;
    settings = {"LD_PRELOAD=" TURNCAL_FAULT_POINTS, std::string("TURNCAL_FAULT_MODE=") + modes.at(pc->manner),
                "TURNCAL_FAULT_AFTER_S=" + format_number(pc->begin_s / speed_up),
                "TURNCAL_FAULT_FOR_S=" + format_number(for_s), "TURNCAL_FAULT_STEP_S=" + format_number(pc->size)};
  }
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  for (const std::string& setting : settings) ::putenv(const_cast<char*>(setting.c_str()));
  ::dup2(::open("/dev/null", O_RDONLY), 0);
  ::dup2(::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), 1);
  ::dup2(::open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), 2);
  ::closefrom(3);
  ::execv(binary(), argv.data());
  ::_exit(98);
}

std::size_t virtual_bytes(pid_t pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/statm");
  std::size_t pages = 0;
  file >> pages;
  return pages * std::size_t(::sysconf(_SC_PAGESIZE));
}

// What is short from the beginning of the fault to its end.
void limit(pid_t pid, const Fault& fault, bool begins) {
  const auto resource = fault.manner == "memory short"        ? RLIMIT_AS
                        : fault.manner == "descriptors short" ? RLIMIT_NOFILE
                                                              : RLIMIT_FSIZE;
  rlimit had{};
  if (::prlimit(pid, resource, nullptr, &had) != 0) return;
  const double base = fault.manner == "memory short" ? double(virtual_bytes(pid)) : 0.0;
  had.rlim_cur = begins ? static_cast<rlim_t>(base + fault.size) : had.rlim_max;
  ::prlimit(pid, resource, &had, nullptr);
}

Outcome await(DrawnStation& station, pid_t pid, const fs::path& folder, const std::string& name, const Fault* pc,
              double patience) {
  const bool limits = pc != nullptr && pc->manner.ends_with("short");
  const double began_s = monotonic_s();
  bool begun = false, ended = false;
  Outcome outcome;
  int status = 0;
  for (;;) {
    station.pump();
    const double passed_s = speed_up * (monotonic_s() - began_s);
    if (limits && !begun && passed_s >= pc->begin_s) limit(pid, *pc, begun = true);
    if (limits && !ended && passed_s >= pc->end_s) limit(pid, *pc, !(ended = true));
    if (::waitpid(pid, &status, WNOHANG) == pid) break;
    if (monotonic_s() - began_s > patience) {
      outcome.hung = true;
      ::kill(pid, SIGKILL);
      ::waitpid(pid, &status, 0);
      break;
    }
    ::usleep(1000);
  }
  outcome.wall_s = monotonic_s() - began_s;
  outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
  outcome.err = file_text(folder / (name + ".err"));
  return outcome;
}

// --- Judgement.

struct Verdict {
  std::vector<std::string> violations;
  std::string ended;  // right, said, or violated
  void add(int rule, const std::string& what) { violations.push_back("rule " + std::to_string(rule) + ": " + what); }
};

std::string number(const char* format, double value) {
  char buffer[60];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

// Of a run that ended with 0.
void judge_parameters(DrawnStation& station, const fs::path& out, Verdict& verdict) {
  const Result<ParameterFile> file = read_parameter_file((out / "parameters.conf").string());
  if (!file) return verdict.add(1, "code 0, but " + file.error().message);
  const std::array<double, 24> truth = station.rig().truth_at_reference(file->reference_temperature_c.value_or(24.0));
  for (int i = 0; i < parameter_count; ++i) {
    const auto at = std::size_t(i);
    if (!file->sigma[at]) continue;
    const double off = (file->parameters[i] - truth[at]) / *file->sigma[at];
    if (std::abs(off) > 5.0)
      return verdict.add(
          1, "code 0 and " + std::string(parameter_keys[at]) + " is " + number("%.1f", off) + " sigma from the truth");
  }
}

bool same(const ImuSample& a, const ImuSample& b) { return a.gyro == b.gyro && a.accel == b.accel; }

std::span<const ImuSample> rest_of(const std::vector<ImuSample>& samples, const Segment& segment) {
  const auto at = [&](std::int64_t counter) {
    return std::lower_bound(samples.begin(), samples.end(), counter,
                            [](const ImuSample& sample, std::int64_t c) { return sample.counter < c; });
  };
  return {at(segment.start_sample), at(segment.end_sample)};
}
// Where these were sent, one after the other.
std::optional<std::size_t> place_in(const std::vector<DrawnStation::Sent>& sent, std::span<const ImuSample> rest) {
  const auto at =
      std::search(sent.begin(), sent.end(), rest.begin(), rest.end(),
                  [](const DrawnStation::Sent& one, const ImuSample& other) { return same(one.sample, other); });
  if (at == sent.end()) return {};
  return std::size_t(at - sent.begin());
}

void judge_recording(const Setting& setting, DrawnStation& station, const fs::path& out, Verdict& verdict) {
  const Result<std::unique_ptr<RecordingSource>> recording = RecordingSource::open(out.string());
  if (!recording) return verdict.add(1, "code 0, but " + recording.error().message);
  if (!(*recording)->damage().complete) verdict.add(1, "code 0, and the recording has no end");
  std::vector<ImuSample> samples;
  const Status read = (*recording)->read([&](std::span<const ImuSample> block) {
    samples.insert(samples.end(), block.begin(), block.end());
    return Status();
  });
  if (!read) return verdict.add(1, "code 0, but " + read.error().message);
  const std::string sequence = sequence_text(setting);
  std::size_t wanted = 0, found = 0;
  for (std::istringstream lines(sequence); lines;) {
    std::string word, rest;
    lines >> word;
    std::getline(lines, rest);
    wanted += word == "align" || word == "dwell" ? 1 : 0;
  }
  const TrueMotion& motion = station.table().motion;
  for (const Segment& segment : (*recording)->segments()) {
    if (segment.kind == SegmentKind::rotate) continue;
    ++found;
    const auto rest = rest_of(samples, segment);
    const std::string of_rest =
        "the rest of samples " + std::to_string(segment.start_sample) + " to " + std::to_string(segment.end_sample);
    if (rest.size() != std::size_t(segment.end_sample - segment.start_sample))
      return verdict.add(1, "code 0, and " + of_rest + " has " + std::to_string(rest.size()) + " samples");
    const std::optional<std::size_t> sent_at = place_in(station.sent, rest);
    if (!sent_at) return verdict.add(1, "code 0, and " + of_rest + " was never sent so");
    const std::size_t from = motion.place(station.sent[*sent_at].time_s),
                      to = motion.place(station.sent[*sent_at + rest.size() - 1].time_s);
    const std::array<double, 3> said = {segment.heading_deg, segment.pitch_deg, segment.roll_deg};
    for (std::size_t i = 0; i < 3; ++i) {
      double low = 1e9, high = -1e9;
      for (std::size_t k = from; k < std::min(to, motion.moments.size()); ++k) {
        low = std::min(low, motion.moments[k].position_deg[i]);
        high = std::max(high, motion.moments[k].position_deg[i]);
      }
      const std::string where =
          std::string(to_string(all_axes[i])) + " in the rest at " + number("%.1f s", station.sent[*sent_at].time_s);
      if (high - low > 0.02)
        return verdict.add(1, "code 0, and " + where + " turned by " + number("%.4g deg", high - low));
      // A device that knows only a circle has forgotten the turns once it is opened anew.
      const auto& dialect = station.station.table.dialect;
      const double circle_deg = dialect ? dialect->of(all_axes[i]).modulo_deg : 0.0;
      const double off_deg = circle_deg > 0.0 ? std::remainder(high - said[i], circle_deg) : high - said[i];
      if (std::abs(off_deg) > 0.05)
        return verdict.add(1, "code 0, and " + where + " stood at " + number("%.4f", high) + ", recorded " +
                                  number("%.4f deg", said[i]));
    }
  }
  if (found < wanted) verdict.add(1, "code 0 with " + std::to_string(found) + " rests of " + std::to_string(wanted));
}

bool says(const Outcome& outcome, const char* words) { return outcome.err.find(words) != std::string::npos; }

// Rules 1 and 4: how it ended.
void judge_outcome(const Setting& setting, DrawnStation& station, const fs::path& out, const Outcome& outcome,
                   bool touched, Verdict& verdict) {
  const Fault* const pc = pc_fault(setting.faults);
  if (outcome.hung) return verdict.add(4, "not ended after " + number("%.0f s", outcome.wall_s));
  if (outcome.code == 0) {
    verdict.ended = "right";
    if (setting.calibrates) judge_parameters(station, out, verdict);
    if (!setting.calibrates) judge_recording(setting, station, out, verdict);
    return;
  }
  verdict.ended = "said";
  const bool memory = pc != nullptr && pc->manner == "memory short";
  // Until a run homes the table's refusals are the map's (docs/tables.md).
  const bool refused = outcome.code == 1 && says(outcome, "turncal: connecting: ");
  if (outcome.code != 50 && outcome.code != 20 && !refused && !(memory && outcome.code == 70))
    verdict.add(1, "code " + std::to_string(outcome.code) + ", expected 0, 20 or 50");
  std::istringstream said(outcome.err);
  int errors = 0;
  for (std::string line; std::getline(said, line);) errors += line.find("warning: ") == std::string::npos ? 1 : 0;
  if (errors != 1) verdict.add(1, "failed with " + std::to_string(errors) + " lines of error");
  if (!touched) verdict.add(1, "failed, and nothing had been disturbed");
}

// Rule 2: how it was left.
void judge_end(DrawnStation& station, const fs::path& out, const Outcome& outcome, Verdict& verdict) {
  const auto& dialect = station.station.table.dialect;
  const bool tells_drives = !dialect || dialect->status.reports(DriveBit::enabled);
  std::ifstream log(out / "run.log");
  const std::string said = outcome.err + std::string(std::istreambuf_iterator<char>(log), {});
  const bool says_so = said.find("it does not tell whether they are") != std::string::npos;
  const std::lock_guard lock(station.mutex());
  if (says(outcome, "COULD NOT BE VERIFIED")) return;
  for (const Axis axis : all_axes) {
    const AxisStatus truth = station.table().truth(axis);
    const std::optional<AxisStatus>& told = station.table().told(index(axis));
    if (!truth.enabled && truth.rate_degps == 0.0) continue;
    // What the table itself denies nobody can know.
    if (!tells_drives && truth.rate_degps == 0.0 && says_so) continue;
    const bool told_on = told && told->enabled && tells_drives;
    const bool denied = told && !told_on && !told->moving && told->rate_degps == 0.0;
    if (denied) continue;
    verdict.add(2, std::string(to_string(axis)) + " was left " + (truth.enabled ? "on" : "off") + " at " +
                       number("%.3g deg/s", truth.rate_degps) + ", and nothing says so");
    return;
  }
}

// Rule 3: the time from the beginning of what is beyond the limits to the first order to stop.
void judge_motion(const Setting& setting, DrawnStation& station, Verdict& verdict) {
  const std::lock_guard lock(station.mutex());
  TrueMotion& motion = station.table().motion;
  for (auto& excess : motion.now)
    if (excess) motion.over.push_back(*excess);
  const bool disturbed =
      std::ranges::any_of(setting.faults, [](const Fault& fault) { return fault.of == FaultClass::answers; });
  // A poll, what a busy machine takes, and of a line that does not answer three tries.
  const TrueMotion::Excess* worst = nullptr;
  double longest_s = 0.0, allowed_s = 0.0;
  for (const auto& excess : motion.over) {
    const double end_s = excess.answered_s.value_or(excess.until_s), took_s = end_s - excess.began_s;
    const double may_s = station.station.motion.poll_moving_s +
                         speed_up * (slack_s + 2.0 * station.longest_stall_s(excess.began_s, end_s) +
                                     (disturbed ? 3.0 * answer_s : 0.0));
    if (took_s <= may_s || took_s <= longest_s) continue;
    longest_s = took_s;
    allowed_s = may_s;
    worst = &excess;
  }
  if (worst == nullptr) return;
  verdict.add(3, std::string(to_string(static_cast<Axis>(worst->axis))) + " beyond its limits for " +
                     number("%.1f s", longest_s) + " from " + number("%.1f s on", worst->began_s) +
                     number(" (at most %.1f s), ", allowed_s) + number("%.3g deg/s", worst->rate_degps) +
                     number(" at %.1f deg", worst->position_deg) +
                     (worst->told ? "" : "; the table told nothing of it") +
                     (worst->answered_s ? "" : "; no order to stop"));
}

void run_one(const Setting& setting, const fs::path& folder, std::ostream& report) {
  fs::create_directories(folder);
  DrawnStation station(setting, folder);
  const Fault* const pc = pc_fault(setting.faults);
  const std::string folder_name = folder.string();
  std::vector<std::string> arguments = {"run", "--unit", "DRAWN", "--no-diagnosis"};
  for (const auto& [option, name] :
       {std::pair("--station", "/run.station"), {"--out", "/out"}, {"--sequence", "/run.seq"}})
    arguments.insert(arguments.end(), {option, folder_name + name});
  if (!setting.calibrates) arguments.push_back("--capture-only");
  const pid_t pid = start_program(folder, "run", arguments, pc);
  station.start();
  const bool slow =
      std::ranges::any_of(setting.faults, [](const Fault& fault) { return fault.of == FaultClass::answers; });
  const double patience = setting.length_s / speed_up + (slow ? 3.0 : 1.0) * patience_s;
  const Outcome outcome = await(station, pid, folder, "run", pc, patience);
  Verdict verdict;
  const double ended_s = std::max(station.now_s(), speed_up * outcome.wall_s);
  const bool touched =
      std::ranges::any_of(setting.faults, [&](const Fault& fault) { return fault.begin_s <= ended_s; });
  judge_outcome(setting, station, folder / "out", outcome, touched, verdict);
  if (!outcome.hung) judge_end(station, folder / "out", outcome, verdict);
  judge_motion(setting, station, verdict);
  if (fs::exists(folder / "out" / "journal.tcj") && !outcome.hung && outcome.code != 0) {
    station.heal();
    const Outcome journal =
        await(station, start_program(folder, "journal", {"journal", (folder / "out").string()}, nullptr), folder,
              "journal", nullptr, 30.0);
    if (journal.code != 0)
      verdict.add(5, "turncal journal: code " + std::to_string(journal.code) + ": " + journal.last_line());
    if (says(outcome, "turncal resume") && journal.code == 0) {
      const Outcome resumed =
          await(station, start_program(folder, "resume", {"resume", (folder / "out").string()}, nullptr), folder,
                "resume", nullptr, patience);
      if (resumed.code != 0 && resumed.code != 20) {
        verdict.add(5, "turncal resume, all healed: code " + std::to_string(resumed.code) + ": " + resumed.last_line());
      } else if (resumed.code == 0) {
        Verdict then;
        if (setting.calibrates) judge_parameters(station, folder / "out", then);
        if (!setting.calibrates) judge_recording(setting, station, folder / "out", then);
        for (const std::string& what : then.violations) verdict.add(5, "resumed, " + what);
      }
    }
  }
  // Answers that came too late because the machine stood still are no fault of the program.
  const double stall_s = station.longest_stall_s(0.0, 1e9);
  const auto of_answers = [](const std::string& what) {
    return what.starts_with("rule 1") || what.starts_with("rule 5");
  };
  const bool violated = !verdict.violations.empty();
  const bool stalled = violated && stall_s > 0.4 * answer_s && std::ranges::all_of(verdict.violations, of_answers);
  report << (stalled ? "stalled" : violated ? "violated" : verdict.ended) << '\n';
  if (stalled) report << "  not judged: the machine stood still for " << number("%.2f s", stall_s) << '\n';
  report << "  seed " << setting.seed << ": " << (setting.calibrates ? "calibrates" : "captures") << ", "
         << tables[std::size_t(setting.table)] << "; code " << outcome.code << " after "
         << number("%.1f s", outcome.wall_s) << '\n';
  for (const Fault& fault : setting.faults) report << "    drawn: " << fault.text() << '\n';
  for (const std::string& what : verdict.violations) report << "    " << what << '\n';
  if (!outcome.err.empty()) report << "    said: " << outcome.last_line() << '\n';
}

struct Options {
  std::uint64_t runs = 60, seed = 1;
  std::size_t jobs = 8;
  int only = -1;
  bool keep = false, verbose = false;
};

struct Count {
  int runs = 0, right = 0, said = 0, stalled = 0, violated = 0;
};

int run_all(const Options& options) {
  const fs::path base = (::access("/dev/shm", W_OK) == 0 ? fs::path("/dev/shm") : fs::temp_directory_path()) /
                        ("drawn_faults_" + std::to_string(::getpid()));
  fs::create_directories(base);
  std::map<pid_t, std::uint64_t> running;
  std::map<std::string, Count> counts;
  int violations = 0;
  const auto settle = [&] {
    int status = 0;
    const pid_t pid = ::wait(&status);
    const std::uint64_t seed = running.at(pid);
    running.erase(pid);
    const fs::path folder = base / std::to_string(seed);
    const std::string told = file_text(folder / "report");
    const std::string ended = told.substr(0, told.find('\n'));
    const bool whole = WIFEXITED(status) && WEXITSTATUS(status) == 0;
    const bool violated = ended == "violated" || !whole;
    const Setting setting = draw_setting(seed, options.only);
    std::vector<std::string> names;
    for (const Fault& fault : setting.faults) {
      const std::string name(fault_classes[std::size_t(fault.of)]);
      if (std::ranges::find(names, name) == names.end()) names.push_back(name);
    }
    if (names.empty()) names.push_back("none");
    names.push_back("all");
    for (const std::string& name : names) {
      Count& count = counts[name];
      ++count.runs;
      count.right += !violated && ended == "right" ? 1 : 0;
      count.said += !violated && ended == "said" ? 1 : 0;
      count.stalled += !violated && ended == "stalled" ? 1 : 0;
      count.violated += violated ? 1 : 0;
    }
    violations += violated ? 1 : 0;
    if (!whole) std::cout << "  seed " << seed << ": the harness itself ended with status " << status << '\n';
    if (violated || ended == "stalled" || options.verbose) std::cout << told << std::flush;
    if (!options.keep) fs::remove_all(folder);
  };
  for (std::uint64_t k = 0; k < options.runs; ++k) {
    while (running.size() >= options.jobs) settle();
    const std::uint64_t seed = options.seed + k;
    const pid_t pid = ::fork();
    if (pid == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      const Setting setting = draw_setting(seed, options.only);
      const fs::path folder = base / std::to_string(seed);
      std::ostringstream report;
      run_one(setting, folder, report);
      write_file(folder / "report", report.str());
      ::_exit(0);
    }
    running[pid] = seed;
  }
  while (!running.empty()) settle();
  if (options.keep) {
    std::cout << "kept in " << base.string() << '\n';
  } else {
    fs::remove_all(base);
  }
  std::printf("%-10s %6s %12s %16s %11s %11s\n", "class", "runs", "ended right", "failed and said", "not judged",
              "violations");
  for (const auto& [name, count] : counts)
    std::printf("%-10s %6d %12d %16d %11d %11d\n", name.c_str(), count.runs, count.right, count.said, count.stalled,
                count.violated);
  return violations == 0 ? 0 : 1;
}

}  // namespace
}  // namespace turncal

int main(int count, char** values) {
  turncal::Options options;
  const std::vector<std::string> words(values + 1, values + count);
  for (std::size_t i = 0; i < words.size(); ++i) {
    const bool more = i + 1 < words.size();
    const auto number = [&] { return more ? turncal::parse_integer<std::uint64_t>(words[i + 1]) : std::nullopt; };
    const auto place =
        std::find(turncal::fault_classes.begin(), turncal::fault_classes.end(), more ? words[i + 1] : "");
    const bool known = place != turncal::fault_classes.end();
    if (words[i] == "--keep") {
      options.keep = true;
    } else if (words[i] == "--verbose") {
      options.verbose = true;
    } else if (words[i] == "--runs" && number()) {
      options.runs = *number(), ++i;
    } else if (words[i] == "--seed" && number()) {
      options.seed = *number(), ++i;
    } else if (words[i] == "--jobs" && number().value_or(0) > 0) {
      options.jobs = *number(), ++i;
    } else if (words[i] == "--only" && known) {
      options.only = int(place - turncal::fault_classes.begin()), ++i;
    } else {
      std::cerr << "drawn_faults --runs N --seed S --jobs J [--only CLASS] [--keep] [--verbose]\nclasses:";
      for (const std::string_view name : turncal::fault_classes) std::cerr << ' ' << name;
      std::cerr << '\n';
      return 1;
    }
  }
  return turncal::run_all(options);
}
