// `turncal predict`: predicts what sequences would determine, and how well, before anything is run.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <turncal/error.h>
#include <turncal/report.h>

namespace turncal::v0 {

struct PredictOptions {
  std::string station = {};                                    // file; empty: the built-in one
  std::optional<double> latitude_deg = {}, gravity_mps2 = {};  // default: the station's
  double arw_deg_per_rt_h = 0.002;
  double vrw_ug_per_rt_hz = 8.0;
  double gyro_bias_instability_degph = 0.0;
  double accel_bias_instability_ug = 0.0;
  bool effects = false;  // adds the smallest detectable effects to the report
};

struct SequencePrediction {
  std::string name;
  double station_s = 0.0;          // duration
  double static_s = 0.0;           // part of it at rest
  std::array<double, 24> sigma{};  // as in the parameter file; NaN: undetermined
  std::string refused;             // why the station cannot run it; empty: it can
};

struct Prediction {
  std::vector<SequencePrediction> sequences;
  Report report;
};

TURNCAL_API Prediction predict(const std::vector<std::string>& sequence_files, const PredictOptions& options = {});

}  // namespace turncal::v0
