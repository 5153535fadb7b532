#include "calib/statistics/numerics.h"

#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <unsupported/Eigen/SpecialFunctions>

namespace turncal {

double chi_square_tail(double value, double degrees) {
  return degrees > 0.0 && value > 0.0 ? Eigen::numext::igammac(0.5 * degrees, 0.5 * value) : 1.0;
}

double chi_square_1_limit(double tail_probability) {
  const double z = Eigen::numext::ndtri(0.5 * tail_probability);
  return z * z;
}

double chi_square_limit(double tail_probability, double degrees) {
  double low = 0.0, high = degrees + 10.0 * std::sqrt(2.0 * degrees) + 40.0;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (chi_square_tail(middle, degrees) > tail_probability ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

double f_tail(double f, double numerator, double denominator) {
  if (!(f > 0.0)) return 1.0;
  return Eigen::numext::betainc(0.5 * denominator, 0.5 * numerator, denominator / (denominator + numerator * f));
}

// ---- linear algebra ----

using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd solve_symmetric(const MatrixXd& A, const MatrixXd& B) { return A.ldlt().solve(B); }

VectorXd solve_symmetric(const MatrixXd& A, const VectorXd& b) { return A.ldlt().solve(b); }

VectorXd solve_symmetric(const MatrixXd& A, const VectorXd& b, double& log_determinant) {
  const Eigen::LDLT<MatrixXd> factor(A);
  log_determinant = factor.vectorD().array().log().sum();
  return factor.solve(b);
}

MatrixXd inverse(const MatrixXd& A) { return A.inverse(); }

MatrixXd balanced_inverse(const MatrixXd& A) {
  const VectorXd scale = A.diagonal().cwiseSqrt().cwiseInverse();
  const MatrixXd unit = scale.asDiagonal() * A * scale.asDiagonal();
  return scale.asDiagonal() * solve_symmetric(unit, MatrixXd(scale.asDiagonal()));
}

SymmetricEigen symmetric_eigen(const MatrixXd& A) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(A);
  return {eigen.eigenvalues(), eigen.eigenvectors()};
}

// Not BDCSVD: it alone takes 25 s to compile, and matrices here have fewer than a hundred columns.
ThinSvd thin_svd(const MatrixXd& A, bool with_V) {
  const unsigned thin_U = Eigen::ComputeThinU, thin_V = Eigen::ComputeThinV;
  const Eigen::JacobiSVD<MatrixXd> svd(A, with_V ? thin_U | thin_V : thin_U);
  return {svd.singularValues(), svd.matrixU(), with_V ? svd.matrixV() : MatrixXd()};
}

LeastSquares least_squares(const MatrixXd& A, const VectorXd& b, double threshold) {
  Eigen::ColPivHouseholderQR<MatrixXd> qr(A);
  if (threshold > 0.0) qr.setThreshold(threshold);
  return {qr.solve(b), qr.rank()};
}

void add_moments(const Eigen::Ref<const MatrixXd>& rows, MatrixXd& moments) {
  const Eigen::Index last = rows.rows() - 1;
  moments.topLeftCorner(last, last).selfadjointView<Eigen::Lower>().rankUpdate(rows.topRows(last));
  moments.row(last).head(last).noalias() += rows.row(last) * rows.topRows(last).transpose();
}

}  // namespace turncal
