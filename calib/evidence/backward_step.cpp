#include "calib/evidence/backward_step.h"

namespace turncal {

using Eigen::Matrix3d;
using Columns = Eigen::Matrix<double, Eigen::Dynamic, 3>;

BackwardStep::BackwardStep(const FilterStep& step, double t, int states, bool in_piece)
    : step_(step),
      states_(states),
      in_piece_(in_piece),
      psi_psi_(step.turn_n),
      v_psi_(-step.F * t),
      psi_b_(step.C_mid * t),
      v_b_(-step.F * step.C_mid * (0.5 * t * t)) {
  if (!step.observed) return;
  H_.setZero(3, states + 6);
  H_.leftCols<3>() = 0.5 * v_psi_;
  H_.middleCols<3>(3).setIdentity();
  const Matrix3d by_gyro = v_b_ / 3.0;
  const Matrix3d by_accel = 0.5 * psi_b_;
  for (int at = 6; at <= states; at += 6) {  // b_g, b_a where there are any, then the piece's
    H_.middleCols<3>(at) = by_gyro;
    H_.middleCols<3>(at + 3) = by_accel;
  }
}

void BackwardStep::apply(Eigen::MatrixXd& M) const {
  const Columns psi = M.leftCols<3>(), v = M.middleCols<3>(3);
  Columns by_gain;
  if (step_.observed) {
    by_gain = psi * step_.K.middleRows<3>(0) + v * step_.K.middleRows<3>(3);
    if (states_ == 12) {
      by_gain += M.middleCols<3>(6) * step_.K.middleRows<3>(6);
      by_gain += M.middleCols<3>(9) * step_.K.middleRows<3>(9);
    }
  }
  const Columns gyro = psi * psi_b_ + v * v_b_, accel = v * psi_b_;
  M.leftCols<3>() = psi * psi_psi_ + v * v_psi_;
  if (states_ == 12) {
    M.middleCols<6>(6) *= step_.rho;
    M.middleCols<3>(6) += gyro;
    M.middleCols<3>(9) += accel;
  }
  if (in_piece_) {
    M.middleCols<3>(states_) += gyro;
    M.middleCols<3>(states_ + 3) += accel;
  }
  if (!step_.observed) return;
  for (int at = 0; at < M.cols(); at += 3) {
    if (at == 3)
      M.middleCols<3>(3) -= by_gain;
    else
      M.middleCols<3>(at) -= by_gain * H_.middleCols<3>(at);
  }
}

}  // namespace turncal
