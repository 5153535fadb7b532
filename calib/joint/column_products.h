// Products of three columns, a row a parameter, with a 3x3 matrix: what moves the columns of all parameters together.
//
// All three results of a row are made while its three values are at hand; a general product goes over the rows three times.
#pragma once

#include <Eigen/Core>

namespace turncal {

// to (+)= from * by, n rows; columns are `stride` apart and do not overlap.
template <bool add>
inline void column_product(const double* __restrict from, Eigen::Index from_stride, const Eigen::Matrix3d& by,
                           double* __restrict to, Eigen::Index to_stride, Eigen::Index n) {
  const double* __restrict x = from;
  const double* __restrict y = from + from_stride;
  const double* __restrict z = from + 2 * from_stride;
  double* __restrict a = to;
  double* __restrict b = to + to_stride;
  double* __restrict c = to + 2 * to_stride;
  const double xa = by(0, 0), ya = by(1, 0), za = by(2, 0), xb = by(0, 1), yb = by(1, 1), zb = by(2, 1), xc = by(0, 2),
               yc = by(1, 2), zc = by(2, 2);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double xi = x[i], yi = y[i], zi = z[i];
    a[i] = (add ? a[i] : 0.0) + (xi * xa + yi * ya + zi * za);
    b[i] = (add ? b[i] : 0.0) + (xi * xb + yi * yb + zi * zb);
    c[i] = (add ? c[i] : 0.0) + (xi * xc + yi * yc + zi * zc);
  }
}

// Of columns of matrices: from.middleCols<3>(at) and so on, each with a data() and an outerStride().
template <class From, class To>
inline void set_product(const From& from, const Eigen::Matrix3d& by, To&& to) {
  column_product<false>(from.data(), from.outerStride(), by, to.data(), to.outerStride(), to.rows());
}
template <class From, class To>
inline void add_product(const From& from, const Eigen::Matrix3d& by, To&& to) {
  column_product<true>(from.data(), from.outerStride(), by, to.data(), to.outerStride(), to.rows());
}

}  // namespace turncal
