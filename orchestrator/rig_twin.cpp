#include "orchestrator/rig_twin.h"

#include <poll.h>

#include <cstdio>
#include <mutex>
#include <thread>

#include "imu_io/deadline.h"
#include "imu_io/format_number.h"
#include "turntable_drivers/dialect_twin.h"
#include "turntable_drivers/drive_twin.h"
#include "turntable_drivers/table_server.h"

namespace turncal {

namespace {

constexpr double unit_patience_s = 5.0;  // of the host, for a station that is busy
constexpr int unit_pause_ms = 1;

class GuardedImu : public ImuSource {
 public:
  GuardedImu(ImuSource& source, std::mutex& mutex) : source_(source), mutex_(mutex) {}
  Status open() override {
    const std::lock_guard lock(mutex_);
    return source_.open();
  }
  Result<ImuIdentity> identify() override { return source_.identify(); }
  void describe(RecordingInfo& info) const override { source_.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    const std::lock_guard lock(mutex_);
    return source_.read(out, timeout_s);
  }
  ImuLinkCounters counters() const override { return source_.counters(); }
  void close() override { source_.close(); }

 private:
  ImuSource& source_;
  std::mutex& mutex_;
};

std::string port_of(const std::string& address) { return address.substr(address.rfind(':') + 1); }

}  // namespace

RigTwin::RigTwin(const RigConfig& rig, double speed_up)
    : rig_(rig), table_(rig_), clock_(rig_), unit_(rig_), speed_up_(speed_up) {}
RigTwin::~RigTwin() = default;

Status RigTwin::open_table(const StationConfig& station, const std::string& given) {
  bool tcp = false;
  std::string address;
  if (station.table.map) {
    drives_ = std::make_unique<DriveTwin>(*station.table.map, table_, clock_);
    if (Status status = drives_->power_on(); !status) return status;
    server_ = std::make_unique<TableServer>(*drives_);
    tcp = station.table.map->link.tcp;
    address = station.table.map->link.address;
  } else {
    dialect_ = std::make_unique<DialectTwin>(*station.table.dialect, table_);
    if (Status status = dialect_->power_on(); !status) return status;
    server_ = std::make_unique<DialectServer>(*dialect_);
    tcp = station.table.dialect->link.tcp;
    address = station.table.dialect->link.address;
  }
  std::string where = given;
  if (where.empty()) where = tcp ? "tcp:" + port_of(address) : "pty:" + address;
  if (where == "pty" || where.starts_with("pty:")) return server_->open_pty(where == "pty" ? "" : where.substr(4));
  const std::optional<int> port = where.starts_with("tcp:") ? parse_integer<int>(where.substr(4)) : std::nullopt;
  if (!port || *port < 0 || *port > 65535) {
    return input_error("the twin's table at '" + where + "': expected tcp:PORT, pty or pty:LINK");
  }
  return server_->listen_tcp(*port);
}

Result<std::unique_ptr<RigTwin>> RigTwin::open(const StationConfig& station, const RigConfig& rig,
                                               const TwinSettings& settings) {
  if (!station.table.map && !station.table.dialect) {
    return input_error("station '" + station.name + "': a twin needs table.driver = modbus or serial");
  }
  if (!station.imu) return input_error("station '" + station.name + "': a twin needs imu.driver = serial");
  std::unique_ptr<RigTwin> twin(new RigTwin(rig, settings.speed_up));
  if (Status status = twin->open_table(station, settings.table); !status) return status.error();
  Result<Pty> line = Pty::create(station.imu->settings.device);
  if (!line) return line.error();
  twin->line_ = std::move(*line);
  twin->guarded_ = std::make_unique<GuardedImu>(twin->unit_, twin->server_->mutex);
  twin->streamer_ = std::make_unique<FrameStreamer>(*twin->guarded_, station.imu->frame, twin->line_, settings.speed_up,
                                                    unit_patience_s);
  // Once now, so that a frame that does not fit the rig is said before anybody waits for it.
  if (Status status = twin->streamer_->start(monotonic_s()); !status) return status.error();
  return twin;
}

double RigTwin::rig_time_s() {
  const std::lock_guard lock(server_->mutex);
  return rig_.time_s();
}

void RigTwin::watch(const std::function<void(const std::string&)>& say) {
  if (!drives_) return;
  const std::lock_guard lock(server_->mutex);
  std::string angles;
  bool tripped = false, moving = false;
  for (const Axis axis : all_axes) {
    tripped = tripped || drives_->watchdog_tripped(axis);
    const Rig::AxisState state = rig_.axis(axis);
    moving = moving || state.moving || state.rate_degps != 0.0;
    char text[60];
    std::snprintf(text, sizeof text, ", %s %.4f deg", to_string(axis), state.position_deg);
    angles += text;
  }
  const std::string when = format_number(rig_.time_s()) + " s of rig time" + angles;
  if (tripped && !tripped_told_) say("watchdog tripped at " + when);
  if (tripped && !moving && !rest_told_) say("at rest after that at " + when);
  tripped_told_ = tripped;
  rest_told_ = tripped && !moving;
}

Status RigTwin::run(const std::atomic<int>& stop_requests, const std::function<void(const std::string&)>& say) {
  std::atomic<bool> done = false;
  std::thread table([&] {
    while (!done) {
      server_->run_once(0.02);
      watch(say);
    }
  });
  Status status;
  bool started = false;
  while (status && stop_requests.load() == 0) {
    if (!started && line_.has_peer()) {
      started = true;
      status = streamer_->start(monotonic_s());
    } else if (started) {
      if (const Result<std::size_t> passed = streamer_->pump(monotonic_s()); !passed) status = passed.error();
    }
    ::poll(nullptr, 0, unit_pause_ms);
  }
  done = true;
  table.join();
  return status;
}

}  // namespace turncal
