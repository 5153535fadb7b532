// Tail probabilities of test distributions; the regularised incomplete gamma and beta functions are Eigen's.
// Decompositions of matrices of any size, compiled once in numerics.cpp: each takes up to ten seconds to compile in
// every file that uses Eigen's own. Small ones of fixed size (LLT of a 3x3) are cheap and used directly.
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <span>

#include <Eigen/Core>

namespace turncal {

inline constexpr double normal_95 = 1.959964;  // standard deviations that hold 95 % of a normal distribution
// Upper tail of chi-square with n degrees of freedom; 1 for none.
double chi_square_tail(double value, double degrees);
// Value that chi-square with one degree of freedom exceeds with this probability.
double chi_square_1_limit(double tail_probability);
// Value that chi-square with n degrees of freedom exceeds with this probability; n above 0.
double chi_square_limit(double tail_probability, double degrees);
// Upper tail of Fisher's F with these degrees of freedom.
double f_tail(double f, double numerator, double denominator);

// Returns the value at a place in sorted order. Rearranges the values.
inline double value_at_rank(std::span<double> values, std::size_t place) {
  assert(place < values.size());
  const auto at = values.begin() + std::ptrdiff_t(place);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}
// Returns the median, the upper one of two middles. Rearranges the values.
inline double median(std::span<double> values) { return value_at_rank(values, values.size() / 2); }

// ---- linear algebra ----

// Solves A x = b for a symmetric, positive semi-definite A (LDL' with pivoting).
Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, double& log_determinant);

// By LU with partial pivoting. REQUIRES: A regular.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);

// Inverse of a symmetric, positive definite A whose rows differ by many powers of ten: scales its diagonal to ones.
Eigen::MatrixXd balanced_inverse(const Eigen::MatrixXd& A);

// A = vectors diag(values) vectors', values rising. REQUIRES: A symmetric (the lower triangle is read)
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& A);

// A = U diag(values) V', values falling; min(rows, cols) columns. V only on request.
struct ThinSvd {
  Eigen::VectorXd values;
  Eigen::MatrixXd U, V;
};
ThinSvd thin_svd(const Eigen::MatrixXd& A, bool with_V = false);

// min |A x - b| by QR with column pivoting. Pivots below `threshold` of the largest do not count for the rank; 0: by rounding.
struct LeastSquares {
  Eigen::VectorXd x;
  Eigen::Index rank = 0;
};
LeastSquares least_squares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, double threshold = 0.0);
// moments += [N; nu] [N; nu]', lower triangle only; `rows` are N and, last, nu.
void add_moments(const Eigen::Ref<const Eigen::MatrixXd>& rows, Eigen::MatrixXd& moments);

}  // namespace turncal
