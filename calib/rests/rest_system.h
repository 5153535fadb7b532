// The observations of a recording without table angles, and their derivatives.
//
// For given parameters and effects (w = G x gyro - b - Rg e, f = A x accel - f0 - Ra e, e the effects' values):
//   norm       |f_k| - g                                             one a rest, m/s^2
//   gyro       w_k - d_k - w_ie sin(latitude) u_k - C_bn,k h         three a rest, rad/s; d_k = (u_last - u_first) x u / T: what the rest
//              crept, by the turn of gravity between its edges; h the horizontal earth rate
//   direction  B (C_k' u_k,last + T h_b x u_k+1 - u_k+1,first)       two a leg of T seconds, rad; C_k the product of the leg's
//   blocks, h_b = C_bn,k+1 h
// with u = f / |f|, and B two axes across u_k+1. A change dr of a block's rotation moves the end by -C_k' (C_before Jl(r) dr x u_k); one sum serves
// parameters and effects. B and d_k are held fixed in the derivative. Columns: the 21 free parameters (Table 1, file units), then the effects.
//
// h: the gyros carry the heading from rest to rest, but not its origin. So h has two components for each stretch of legs without a fault, with prior
// N(0, (w_ie cos(latitude))^2 / 2). Its best value for these parameters is removed from rows and columns; with gyros too noisy to observe it, it is
// near zero. Each stretch spends two observations on h that still count as redundant.
// Not modelled: the derivative of C_bn,k, creep inside an edge.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/model/effects.h"
#include "calib/model/parameters.h"
#include "calib/rests/rest_data.h"

namespace turncal {

inline constexpr int rest_parameter_count = 21;

enum class RestKind : char { norm = 0, direction = 1, gyro = 2 };
inline constexpr int rest_kind_count = 3;
constexpr std::size_t index(RestKind kind) { return std::size_t(kind); }
const char* to_string(RestKind kind);

struct RestSystem {
  Eigen::VectorXd residual;        // SI
  Eigen::MatrixXd jacobian;        // rows x (21 + effects); empty without columns
  Eigen::VectorXd white_variance;  // variance from the measured white noise alone
  std::vector<RestKind> kind;      // of each row
  std::vector<int> owner;          // rest or leg of each row
};

// Returns two axes across the unit vector v: B above, in which direction rows are given.
Eigen::Matrix<double, 2, 3> axes_across(const Eigen::Vector3d& v);

// Legs with a fault have no rows. Effect regressors are evaluated block by block (BlockState; w and w_dot are zero at
// rest; the heading of C_nb continues from an arbitrary start).
RestSystem make_rest_system(const RestData& data, const Parameters& parameters, const EffectModel& effects,
                            bool with_columns);

// Errors as rms over rests and legs: of the norm (m/s^2), of the angle between predicted and measured gravity (rad), of
// the gyros axis by axis (rad/s).
struct RestErrors {
  double norm_rms_mps2 = 0.0;
  double direction_rms_rad = 0.0;
  double gyro_rms_radps = 0.0;
};
RestErrors rest_errors(const RestSystem& system, const Eigen::VectorXd& residual);

}  // namespace turncal
