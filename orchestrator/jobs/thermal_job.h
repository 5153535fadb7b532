// Fits parameters as functions of temperature to legs: recordings of one unit at several temperatures, or their calibrations.
//
// docs/thermal.md says what a leg may be, and how its temperature, rate, direction and switch-on are found.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/jobs/prediction_job.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/report/thermal_report.h"

namespace turncal {

struct ThermalRequest {
  std::vector<std::string> legs;
  std::vector<std::string> temperatures;  // LEG=VALUE
  std::optional<double> reference_c;
  std::string time_utc;
  std::function<void(const std::string&)> phase = [](const std::string&) {};
};

struct ThermalOutput {
  ThermalReport report;
  ParameterFile file;
};

Result<ThermalOutput> thermal_calibration(const ThermalRequest& request);

// Calibrates one unit at several temperatures, unattended: a run in the chamber for each leg, then its parameters as functions of
// temperature. docs/thermal.md has the keys of the campaign file, and what OUT holds.
//
// Finished legs are not repeated: after a pause, a fault or a kill the same command goes on in the interrupted leg. The station's
// hook.switch_on switches the unit; without one the campaign pauses for it. Every leg ends with the chamber off, as any run does.
// Not modelled: a dry run does not switch the unit, so all its legs have the same turn-on bias.
struct CampaignLeg {
  double temperature_c = 0.0;
  std::string sequence;  // file; empty: the fourteen steps
  std::string station;   // file; empty: the campaign's
  bool switch_on = false;
  int switch_on_number = 1;  // legs with one number share a switch-on
};

struct Campaign {
  std::string file, unit = {}, rig = {};
  PlannedSite site = {};  // station, and noise assumed by the plan
  std::vector<CampaignLeg> legs = {};
};
Result<Campaign> read_campaign(const std::string& path);

// `asked`: dry run, session, operator and the like, for every leg. After an error of kind interrupted the same command goes on.
Result<ThermalOutput> run_campaign(const Campaign& campaign, const RunRequest& asked, const std::string& out,
                                   CommandContext& context);

// Returns the time of each leg, and the sigma that all of them together would give every coefficient (expected_thermal_sigmas).
Result<Document> plan_campaign(const Campaign& campaign);

}  // namespace turncal
