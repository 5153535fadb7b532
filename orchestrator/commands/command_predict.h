// `turncal predict --sequence FILE [--sequence FILE ...]`: what each sequence would determine and how well, before anything is
// run (calib/prediction/predict.h). Several sequences stand side by side, each with its sigma over that of the first.
//
//   --station FILE             site, settling time and unit; default: the built-in rig station
//   --latitude, --gravity      another site, deg and m/s^2
//   --arw, --vrw               angle random walk, deg/sqrt(h); velocity random walk, ug/sqrt(Hz)
//   --gyro-bias-instability, --accel-bias-instability
//                              sigma of the bias's slow part (Gauss-Markov, 600 s), deg/h and ug; 0: none
//   --effects                  also what every effect of the catalogue would have to be to be caught, and which are confused
//   --temperature-rise, --temperature-tau   C and s; with --effects. Without it effects of temperature are not looked at
//   --format json              the same for other programs
//   --navigate TIME, --align   what the calibration would be worth: drift of free navigation after 1h, 90min or 5400 (s)
//
// Nothing is written or moved. Exit code 0 also when parameters are not determined: they are named. A sequence that the
// station cannot run is predicted all the same, with a note.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/commands/command_line.h"
#include "orchestrator/jobs/planned_unit.h"

namespace turncal {

struct PredictRequest {
  std::vector<std::string> sequences;  // files
  PlannedSite site;
  bool effects = false;
  double temperature_rise_c = 0.0;  // 0: the temperature stands still
  double temperature_tau_s = 2400.0;
  std::string navigate;  // how long; empty: not asked
  double align_s = 300.0;
  std::string format;  // json; empty: words
};

// What `predict` and `design` are made for.
void add_site_options(const Command& command, PlannedSite& site);

Status run_predict(const PredictRequest& request, std::ostream& out);

}  // namespace turncal
