// Predicts what sequences would determine, and how well, before anything is run: from files to the document of `turncal predict`
// (calib/prediction/predict.h). Also the site, unit and noise that a prediction or a design assumes.
//
// Errors are of kind input and name the option of the command: "--arw = 0: expected ...".
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "orchestrator/report/result_table.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

// Options that both commands share.
struct PlannedSite {
  std::string station = {};  // file; empty: the built-in rig station
  std::optional<double> latitude_deg = {}, gravity_mps2 = {};
  double arw_deg_per_rt_h = 0.002;
  double vrw_ug_per_rt_hz = 8.0;
  double gyro_bias_instability_degph = 0.0;
  double accel_bias_instability_ug = 0.0;
};

Status check_site(const PlannedSite& site);

// The unit that the station's IMU driver would deliver.
struct PlannedUnit {
  StationConfig station = {};
  RecordingInfo info = {};
  Parameters parameters = {};
};
Result<PlannedUnit> planned_unit(const PlannedSite& site);
NoiseModel noise_model(const PlannedSite& site);  // without options: a good laser-gyro unit
Facts describe_premises(const PlannedSite& site, const RecordingInfo& info);

struct PredictRequest {
  std::vector<std::string> sequences;  // files
  PlannedSite site;
  bool effects = false;
  double temperature_rise_c = 0.0;  // 0: constant temperature
  double temperature_tau_s = 2400.0;
  double navigate_s = 0.0;  // 0: no navigation
  double align_s = 300.0;
};

struct Predictions {
  RecordingInfo info;  // of the assumed unit
  std::vector<NamedPrediction> columns;
  std::vector<std::string> refused;  // one a sequence: why the station cannot run it; empty: it can
  Document document;
};
Result<Predictions> predict_sequences(const PredictRequest& request);

}  // namespace turncal
