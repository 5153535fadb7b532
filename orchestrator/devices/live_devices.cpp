#include "orchestrator/devices/live_devices.h"

#include <fmt/format.h>
#include <ifaddrs.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <utility>

#include "calib/model/parameters.h"
#include "orchestrator/devices/stop_signals.h"
#include "turntable_drivers/ascii/sentence_codec.h"
#include "turntable_drivers/modbus/register_codec.h"
#include "turntable_drivers/table/described_turntable.h"
#include "turntable_drivers/table/table_stop.h"

namespace turncal {

Status TableDevice::leave() {
  if (left_) return {};
  left_ = true;
  const auto wait = [](double seconds) { ::poll(nullptr, 0, int(1e3 * seconds)); };
  return leave_off(limited_, {.now_s = monotonic_s, .wait = wait, .standing_rate_degps = standing_rate_degps_});
}

TableDevice::~TableDevice() {
  // A failure was reported when the run's own stop failed.
  static_cast<void>(leave().ok());
}

Status TableDevice::commission(const AxisTriple& known_deg, double tolerance_deg) {
  if (auto* described = dynamic_cast<DescribedTurntable*>(driver_.get()))
    return described->commission(known_deg, tolerance_deg);
  return input_error("this table has nothing to commission");
}

Result<std::unique_ptr<TableDevice>> make_table(const StationConfig& station, const TableContext& context) {
  std::unique_ptr<Turntable> driver;
  switch (station.table.driver) {
    case TableDriver::mock:
      return input_error("station '" + station.name +
                         "': table.driver = mock has no table to turn: expected modbus, serial or manual");
    case TableDriver::modbus:
      assert(station.table.map);
      driver = std::make_unique<DescribedTurntable>(*station.table.map, context.clock, context.stop_requests);
      break;
    case TableDriver::serial:
      assert(station.table.dialect);
      driver = std::make_unique<DescribedTurntable>(*station.table.dialect, context.clock, context.stop_requests);
      break;
    case TableDriver::manual:
      assert(context.operator_output);
      driver = std::make_unique<ManualTurntable>(station.table.manual, context.clock, context.operator_input,
                                                 *context.operator_output, context.gravity);
      break;
  }
  return std::make_unique<TableDevice>(std::move(driver), station.axis, station.motion.settle_rate_degps);
}

namespace {

constexpr double half_s = 0.5;
constexpr std::int64_t longest_gap = 2000;  // samples; after a longer gap the sum is unknown
constexpr double still = 0.02;              // relative to the mean of the halves

const std::string& lock_folder() {
  static const std::string folder = ::access("/run/lock", W_OK) == 0 ? "/run/lock" : "/tmp";
  return folder;
}

// Returns an address as IPv6, with IPv4 mapped into it; nothing for any other family.
std::optional<in6_addr> as_ipv6(const sockaddr* address) {
  if (address == nullptr) return {};
  if (address->sa_family == AF_INET6) return reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr;
  if (address->sa_family != AF_INET) return {};
  in6_addr mapped{};
  mapped.s6_addr[10] = mapped.s6_addr[11] = 0xFF;
  std::memcpy(&mapped.s6_addr[12], &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, 4);
  return mapped;
}

// Returns whether an address reaches this machine: 0.0.0.0, 127.x, ::, ::1, those of its interfaces, and mapped IPv4.
bool is_this_machine(const sockaddr& address) {
  const std::optional<in6_addr> host = as_ipv6(&address);
  if (!host) return false;
  const bool mapped = IN6_IS_ADDR_V4MAPPED(&*host) && (host->s6_addr[12] == 127 || host->s6_addr[12] == 0);
  if (mapped || IN6_IS_ADDR_UNSPECIFIED(&*host) || IN6_IS_ADDR_LOOPBACK(&*host)) return true;
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) return false;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> freed(first, ::freeifaddrs);
  for (const ifaddrs* one = first; one != nullptr; one = one->ifa_next) {
    const std::optional<in6_addr> own = as_ipv6(one->ifa_addr);
    if (own && IN6_ARE_ADDR_EQUAL(&*own, &*host)) return true;
  }
  return false;
}

// Returns HOST:PORT with the system's first address of HOST; a name that cannot be resolved is kept.
std::string numeric(const std::string& device) {
  const std::size_t colon = device.rfind(':');
  if (colon == std::string::npos) return device;
  std::string name = device.substr(0, colon);
  if (name.starts_with("[") && name.ends_with("]")) name = name.substr(1, name.size() - 2);
  addrinfo wanted{}, *found = nullptr;
  wanted.ai_family =
      name.find(':') == std::string::npos ? AF_INET : AF_INET6;  // always the same family, of localhost, too
  wanted.ai_socktype = SOCK_STREAM;
  if (::getaddrinfo(name.c_str(), device.substr(colon + 1).c_str(), &wanted, &found) != 0) return device;
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> freed(found, ::freeaddrinfo);
  std::array<char, NI_MAXHOST> host{};
  std::array<char, NI_MAXSERV> port{};
  const int failed = ::getnameinfo(found->ai_addr, found->ai_addrlen, host.data(), host.size(), port.data(),
                                   port.size(), NI_NUMERICHOST | NI_NUMERICSERV);
  if (failed != 0) return device;
  return (is_this_machine(*found->ai_addr) ? std::string("127.0.0.1") : std::string(host.data())) + ":" + port.data();
}

// The last link is not followed, because it may lead to another device after the adapter has come back.
std::string one_name_of(const std::string& device) {
  if (!device.starts_with("/")) return numeric(device);
  const std::filesystem::path name = device;
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::canonical(name.parent_path(), error);
  return error ? device : (folder / name.filename()).string();
}

int go_first() {
  sched_param lowest{};
  lowest.sched_priority = ::sched_get_priority_min(SCHED_FIFO);
  return ::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &lowest) == 0 ? 0 : errno;
}

// With a memory limit later allocations could fail, so nothing is locked.
int lock_memory() {
  rlimit limit{};
  ::getrlimit(RLIMIT_MEMLOCK, &limit);
  if (limit.rlim_cur != RLIM_INFINITY && ::geteuid() != 0) return EPERM;
  return ::mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0 ? 0 : errno;
}

}  // namespace

GravityWatch::GravityWatch(ImuSource& source, double sample_period_s)
    : FrontImu(source), half_samples_(std::max(1, int(std::lround(half_s / sample_period_s)))) {}

Status GravityWatch::open() {
  count_ = 0;
  sum_.setZero();
  last_.reset();
  before_.reset();
  counter_.reset();
  RecordingInfo info;
  describe(info);
  deg_per_count_ = nominal_gyro_rad(info) / rad_per_deg;
  return imu_.open();
}

Result<std::size_t> GravityWatch::read(std::span<ImuSample> out, double timeout_s) {
  Result<std::size_t> got = imu_.read(out, timeout_s);
  if (!got) return got;
  for (const ImuSample& sample : out.first(*got)) {
    const std::int64_t steps =
        counter_ ? std::clamp<std::int64_t>(sample.counter - *counter_, 1, longest_gap) : std::int64_t{1};
    counter_ = sample.counter;
    sum_ += Eigen::Vector3d::Map(sample.accel.data());
    for (std::size_t i = 0; i < 3; ++i) turned_[i] += deg_per_count_ * sample.gyro[i] * double(steps);
    if (++count_ < half_samples_) continue;
    before_ = std::exchange(last_, sum_ / half_samples_);
    sum_.setZero();
    count_ = 0;
  }
  return got;
}

std::optional<std::array<double, 3>> GravityWatch::mean() const {
  if (!last_ || !before_) return {};
  if (!((*last_ - *before_).norm() <= still * 0.5 * (*last_ + *before_).norm())) return {};
  const Eigen::Vector3d mean = 0.5 * (*last_ + *before_);
  return std::array{mean.x(), mean.y(), mean.z()};
}

std::string lock_path_of(const std::string& device) {
  std::string name = one_name_of(device);
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '.' && c != '-') c = '_';
  return lock_folder() + "/turncal-" + name + ".lock";
}

std::vector<std::pair<std::string, std::string>> device_lines(const StationConfig& station) {
  std::vector<std::pair<std::string, std::string>> lines;
  if (const TableLinkSettings* const link = station.table.link()) lines.emplace_back("table.address", link->address);
  if (station.chamber) lines.emplace_back("chamber.address", station.chamber->described.link().address);
  for (std::size_t place = 0; place < station.imu_places(); ++place)
    lines.emplace_back(place == 0 ? "imu.device" : fmt::format("imu.{}.device", place + 1),
                       station.imu_settings(place).device);
  return lines;
}

Result<std::vector<LockFile>> lock_devices(const StationConfig& station) {
  std::vector<LockFile> locks;
  for (const auto& [key, device] : device_lines(station)) {
    Result<LockFile> taken = LockFile::acquire(lock_path_of(device));
    if (!taken) return device_error(device + ": " + taken.error().message);
    locks.push_back(std::move(*taken));
  }
  return locks;
}

RealTime::RealTime() : scheduled_(go_first()), locked_(lock_memory()) {}

RealTime::~RealTime() {
  const sched_param none{};
  if (first()) ::sched_setscheduler(0, SCHED_OTHER, &none);
  if (locked()) ::munlockall();
}

std::string RealTime::text() const {
  const std::string goes =
      first() ? "a run goes before other programs (SCHED_FIFO)"
              : fmt::format("a run does not go before other programs (SCHED_FIFO: {}; limits.conf: rtprio 1)",
                            std::strerror(scheduled_));
  return goes + (locked() ? ", its memory is locked"
                          : fmt::format(", its memory is not locked (mlockall: {}; limits.conf: memlock unlimited)",
                                        std::strerror(locked_)));
}

LiveDevices::LiveDevices(const StationConfig& station, std::size_t units, std::vector<LockFile> locks)
    : locks_(std::move(locks)),
      speed_up_(station.clock_speed_up),
      clock_(speed_up_),
      imu_(station.imu->frame, station.imu->settings),
      watched_(imu_, station.imu->frame.sample_period_s) {
  for (std::size_t place = 1; place < units; ++place)
    further_.push_back(std::make_unique<SerialImu>(station.imu->frame, station.imu_settings(place)));
}

Result<std::unique_ptr<LiveDevices>> LiveDevices::make(const StationConfig& station,
                                                       const std::atomic<int>& stop_requests, std::ostream& out,
                                                       std::size_t units) {
  assert(station.imu);
  std::unique_ptr<LiveDevices> live(new LiveDevices(station, units, TRY(lock_devices(station))));
  if (station.chamber) live->chamber_ = std::make_unique<DescribedChamber>(station.chamber->described);
  const GravityWatch& watched = live->watched_;
  live->table_ = TRY(
      make_table(station, {live->clock_, &stop_requests, STDIN_FILENO, &out, [&watched] { return watched.mean(); }}));
  if (ManualTurntable* manual = live->table_->manual()) manual->feel_turns([&watched] { return watched.turned_deg(); });
  return live;
}

StationDevices LiveDevices::devices() {
  return {table_->table(), watched_, clock_, [this](double seconds) { wait_a_little(seconds / speed_up_); }};
}

void LiveDevices::wait_a_little(double wall_s) {
  constexpr double longest_s = 0.02;
  timespec pause{};
  pause.tv_nsec = long(1e9 * std::clamp(wall_s, 0.0, longest_s));
  ::nanosleep(&pause, nullptr);
}

Status LiveDevices::leave_table(Status done, const std::string& how_left) {
  // A driver that gives up a wait because of a stop has its own message.
  if (!done && (done.error().kind == ErrorKind::aborted || done.error().kind == ErrorKind::interrupted))
    done = asked_to_stop(StopSignals::ends() > 0);
  const Status left = table_->leave();
  left_off_ = left.ok();
  if (!left) return device_error(done ? left.error().message : left.error().message + "; " + done.error().message);
  return done ? done : Status(Error{done.error().kind, done.error().message + how_left});
}

std::string LiveDevices::sag_since(const std::optional<TableStatus>& left) {
  constexpr double least_s = 2.5, same_place_deg = 0.01;  // 0.005 deg/s
  std::string text;
  if (table_->manual() || !table_->table().can_switch_off()) return text;
  TableStatus before;
  for (const Axis axis : all_axes) {
    const Result<AxisStatus> then = left ? (*left)[index(axis)] : table_->table().status(axis);
    if (!then) return text;
    before[index(axis)] = *then;
  }
  for (const Axis axis : all_axes) {
    const AxisStatus& then = before[index(axis)];
    while (clock_.now_s() - then.time_s < least_s)
      wait_a_little((least_s - (clock_.now_s() - then.time_s)) / speed_up_);
    std::optional<AxisStatus> nearest;
    for (int i = 0; i < 5; ++i) {  // a flickering encoder reads the same place at least once
      const Result<AxisStatus> now = table_->table().status(axis);
      if (!now) return text;
      const auto off_deg = [&](const AxisStatus& at) { return std::abs(at.position_deg - then.position_deg); };
      if (!nearest || off_deg(*now) < off_deg(*nearest)) nearest = *now;
      if (off_deg(*nearest) <= same_place_deg) break;
    }
    if (!(std::abs(nearest->position_deg - then.position_deg) > same_place_deg)) continue;
    text +=
        fmt::format("{}{} turns with its drive off: from {:.4f} to {:.4f} deg in {:.1f} s", text.empty() ? "" : "; ",
                    to_string(axis), then.position_deg, nearest->position_deg, nearest->time_s - then.time_s);
  }
  return text;
}

OperatorPrompts* LiveDevices::prompts() {
  ManualTurntable* manual = table_->manual();
  if (!manual) return nullptr;
  constexpr double first_turn_s = 60.0;  // until the operator's own turns are known
  prompts_ = std::make_unique<OperatorPrompts>(*manual, first_turn_s);
  return prompts_.get();
}

}  // namespace turncal
