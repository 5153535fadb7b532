// The rig, served outside the program: its table behind the station's register map or dialect (TCP or pseudo-terminal), its unit as
// frames on a pseudo-terminal. What `turncal twin` runs; docs/twin.md.
//
// Rig time stands still until somebody opens the unit's line, so that the data are those of a dry run that begins then; from there on it
// runs speed_up times as fast as the wall clock. One thread serves the table, run() the unit; the server's mutex guards the rig.
// Not modelled: a unit that is unplugged by a fault of the rig ends the twin.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>

#include "imu_io/frame_streamer.h"
#include "orchestrator/station_config.h"
#include "turntable_drivers/line_server.h"
#include "turntable_drivers/rig.h"
#include "turntable_drivers/rig_clock.h"
#include "turntable_drivers/rig_imu.h"
#include "turntable_drivers/rig_table.h"

namespace turncal {

class DriveTwin;
class DialectTwin;

struct TwinSettings {
  double speed_up = 1.0;
  std::string table;  // "tcp:PORT" (0: any free one), "pty" or "pty:LINK"; empty: as the station reaches it
};

class RigTwin {
 public:
  // Opens both lines. Errors: kind input for a station that no twin can stand in for, device for a line that cannot be opened.
  static Result<std::unique_ptr<RigTwin>> open(const StationConfig& station, const RigConfig& rig, const TwinSettings& settings);
  ~RigTwin();
  RigTwin(const RigTwin&) = delete;
  RigTwin& operator=(const RigTwin&) = delete;

  std::string table_address() const { return server_->address(); }
  const std::string& imu_device() const { return line_.device(); }
  // Serves until the count of requests to stop is not 0. `say` hears, from another thread, of a watchdog that tripped and of the
  // table's coming to rest after that.
  Status run(const std::atomic<int>& stop_requests, const std::function<void(const std::string&)>& say);
  double rig_time_s();
  std::uint64_t batches_dropped() const { return streamer_->batches_dropped(); }  // not read in time

 private:
  RigTwin(const RigConfig& rig, double speed_up);
  void watch(const std::function<void(const std::string&)>& say);
  Status open_table(const StationConfig& station, const std::string& where);

  Rig rig_;
  RigTable table_;
  RigClock clock_;
  RigImu unit_;
  double speed_up_;
  std::unique_ptr<DriveTwin> drives_;
  std::unique_ptr<DialectTwin> dialect_;
  std::unique_ptr<LineServer> server_;
  std::unique_ptr<ImuSource> guarded_;  // the unit, with the mutex held
  Pty line_;
  std::unique_ptr<FrameStreamer> streamer_;
  bool tripped_told_ = false, rest_told_ = false;
};

}  // namespace turncal
