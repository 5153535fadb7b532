// The station, the site and the unit's noise that a prediction or a design is made for: the options that `turncal predict` and
// `turncal design` share.
#pragma once

#include <optional>
#include <string>

#include "calib/model/noise_model.h"
#include "calib/model/parameters.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "orchestrator/report/document.h"
#include "orchestrator/station/station_config.h"

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

}  // namespace turncal
