// What a parameter file says of its own uncertainty: noise of the sensors, and the covariance of the parameters.
#pragma once

#include "calib/model/noise_model.h"
#include "calib/navigation/drift.h"
#include "imu_io/recordings/parameter_file.h"

namespace turncal {

// The `noise.` keys; what is not there keeps the value of NoiseModel, and the pulses are those of the increments. has_noise: whether the
// random walks are there.
bool has_noise(const ParameterFile& file);
Result<NoiseModel> stored_noise(const ParameterFile& file, const std::string& file_name);

// Correlations of the `quality.covariance.` keys with the standard deviations `sigma.` (they can be wider than the covariance, where
// the fit is not trusted); without those keys the standard deviations alone, and zero where there is none.
//
// A file with effects gives none: its sigmas are those of parameters and effects together, and without their correlations a bias and its
// own drift would count as two errors that never cancel.
struct StoredCovariance {
  ParameterCovariance covariance = ParameterCovariance::Zero();
  const char* source = "none";  // covariance, sigmas, none or effects
};
Result<StoredCovariance> stored_covariance(const ParameterFile& file, const std::string& file_name);

}  // namespace turncal
