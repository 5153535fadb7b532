// Eigen's dear decompositions of matrices of any size, compiled once in linear_algebra.cpp. A file that uses one includes this
// header in place of <Eigen/SVD>, <Eigen/QR> and the like: each took up to ten seconds to compile them for itself. BDCSVD is not
// among them: it alone takes 25 s, and matrices here have fewer than a hundred columns.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>

extern template class Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;
extern template class Eigen::JacobiSVD<Eigen::MatrixXd>;
extern template class Eigen::LDLT<Eigen::MatrixXd>;
extern template class Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>;
