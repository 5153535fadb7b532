// The devices of a dry run: rigs in lockstep behind one table, an IMU for each unit, and the clock, so that station time is virtual.
//
// In a rehearsal, a run by hand on the rig (`run --manual --dry-run`), the angle that the operator types is where the rig is turned to, its
// unit feels it, and gravity is compared as in a live run. Time is the rig's, and stands still while somebody thinks. A rehearsal that is
// taken up again is a rig of its own: at the time of the last completed dwell (so that noise and temperature go on), at 0 on all axes. It is
// asked for, rests, and goes on as a live run does.
#pragma once

#include <memory>
#include <optional>
#include <ostream>
#include <span>
#include <string>

#include "calib/model/parameters.h"
#include "calib/types/status.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/rig/rig_config.h"
#include "turntable_drivers/rig/rig_group.h"
#include "turntable_drivers/table/limited_turntable.h"
#include "turntable_drivers/twins/rig_chamber.h"

namespace turncal {

class DryRunDevices {
 public:
  explicit DryRunDevices(const RigConfig& config, std::size_t units = 1)
      : group(config, units), rig(group.rig(0)), table(group.table()), imu(group.imu(0)), clock(group) {}
  DryRunDevices(const DryRunDevices&) = delete;
  DryRunDevices& operator=(const DryRunDevices&) = delete;

  // From here on an operator turns the table, who answers through the file descriptor `input`. The stream must outlive the devices.
  void rehearse(const StationConfig& station, int input, std::ostream& out);
  OperatorPrompts* prompts() { return by_hand_ ? &by_hand_->prompts : nullptr; }

  // Valid as long as this object.
  StationDevices devices();

  // For a run that goes on: brings fresh rigs to the moment `until_s` of a run that gave these commands at these times. All
  // that a rig is (angles, noise, temperature, faults) follows from its configuration, the commands and the samples passed,
  // so the next sample is the one that the interrupted run would have seen. Of a rehearsal time alone passes. An error when the table
  // refuses a command.
  Status put_back(std::span<const TableCommand> commands, double until_s);

  RigGroup group;
  Rig& rig;  // of the first unit
  Turntable& table;
  ImuSource& imu;
  Clock& clock;

 private:
  struct ByHand {
    ByHand(DryRunDevices& rig, const StationConfig& station, int input, std::ostream& out);
    GravityWatch watched;
    ManualTurntable manual;
    LimitedTurntable limited;
    OperatorPrompts prompts;
  };
  std::unique_ptr<ByHand> by_hand_;  // of a rehearsal
};

// The devices of a session: rigs in their own time, or the station's real devices.
struct RunDevices {
  std::unique_ptr<DryRunDevices> rig;
  std::unique_ptr<LiveDevices> live;
  OperatorPrompts* prompts = nullptr;       // of a table turned by hand
  std::unique_ptr<RigChamber> rig_chamber;  // of a dry run
  std::unique_ptr<ChamberKeeper> chamber;   // of a run that has a temperature
  StationDevices devices() {
    StationDevices all = rig ? rig->devices() : live->devices();
    all.chamber = chamber.get();
    return all;
  }
  ImuSource& imu(std::size_t unit) {
    return live ? live->imu(unit) : unit == 0 ? rig->devices().imu : rig->group.imu(unit);
  }
};

// The rig that stands in for a station's table and units: in a dry run, in the twin, and where a plan is looked at for a station
// without a unit of its own.

// `file`, where it is not empty, else rig.file of the station, else the built-in one. It stands where the station does unless the
// file says another site, and samples as the station's unit does: a file that says otherwise is refused, and so are pulses that are not whole.
Result<RigConfig> rig_of(const StationConfig& station, const std::string& file = "");

// What is true of a simulated unit, as the file truth.conf: the 24 keys of Table 1 in units of the parameter file, the
// effects that were switched on, and the temperature to which they are referred. For comparing an estimate with it.
// reference_c: the temperature to which the estimate is referred (mean of the recording); nothing when none is measured.
std::string format_truth(const Rig& rig, std::optional<double> reference_c);

// The 24 keys of a truth file; further keys of the forms effect.*, outside.*, table.* and lot.* are allowed and skipped.
Result<ParameterVector> read_truth(const std::string& path);

}  // namespace turncal
