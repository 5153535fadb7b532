// Calibration with unknown angles: Gauss-Newton over the observations of rest_system.h.
//
// Start: A and f0 from the ellipsoid through the static means (A upper triangular, from the Cholesky factor), gyro bias
// from the static means, one common gyro scale factor from the rotations. Then all 21 parameters and the given effects
// together.
//
// Weights are measured, not assumed: the variance of a row is that of the white noise (rest_data.h) plus a floor of its
// kind squared, and each floor is estimated so that the sum of squares of its kind equals the redundancy of its kind
// (variance components; W. Foerstner, Allg. Vermessungs-Nachr. 86 (1979); K.-R. Koch, Parameter Estimation and
// Hypothesis Testing, 2nd ed., 3.6.2). The floor holds what white noise does not: bias that wanders from rest to rest,
// rotations that the gyros do not follow, an effect that is missing in the model.
//
// Cross-validation: a leg's direction is predicted from all other rows; a rest's norm and gyros from all rows but its
// own and those of its two legs. For a linear problem with fixed weights the prediction error of rows K is (I -
// H_KK)^-1 r_K, H the hat matrix; near the solution the problem is linear.
//
// Source of the observation set: Tedaldi, Pretto, Menegatti, ICRA 2014 (which fits the two triads one after the other).
#pragma once

#include <optional>
#include <string>

#include "calib/rests/rest_system.h"
#include "calib/types/status.h"

namespace turncal {

// Coarse start of a calibration with unknown angles, from the static means and the turns between them.
//
// Ellipsoid: the readings y of a triad with f = A y - f0, |f| = g, obey y' Q y + q' y = 1. Nine coefficients by linear
// least squares; Q (scaled) = A'A, A upper triangular from its Cholesky factor. It needs nine rests that span all
// directions; else the nominal scale is the start. Common gyro scale: the one at which gravity is predicted best from
// rest to rest.
Result<Parameters> coarse_rest_parameters(const RestData& data);

// Angle by which gravity's direction is missed after a turn, rms over the legs without a fault, with the coarse accelerometers and
// rate = gyro_map * nominal scale * reading.
double rest_misfit_rad(const RestData& data, const Eigen::Matrix3d& gyro_map);
// The factor on `gyro_map`, within two either way and to 1 %, at which it is least.
double best_rest_factor(const RestData& data, const Eigen::Matrix3d& gyro_map);

// Of each kind: m/s^2, rad, rad/s.
using RestFloors = Eigen::Array<double, rest_kind_count, 1>;

struct RestFit {
  bool converged = false;
  std::string message = "not run";
  Parameters parameters;
  Eigen::VectorXd effect_values;          // as the columns given
  Eigen::VectorXd sigma;                  // 24 parameters (0: fixed, NaN: not determined), then effects
  std::vector<std::string> undetermined;  // parameters, or combinations, that the motion does not show
  RestFloors floors = RestFloors::Zero();
  RestErrors errors;                                 // on the fitted data
  RestErrors left_out;                               // by cross-validation: each leg, each rest
  std::array<double, rest_kind_count> redundancy{};  // rows less parameters, kind by kind
  std::array<double, rest_kind_count>
      white_ratio{};  // rms over that of white noise alone: 1 when nothing else is there
  int iterations = 0;
};

struct RestFitOptions {
  std::optional<RestFloors> start_floors;  // of a model that is near; else from the residuals of the start
};

// `effects.values` is the start for the effects; all of its columns are estimated. An error when there are not enough
// rests or rotations to start from; a fit that does not converge comes back with converged = false.
Result<RestFit> fit_rests(const RestData& data, const EffectModel& effects, const RestFitOptions& options = {});
// From a given start (no coarse start).
RestFit refine_rests(const RestData& data, const Parameters& start, const EffectModel& effects,
                     const RestFitOptions& options = {});

// The floor of each kind at which its sum of squares is its redundancy.
RestFloors estimate_floors(const RestSystem& system, const std::array<double, rest_kind_count>& freedom);
// Row weights 1/sigma for given floors.
Eigen::VectorXd rest_weights(const RestSystem& system, const RestFloors& floors);
// Prediction errors of all rows, each with its own rest or leg left out; NaN where nothing is left to predict from.
Eigen::VectorXd left_out_residual(const RestSystem& system, const Eigen::VectorXd& weights);

}  // namespace turncal
