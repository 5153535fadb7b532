// Writes a calibration in the forms of other programs (docs/files.md): one table, one function a form.
//
// The raw readings of a form are counts times their nominal weight over the sample period, in rad/s and m/s^2:
//   w = S_g raw_w - N0,   f = S_a raw_f - A0,   S = n or a over the nominal scale
// in the body axes b (x front, y up, z right), or those of the form: v' = P v, S' = P S P'.
#pragma once

#include <array>
#include <string>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"

namespace turncal {

struct ForeignCalibration {
  ParameterFile file;
  std::string path;
  Eigen::Matrix3d gyro, accel;  // S
  Eigen::Vector3d gyro_bias_radps, accel_bias_mps2;
  NoiseModel noise;
};
// Returns an error when the file's noise keys cannot be read.
Result<ForeignCalibration> foreign_calibration(const ParameterFile& file, const std::string& path);

struct ForeignForm {
  const char* name;
  std::string (*write)(const ForeignCalibration& of);
  bool needs_noise;
};
extern const std::array<ForeignForm, 7> foreign_forms;
// Returns an error when the file lacks something that the form needs.
Result<std::string> write_foreign_form(const ParameterFile& file, const std::string& path, const std::string& form);

}  // namespace turncal
