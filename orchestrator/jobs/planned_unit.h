// The station, the site and the unit's noise that a prediction or a design is made for: the options that `turncal predict` and
// `turncal design` share.
//
// Which of the parameters a plan would leave undetermined, found before anything moves (calib/prediction/predict.h): a run of such a
// sequence is refused unless it only captures (--capture-only) or may be estimated in part (--partial).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/model/noise_model.h"
#include "calib/model/parameters.h"
#include "calib/prediction/planned_motion.h"
#include "calib/prediction/predict.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "orchestrator/report/document.h"
#include "orchestrator/station/station_config.h"
#include "sequences/plan.h"

namespace turncal {

struct PlannedSite {
  std::string station;  // file; empty: the built-in rig station
  std::optional<double> latitude_deg;
  std::optional<double> gravity_mps2;
  double arw_deg_per_rt_h = 0.002;
  double vrw_ug_per_rt_hz = 8.0;
  double gyro_bias_instability_degph = 0.0;
  double accel_bias_instability_ug = 0.0;
};

// The unit that the station's IMU driver would deliver.
struct PlannedUnit {
  StationConfig station;
  RecordingInfo info;
  Parameters parameters;
};

// An option's number is in its range (low excluded where above_low): "--arw = 0: expected ...". False for nan, which the command line lets pass.
Status check_option(const char* option, double value, double low, double high, bool above_low = false);
// A time as people write it, from 1 s to 24 h: 1h, 90min, 5400s or 5400.
Result<double> parse_time_s(const char* option, const std::string& text);
Status check_site(const PlannedSite& site);
Result<PlannedUnit> planned_unit(const PlannedSite& site);
NoiseModel noise_model(const PlannedSite& site);
Facts describe_premises(const PlannedSite& site, const RecordingInfo& info);

// A plan as the pure functions of calib take it.
PlannedMotion planned_motion(const Sequence& sequence, const Plan& plan);

// Keys of the free parameters, in their order; empty: all are determined. info: period, site and increments of the unit. The noise is
// that of a good laser-gyro unit (0.002 deg/sqrt(h), 8 ug/sqrt(Hz)); what no rotation shows stays undetermined at any noise.
// Of a plan of more than 20 000 items nothing is said, so that nobody waits for long.
std::vector<std::string> undetermined_by(const Sequence& sequence, const Plan& plan, const RecordingInfo& info);

// Keys of the parameters with a number above 0 in `asked` that the prediction leaves undetermined.
std::vector<std::string> open_parameters(const Prediction& prediction, const ParameterVector& asked);

// "does not determine n11 n12: expected ...": to follow the name of the sequence.
std::string coverage_text(const std::vector<std::string>& keys);

}  // namespace turncal
