// Decompositions of matrices of any size, compiled once in linear_algebra.cpp: a file that uses Eigen's own takes up to ten seconds to
// compile each of them for itself. Small ones of fixed size (LLT of a 3x3) are cheap and used directly.
#pragma once

#include <Eigen/Core>

namespace turncal {

// A x = b for a symmetric, positive semi-definite A (LDL' with pivoting).
Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, double& log_determinant);

// By LU with partial pivoting. REQUIRES: A regular
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);

// Of a symmetric, positive definite A whose rows differ by many powers of ten: by way of ones on its diagonal.
Eigen::MatrixXd balanced_inverse(const Eigen::MatrixXd& A);

// A = vectors diag(values) vectors', values rising. REQUIRES: A symmetric (the lower triangle is read)
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& A);

// A = U diag(values) V', values falling; min(rows, cols) columns. V only if it is wanted.
struct ThinSvd {
  Eigen::VectorXd values;
  Eigen::MatrixXd U, V;
};
ThinSvd thin_svd(const Eigen::MatrixXd& A, bool with_V = false);

// min |A x - b| by QR with column pivoting. Columns below `threshold` of the largest pivot do not count for the rank; 0: by rounding.
struct LeastSquares {
  Eigen::VectorXd x;
  Eigen::Index rank = 0;
};
LeastSquares least_squares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, double threshold = 0.0);
// moments += [N; nu] [N; nu]', of which the lower triangle is kept: `rows` are N and, last, nu.
void add_moments(const Eigen::Ref<const Eigen::MatrixXd>& rows, Eigen::MatrixXd& moments);
// Orthonormal columns that span those of A.
Eigen::MatrixXd column_space(const Eigen::MatrixXd& A);

}  // namespace turncal
