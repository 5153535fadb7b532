// The devices of a dry run: rigs in lockstep behind one table, an IMU for each unit, and the clock, so that station time is virtual.
//
// In a rehearsal (`run --manual --dry-run`), a run by hand on the rig, the rig turns to the angle that the operator types, its
// unit feels it, and gravity is compared as in a live run. Time is the rig's, and stands still while somebody thinks. A resumed rehearsal
// starts a rig of its own: at the time of the last completed dwell (so that noise and temperature continue), at 0 on all axes. It asks for
// the turns, rests, and goes on as a live run does.
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

  // Hands the table over to an operator, who answers through the file descriptor `input`. The stream must outlive the devices.
  void rehearse(const StationConfig& station, int input, std::ostream& out);
  OperatorPrompts* prompts() { return by_hand_ ? &by_hand_->prompts : nullptr; }

  // The devices are valid as long as this object.
  StationDevices devices();

  // Prepares a resumed run: brings fresh rigs to the moment `until_s` of a run that gave these commands at these times. All
  // that a rig is (angles, noise, temperature, faults) follows from its configuration, the commands and the samples passed,
  // so the next sample is the one that the interrupted run would have seen. In a rehearsal only time passes. An error when the table
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
  std::unique_ptr<ByHand> by_hand_;  // in a rehearsal
};

// The devices of a session: rigs in their own time, or the station's real devices.
struct RunDevices {
  std::unique_ptr<DryRunDevices> rig;
  std::unique_ptr<LiveDevices> live;
  OperatorPrompts* prompts = nullptr;       // for a table turned by hand
  std::unique_ptr<RigChamber> rig_chamber;  // in a dry run
  std::unique_ptr<ChamberKeeper> chamber;   // in a run with a temperature
  StationDevices devices() {
    StationDevices all = rig ? rig->devices() : live->devices();
    all.chamber = chamber.get();
    return all;
  }
  ImuSource& imu(std::size_t unit) {
    return live ? live->imu(unit) : unit == 0 ? rig->devices().imu : rig->group.imu(unit);
  }
};

// The rig that replaces a station's table and units: in a dry run, in the twin, and when a plan is predicted for a station
// without a unit of its own.

// Reads `file` or, if that is empty, the station's rig.file or, without one, the built-in rig. It is at the station's site unless the
// file names another, and samples as the station's unit does: a file with another period is refused, and so are pulses that are not whole.
Result<RigConfig> rig_of(const StationConfig& station, const std::string& file = "");

// Returns the true values of a simulated unit, as the file truth.conf: the 24 keys of Table 1 in units of the parameter file, the
// effects switched on, and their reference temperature. It serves to check an estimate.
// reference_c: the reference temperature of the estimate (mean of the recording); nothing when none is measured.
std::string format_truth(const Rig& rig, std::optional<double> reference_c);

// Reads the 24 keys of a truth file; further keys of the forms effect.*, outside.*, table.* and lot.* are skipped.
Result<ParameterVector> read_truth(const std::string& path);

}  // namespace turncal
