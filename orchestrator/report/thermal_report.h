// Parameters as functions of temperature (calib/thermal/thermal_model.h), as files and for people (docs/thermal.md): thermal.conf, the
// polynomials of a parameter file, and the document for terminal and page.
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
  // Drift of a unit at rest for an hour due to the parameter errors at left-out temperatures (rms): with the mean of the others, with the
  // model, and with a leg by itself.
  double before_nm_per_h = 0.0, after_nm_per_h = 0.0, noise_nm_per_h = 0.0;
};

std::string format_thermal(const ThermalReport& report);
Document thermal_document(const ThermalReport& report);

// Adds parameters at the reference temperature, their sigmas and covariance, polynomials and turn-on scatter to a file.
void describe_thermal(const ThermalModel& model, ParameterFile& file);

}  // namespace turncal
