// Serves the rig outside the program: its table behind the station's register map or dialect (TCP or pseudo-terminal), a unit for each
// place of the station as frames on a pseudo-terminal. `turncal twin` runs it; docs/tables.md.
//
// Rig time stands still until a unit's line is opened, so that the data are those of a dry run that begins then; from there on it
// runs speed_up times as fast as the wall clock. One thread serves the table, run() the units; the server's mutex guards the rigs.
// The watchdog of a map's drives counts host seconds even if the rig is faster: it waits for the station's program, not for the rig.
// A unit that a fault of the rig unplugs hangs up its line; without any line left the twin ends.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "imu_io/units/frame_streamer.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/rig/rig_group.h"
#include "turntable_drivers/twins/line_server.h"

namespace turncal {

class ModbusTwin;

struct TwinSettings {
  double speed_up = 1.0;
  std::string table;  // "tcp:PORT" (0: any free one), "pty" or "pty:LINK"; empty: as the station reaches it
};

class RigTwin {
 public:
  // Opens table and unit lines. Errors: kind input for a station that no twin can replace, device for a line that cannot be opened.
  static Result<std::unique_ptr<RigTwin>> open(const StationConfig& station, RigConfig rig,
                                               const TwinSettings& settings);
  ~RigTwin();
  RigTwin(const RigTwin&) = delete;
  RigTwin& operator=(const RigTwin&) = delete;

  std::string table_address() const { return server_->address(); }
  std::string chamber_address() const { return chamber_server_ ? chamber_server_->address() : ""; }
  std::string imu_devices() const;  // separated by ", "
  // Serves until the count of stop requests is not 0. `say` is called from another thread when a watchdog trips, and when the
  // table has come to rest after that.
  Status run(const std::atomic<int>& stop_requests, const std::function<void(const std::string&)>& say);
  double rig_time_s();
  std::uint64_t batches_dropped() const;  // batches that were not read in time

 private:
  RigTwin(const RigConfig& rig, std::size_t units);
  void watch(const std::function<void(const std::string&)>& say);
  Status open_chamber(const ChamberDescription& described);
  Status open_table(const StationConfig& station, const TwinSettings& settings);

  struct UnitLine {
    std::unique_ptr<ImuSource> guarded;  // the unit, guarded by the mutex
    std::unique_ptr<UnitEnd> line;
    std::unique_ptr<FrameStreamer> streamer;
  };
  Status open_line(const StationConfig& station, std::size_t unit, double speed_up);
  Status pump(double now_s);  // all lines still open

  RigGroup group_;
  std::unique_ptr<LineServer> server_;
  std::unique_ptr<Chamber> chamber_;
  std::unique_ptr<LineServer> chamber_server_;  // null: the station has none
  ModbusTwin* drives_ = nullptr;                // the server, if it is a ModbusTwin
  std::vector<std::unique_ptr<UnitLine>> lines_;
  bool tripped_said_ = false, standing_said_ = false;
};

}  // namespace turncal
