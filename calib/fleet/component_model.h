// One component of one effect over a fleet: what is common to all, to a station, to a lot, and of a unit.
//
// Recording i of unit u says y_i with variance v_i (s / Q and 1 / Q of unit_statistics.h). The model:
//   y_i = sum_j x_ij beta_j + sum_f g_f(level of i in factor f) + b_u + r_i + e_i,
//   e_i ~ N(0, v_i), b_u ~ N(0, sigma_b^2), g_f ~ N(0, sigma_f^2); r_i ~ N(0, sigma_r^2): what a unit changes by from one recording to the next, as a bias
//   does when it is switched on
// beta, fixed: what is tested. Variances by restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545; Searle, Casella and
// McCulloch, Variance Components, Wiley 1992, ch. 6), of which V is block-diagonal by unit, and the factors come in by Woodbury.
//
// sigma_r^2 by moments from units with several recordings (Mandel and Paule, Anal. Chem. 42 (1970) 1194): sum (y - mean of the unit)^2 / (v +
// sigma_r^2) is their degrees of freedom. A change at a level that the same units went through is in it too, and then has less weight.
//
// Not modelled: units that differ in their variances; values of a unit that drift from recording to recording.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace turncal {

struct ComponentData {
  Eigen::VectorXd y, v;   // v infinite: says nothing
  std::vector<int> unit;  // of each recording; those of one unit follow each other
};

// Cross-products of columns with the inverse of V = diag(v) + sigma_b^2 (1 for two recordings of one unit).
struct UnitWeights {
  UnitWeights(const ComponentData& data, double unit_variance);
  // X' V^-1 Y. Rows of X and Y: recordings.
  Eigen::MatrixXd product(const Eigen::MatrixXd& X, const Eigen::MatrixXd& Y) const;
  // Of X' V^-1 X.
  Eigen::VectorXd diagonal(const Eigen::MatrixXd& X) const;
  double log_determinant() const { return log_determinant_; }

 private:
  struct Unit {  // of several recordings
    Eigen::Index first = 0, count = 0;
    double shrink = 0.0;  // V_u^-1 = W - shrink W 1 1' W
  };
  std::vector<Unit> units_;
  Eigen::VectorXd w_;
  double log_determinant_ = 0.0;
};

// sigma_r^2; 0 where no unit has two recordings.
double recording_variance(const ComponentData& data);

// sigma_b^2 by restricted likelihood beside the columns of X. The variances of data have sigma_r^2 in them.
double unit_variance(const ComponentData& data, const Eigen::MatrixXd& X);

// sigma_b^2 first, then sigma_f^2 of each factor, beside a common mean. `factors`: of each the level of every recording.
std::vector<double> variance_components(const ComponentData& data, const std::vector<std::vector<int>>& factors);

}  // namespace turncal
