// Calibration with unknown angles: Gauss-Newton over the observations of rest_system.h.
//
// Start: A and f0 from the ellipsoid through the static means (A upper triangular, from the Cholesky factor), gyro bias
// from the static means, one common gyro scale factor from the rotations. Then all 21 parameters and the given effects
// together.
//
// Weights are measured, not assumed: the variance of a row is that of the white noise (rest_data.h) plus the square of
// a floor of its kind. Each floor is estimated so that the weighted sum of squares of its kind equals its redundancy
// (variance components; W. Foerstner, Allg. Vermessungs-Nachr. 86 (1979); K.-R. Koch, Parameter Estimation and
// Hypothesis Testing, 2nd ed., 3.6.2). The floor covers what white noise does not: bias that wanders from rest to rest,
// rotations that the gyros do not follow, an effect that the model lacks.
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

// Returns the angle between predicted and measured gravity after a turn, rms over the legs without a fault, with the
// coarse accelerometers and rate = gyro_map * nominal scale * reading.
double rest_misfit_rad(const RestData& data, const Eigen::Matrix3d& gyro_map);
// Returns the factor on `gyro_map`, within two either way and to 1 %, with the least misfit.
double best_rest_factor(const RestData& data, const Eigen::Matrix3d& gyro_map);

// One floor per kind: m/s^2, rad, rad/s.
using RestFloors = Eigen::Array<double, rest_kind_count, 1>;

struct RestFit {
  bool converged = false;
  std::string message = "not run";
  Parameters parameters;
  Eigen::VectorXd effect_values;          // in the order of the given columns
  Eigen::VectorXd sigma;                  // 24 parameters (0: fixed, NaN: not determined), then effects
  std::vector<std::string> undetermined;  // parameters and effect columns that the motion does not determine
  RestFloors floors = RestFloors::Zero();
  RestErrors errors;                                  // on the fitted data
  RestErrors left_out;                                // cross-validated: each leg, each rest
  std::array<double, rest_kind_count> redundancy{};   // rows less the parameters' share, by kind
  std::array<double, rest_kind_count> white_ratio{};  // rms over that of white noise: 1 when nothing else is there
  int iterations = 0;
};

// `effects.values` is the start for the effects; all columns are estimated. Returns an error if there are too few rests
// or rotations to start from; a fit that does not converge has converged = false.
Result<RestFit> fit_rests(const RestData& data, const EffectModel& effects);
// The same from a given start, without the coarse one. Floors to start from: of a similar model; default: from the residuals of the start.
RestFit refine_rests(const RestData& data, const Parameters& start, const EffectModel& effects,
                     const std::optional<RestFloors>& floors = {});

// Returns the floor of each kind at which its weighted sum of squares equals its `freedom`.
RestFloors estimate_floors(const RestSystem& system, const std::array<double, rest_kind_count>& freedom);
// Returns the row weights 1/sigma for given floors.
Eigen::VectorXd rest_weights(const RestSystem& system, const RestFloors& floors);
// Returns the prediction errors of all rows, each with its own rest or leg left out; NaN where the other rows determine no prediction.
Eigen::VectorXd left_out_residual(const RestSystem& system, const Eigen::VectorXd& weights);

}  // namespace turncal
