#include "calib/statistics/linear_algebra.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace turncal {

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

MatrixXd column_space(const MatrixXd& A) {
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(A);
  return MatrixXd(qr.householderQ()).leftCols(qr.rank());
}

void add_moments(const Eigen::Ref<const MatrixXd>& rows, MatrixXd& moments) {
  const Eigen::Index last = rows.rows() - 1;
  moments.topLeftCorner(last, last).selfadjointView<Eigen::Lower>().rankUpdate(rows.topRows(last));
  moments.row(last).head(last).noalias() += rows.row(last) * rows.topRows(last).transpose();
}

}  // namespace turncal
