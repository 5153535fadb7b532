// From legs, recordings of one unit at several temperatures or what was calibrated from them, to parameters as functions of temperature.
//
// A leg is a recording, a parameter file, or the folder of a run or a calibration, whose parameter file is taken as it is where it holds the
// covariance of its parameters. What is known of its temperature, the first that there is:
//   LEG=VALUE of the request; leg.conf in its folder, keys temperature_c, rate_c_per_h, direction = up | down | unknown, switch_on; the
//   thermometer of its recording (mean, slope of a straight line); reference_temperature_c of its parameter file
// Without a direction: from the temperature of the leg before, in the order of measured time, or else of the request. Without switch_on
// each leg has its own.
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

// One unit calibrated at several temperatures, unattended: a run in the chamber for each leg, then its parameters as functions of
// temperature (docs/thermal.md). The campaign is a file of `key = value`:
//
//   format = 1
//   unit = SN1
//   station = my.station                            # with a chamber; files are relative to this one
//   temperatures_c = -20, 0, 20, 40, 60, 30, -10    # of the legs, in order; both directions show hysteresis
//   sequence = fourteen_step.seq                    # of legs that name none [the fourteen steps]
//   leg.3.sequence = forty_minutes.seq                      # of the third leg
//   leg.3.switch_on = true                          # the unit is switched off and on before it [false]
//   rig = my.rig                                    # of a dry run [the station's]; each leg has noise of its own
//   noise.arw_deg_per_rt_h, noise.vrw_ug_per_rt_hz  # of the plan [0.002, 8]
//
// OUT holds leg-01, leg-02 and so on, each the folder of a run (run.h) with its leg.conf, and what `turncal thermal` makes of them. What is
// there is not done again: the same command goes on after a pause, a fault or a kill, in the leg that was interrupted. The unit is switched by
// hook.switch_on of the station; without one the campaign pauses for it. Every leg ends with the chamber off, as any run does.
// Not modelled: a dry run switches nothing on, so all its legs have one turn-on bias; dwells while the chamber is on its way.
struct CampaignLeg {
  double temperature_c = 0.0;
  std::string sequence;  // file; empty: the fourteen steps
  bool switch_on = false;
  int switch_on_number = 1;  // legs of one number had one switch-on
};

struct Campaign {
  std::string unit, rig;
  PlannedSite site;  // the station, and the noise of the plan
  std::vector<CampaignLeg> legs;
};
Result<Campaign> read_campaign(const std::string& path);

// All legs, and what they say together. `asked`: dry run, session, operator and the like, for every leg. An error of kind interrupted: the same
// command goes on.
Result<ThermalOutput> run_campaign(const Campaign& campaign, const RunRequest& asked, const std::string& out,
                                   CommandContext& context);

// What each leg takes, and the sigma that all of them would give every coefficient (expected_thermal_sigmas).
Result<Document> plan_campaign(const Campaign& campaign);

}  // namespace turncal
