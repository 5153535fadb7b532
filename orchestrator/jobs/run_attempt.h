// One attempt at a run with its devices: opened, watched (log, operator, status page), walked through, calibrated. run_job.h says when
// one is made.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/devices/live_devices.h"
#include "orchestrator/jobs/run_job.h"
#include "orchestrator/jobs/unit_run.h"
#include "orchestrator/watch/run_log.h"

namespace turncal {

inline constexpr const char* log_name = "run.log";
inline constexpr const char* removed_by_prune = " is removed by turncal prune";  // in the log

// Rigs in their own time, a rig turned by an operator, or the station's real devices.
struct RunDevices {
  std::unique_ptr<DryRunDevices> rig;
  std::unique_ptr<RehearsalDevices> rehearsal;
  std::unique_ptr<LiveDevices> live;
  OperatorPrompts* prompts = nullptr;  // of a table turned by hand
  StationDevices devices() { return rig ? rig->devices() : rehearsal ? rehearsal->devices() : live->devices(); }
  ImuSource& imu(std::size_t unit) { return rig ? rig->group.imu(unit) : rehearsal ? devices().imu : live->imu(unit); }
};
Result<RunDevices> make_devices(const PreparedRun& run, CommandContext& context);

struct Attempt {
  const PreparedRun& run;
  const Plan& plan;
  double sample_period_s;
  std::vector<UnitRun>& units;
  std::string folder;
  JournalFile& journal;
  RunLog& log;
  std::optional<ResumePoint> resume;
  int sessions = 1;
};

// Up to the verdicts. Sets counts and status of the units.
RunEnd attempt(const Attempt& a, RunDevices& run_devices, CommandContext& context);

}  // namespace turncal
