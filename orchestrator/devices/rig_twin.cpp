#include "orchestrator/devices/rig_twin.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <mutex>
#include <thread>

#include "calib/model/parameters.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"
#include "orchestrator/devices/live_devices.h"
#include "turntable_drivers/twins/chamber_twin.h"
#include "turntable_drivers/twins/dialect_twin.h"
#include "turntable_drivers/twins/modbus_twin.h"
#include "turntable_drivers/twins/rig_chamber.h"

namespace turncal {

namespace {

constexpr double unit_patience_s = 5.0;  // host time, for a busy station
constexpr int unit_pause_ms = 1;

// Gives the rig's pulses, or rad and m/s by their nominal weight when the station's unit sends those.
class GuardedImu : public FrontImu {
 public:
  GuardedImu(ImuSource& source, std::mutex& mutex, const FrameDescription& frame, const RigConfig& rig)
      : FrontImu(source), mutex_(mutex) {
    if (!frame.gyro().pulses) gyro_ = {IncrementKind::physical, rig.gyro_pulse_arcsec * rad_per_arcsec};
    if (!frame.accel().pulses) accel_ = {IncrementKind::physical, rig.accel_pulse_mps};
  }
  Status open() override {
    const std::lock_guard lock(mutex_);
    return imu_.open();
  }
  void describe(RecordingInfo& info) const override {
    imu_.describe(info);
    info.gyro_increment = gyro_.kind;
    info.accel_increment = accel_.kind;
  }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    const std::lock_guard lock(mutex_);
    const Result<std::size_t> count = imu_.read(out, timeout_s);
    if (!count) return count;
    for (ImuSample& sample : out.first(*count)) {
      for (double& value : sample.gyro) value *= gyro_.weight;
      for (double& value : sample.accel) value *= accel_.weight;
    }
    return count;
  }

 private:
  struct Increment {
    IncrementKind kind = IncrementKind::pulses;
    double weight = 1.0;
  };
  std::mutex& mutex_;
  Increment gyro_, accel_;
};

std::string port_of(const std::string& address) { return address.substr(address.rfind(':') + 1); }

}  // namespace

RigTwin::RigTwin(const RigConfig& rig, std::size_t units) : group_(rig, units) {}
RigTwin::~RigTwin() = default;

Status RigTwin::open_table(const StationConfig& station, const TwinSettings& settings) {
  const std::string& given = settings.table;
  if (station.table.map) {
    // The watchdog waits for a program on this host, so it counts host seconds, however fast the rig runs.
    RegisterMap map = *station.table.map;
    map.watchdog_s *= std::max(1.0, settings.speed_up);
    server_.reset(drives_ = new ModbusTwin(std::move(map), group_.table(), group_));
    TRY(drives_->power_on());
  } else {
    auto twin = std::make_unique<DialectTwin>(*station.table.dialect, group_.table());
    TRY(twin->power_on());
    server_ = std::move(twin);
  }
  const TableLinkSettings& link = *station.table.link();
  std::string where = given;
  if (where.empty()) where = link.tcp ? "tcp:" + port_of(link.address) : "pty:" + link.address;
  if (where == "pty" || where.starts_with("pty:")) return server_->open_pty(where == "pty" ? "" : where.substr(4));
  const std::optional<int> port = where.starts_with("tcp:") ? parse_integer<int>(where.substr(4)) : std::nullopt;
  if (!port || *port < 0 || *port > 65535)
    return input_error("the twin's table at '" + where + "': expected tcp:PORT, pty or pty:LINK");
  return server_->listen_tcp(*port);
}

Status RigTwin::open_chamber(const ChamberDescription& described) {
  chamber_ = std::make_unique<RigChamber>(group_, described.limits);
  chamber_server_ = std::make_unique<ChamberTwin>(described, *chamber_, &server_->mutex);
  const TableLinkSettings& link = described.link();
  const auto port = link.tcp ? parse_integer<int>(port_of(link.address)) : std::optional(0);
  return link.tcp ? chamber_server_->listen_tcp(port.value_or(0)) : chamber_server_->open_pty(link.address);
}

Result<std::unique_ptr<RigTwin>> RigTwin::open(const StationConfig& station, RigConfig rig,
                                               const TwinSettings& settings) {
  if (!station.table.described())
    return input_error("station '" + station.name + "': a twin needs table.driver = modbus or serial");
  if (!station.imu) return input_error("station '" + station.name + "': a twin needs imu.driver = serial");
  // A table that knows its zero is a rig that does.
  rig.table.absolute_encoder |= station.table.map && station.table.map->home_by_encoder;
  std::unique_ptr<RigTwin> twin(new RigTwin(rig, station.imu_places()));
  TRY(twin->open_table(station, settings));
  if (station.chamber && station.chamber->described.language != ChamberDescription::Language::rig)
    TRY(twin->open_chamber(station.chamber->described));
  for (std::size_t unit = 0; unit < station.imu_places(); ++unit)
    TRY(twin->open_line(station, unit, settings.speed_up));
  return twin;
}

Status RigTwin::open_line(const StationConfig& station, std::size_t unit, double speed_up) {
  const std::string& device = station.imu_settings(unit).device;
  std::unique_ptr<UnitEnd> line = TRY(open_unit_end(device));
  auto unit_line = std::make_unique<UnitLine>();
  unit_line->line = std::move(line);
  unit_line->guarded =
      std::make_unique<GuardedImu>(group_.imu(unit), server_->mutex, station.imu->frame, group_.rig(unit).config());
  unit_line->streamer = std::make_unique<FrameStreamer>(*unit_line->guarded, station.imu->frame, *unit_line->line,
                                                        speed_up, unit_patience_s);
  lines_.push_back(std::move(unit_line));
  // Started once now, so that a frame that does not fit the rig is reported before anybody waits for it.
  return lines_.back()->streamer->start(monotonic_s());
}

double RigTwin::rig_time_s() {
  const std::lock_guard lock(server_->mutex);
  return group_.now_s();
}

std::string RigTwin::imu_devices() const {
  std::string text;
  for (const auto& line : lines_) text += (text.empty() ? "" : ", ") + line->line->device();
  return text;
}

std::uint64_t RigTwin::batches_dropped() const {
  std::uint64_t sum = 0;
  for (const auto& line : lines_) sum += line->streamer->batches_dropped();
  return sum;
}

Status RigTwin::pump(double now_s) {
  Status gone;
  bool any = false;
  for (const auto& line : lines_) {
    if (!line->line->is_open()) continue;
    if (const Result<std::size_t> passed = line->streamer->pump(now_s); !passed) {
      gone = passed.error();
      line->line->unplug();
    } else {
      any = true;
    }
  }
  return any ? Status{} : gone;
}

void RigTwin::watch(const std::function<void(const std::string&)>& say) {
  if (!drives_) return;
  const std::lock_guard lock(server_->mutex);
  std::string angles;
  bool tripped = false, moving = false;
  for (const Axis axis : all_axes) {
    tripped = tripped || drives_->watchdog_tripped(axis);
    const Rig::AxisState state = group_.rig(0).axis(axis);
    moving = moving || state.moving || state.rate_degps != 0.0;
    angles += fmt::format(", {} {:.4f} deg", to_string(axis), state.position_deg);
  }
  const std::string when = fmt::format("{:.3f} s of rig time{}", group_.now_s(), angles);
  if (tripped && !tripped_said_) say("watchdog tripped at " + when);
  if (tripped && !moving && !standing_said_) say("at rest after that at " + when);
  tripped_said_ = tripped;
  standing_said_ = tripped && !moving;
}

Status RigTwin::run(const std::atomic<int>& stop_requests, const std::function<void(const std::string&)>& say) {
  std::atomic<bool> done = false;
  std::thread table([&] {
    while (!done) {
      server_->run_once(chamber_server_ ? 0.01 : 0.02);
      if (chamber_server_) chamber_server_->run_once(0.01);
      watch(say);
    }
  });
  Status status;
  bool started = false;
  while (status && stop_requests.load() == 0) {
    const double now_s = monotonic_s();
    if (started) {
      status = pump(now_s);
    } else if (std::ranges::any_of(lines_, [](const auto& line) { return line->line->has_peer(); })) {
      started = true;
      for (const auto& line : lines_)
        if (status) status = line->streamer->start(now_s);
    }
    ::poll(nullptr, 0, unit_pause_ms);
  }
  done = true;
  table.join();
  return status;
}

}  // namespace turncal
