// The motion over one block of a CompressedRecording for given parameters, and its derivatives.
//
//   C_nb(end) = Exp(-w_ie dt) C_nb(start) Exp(rotation)
//   v_n(end) = v_n(start) + Exp(-w_ie dt / 2) C_nb(start) velocity - g dt U
// (n turns with the Earth during the block: without the half rotation a second at rest gains 0.3 mm/s to the east)
// with, in the body frame at the start of the block (G, b, A, f0: SensorModel; T the block's length),
//   rotation = G gyro - b T + 1/2 coning',   velocity = A accel - f0 T + sculling' + (m/2 - r/12) x (r x v)
// m: the mean over the block of the angle turned so far (r/2 in even rotation, from gyro_time).
// coning' and sculling' are the sums of compression.h taken with calibrated increments: coning transforms with the
// cofactor matrix of G because (G x) x (G y) = cof(G) (x x y), sculling as G S A', bias terms by first moments.
// mean_velocity is the time average over the block of the velocity gained since its start (same frame), to first order
// in rotation: exact enough for static seconds, where it is used.
//
// Valid for blocks that turn less than about 0.1 rad. Dropped: third-order coning (1e-9 rad a block at 0.012 rad), and of the
// velocity r^2/60 in blocks in which a turn begins or ends (5e-7 m/s at 60 deg/s^2), r^3/24 for a force that turns with the unit.
#pragma once

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct BlockMotion {
  Eigen::Vector3d rotation;       // rad
  Eigen::Vector3d velocity;       // m/s
  Eigen::Vector3d mean_velocity;  // m/s
};
BlockMotion evaluate(const Block& block, const SensorModel& model, double period_s);

// Derivatives by the 24 parameters (rows in Table 1 order, per file unit), at the same model:
//   d rotation / dG_ij = e_i gyro_j + 1/2 dcof(G)/dG_ij coning,    d rotation / db = -T I,
//   d velocity / dG_ij = e_i x (A S' e_j) + d third-order,         d velocity / dA_kl = e_k accel_l + (G S e_l) x e_k
// and the bias terms of evaluate() likewise. mean_velocity is valid at rest only, and computed only on request.
using ParameterRows = Eigen::Matrix<double, parameter_count, 3>;
struct BlockDerivatives {
  static constexpr int turning = 15;  // first rows, which move the rotation; the accelerometers' do not
  ParameterRows rotation = ParameterRows::Zero(), velocity, mean_velocity;
};
void differentiate(const Block& block, const BlockMotion& motion, const SensorModel& model,
                   const ParameterVector& si_per_unit, bool mean_velocity, BlockDerivatives& by_parameters);

}  // namespace turncal
