// One step of the filter run backward (piece_system.h), on matrices that have a column for each of
//   psi, v (n frame), with bias instability b_g, b_a, and then the biases of gyros and accelerometers within the piece of rest at hand.
// With Phi what the step does to those and nu's derivative H by them (joint_filter.h), the closed-loop transition is L = Phi - K H.
// Phi is an identity but for a few 3x3 blocks, and K has three columns, so M L costs a tenth of the product of full matrices.
#pragma once

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"

namespace turncal {

class BackwardStep {
 public:
  // `states`: 6 or 12. `t`: length of the step's block. `in_piece`: it is rest, so the piece's biases act.
  BackwardStep(const FilterStep& step, double t, int states, bool in_piece);
  void apply(Eigen::MatrixXd& M) const;  // M <- M L, and with the step not observed M Phi
  const Eigen::Matrix<double, 3, Eigen::Dynamic>& H() const { return H_; }

 private:
  const FilterStep& step_;
  const int states_;
  const bool in_piece_;
  Eigen::Matrix3d psi_psi_, v_psi_, psi_b_, v_b_;
  Eigen::Matrix<double, 3, Eigen::Dynamic> H_;
};

}  // namespace turncal
