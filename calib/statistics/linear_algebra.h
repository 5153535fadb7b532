// Eigen's dear decompositions of matrices of any size, compiled once in linear_algebra.cpp. A file that uses one includes this
// header in place of <Eigen/SVD> or <Eigen/QR>; each took ten seconds and more to compile them for itself.
#pragma once

#include <Eigen/QR>
#include <Eigen/SVD>

extern template class Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;
extern template class Eigen::JacobiSVD<Eigen::MatrixXd>;
extern template class Eigen::BDCSVD<Eigen::MatrixXd>;
