// Coarse start of a calibration with unknown angles, from the static means and the turns between them. See
// rest_model.h.
//
// Ellipsoid: the readings y of a triad with f = A y - f0, |f| = g, obey y' Q y + q' y = 1. Nine coefficients by linear
// least squares; Q (scaled) = A'A, A upper triangular from its Cholesky factor. It needs nine rests that span all
// directions; else the nominal scale is the start. Common gyro scale: the one at which gravity is predicted best from
// rest to rest.
#pragma once

#include "calib/model/parameters.h"
#include "calib/rests/rest_data.h"
#include "calib/types/status.h"

namespace turncal {

Result<Parameters> coarse_rest_parameters(const RestData& data);

// Angle by which gravity's direction is missed after a turn, rms over the legs without a fault, with the coarse accelerometers and the
// nominal gyro scale times `gyro_factor`.
double rest_misfit_rad(const RestData& data, double gyro_factor);
// The same of gyros that are connected otherwise: rate = gyro_map * nominal scale * reading.
double rest_misfit_rad(const RestData& data, const Eigen::Matrix3d& gyro_map);

}  // namespace turncal
