// Parameters as functions of temperature (calib/thermal/thermal_model.h) as files and for people (docs/thermal.md): thermal.conf, the
// polynomials of a parameter file, and the document that terminal and page are made of.
#pragma once

#include <string>
#include <vector>

#include "calib/thermal/thermal_model.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/document.h"

namespace turncal {

inline constexpr const char* thermal_name = "thermal.conf";
inline constexpr const char* thermal_page_name = "thermal.html";

struct ThermalReport {
  std::string unit;
  IncrementKind gyro_increment = IncrementKind::pulses;
  bool simulated = false;
  std::vector<ThermalLeg> legs;
  ThermalModel model;
  std::vector<std::string> notes;
  // Of a unit at rest for an hour, by what the parameters are off at the temperatures left out (rms): the mean of the others, the model,
  // and a leg by itself.
  double before_nm_per_h = 0.0, after_nm_per_h = 0.0, noise_nm_per_h = 0.0;
};

std::string format_thermal(const ThermalReport& report);
Document thermal_document(const ThermalReport& report);

// Parameters at the reference, their sigmas and covariance, polynomials and switch-on scatter into a file.
void describe_thermal(const ThermalModel& model, ParameterFile& file);

}  // namespace turncal
