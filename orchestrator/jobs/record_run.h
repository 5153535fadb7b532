// A session of a run with its devices: opened, watched (log, operator, status page), walked through, its results made.
#pragma once

#include <memory>

#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/jobs/run_job.h"

namespace turncal {

// Rigs in their own time, a rig turned by an operator, or the station's real devices.
struct RunDevices {
  std::unique_ptr<DryRunDevices> rig;
  std::unique_ptr<RehearsalDevices> rehearsal;
  std::unique_ptr<LiveDevices> live;
  OperatorPrompts* prompts = nullptr;  // of a table turned by hand
  StationDevices devices() { return rig ? rig->devices() : rehearsal ? rehearsal->devices() : live->devices(); }
  ImuSource& imu(std::size_t unit) { return rig ? rig->group.imu(unit) : rehearsal ? devices().imu : live->imu(unit); }
};
Result<RunDevices> make_devices(const RunPlan& run, CommandContext& context);

// Up to the verdicts. REQUIRES: journal and log of the run. Sets what is known of its units, and how they ended.
RunEnd record_run(Run& run, RunDevices& devices, CommandContext& context);

}  // namespace turncal
