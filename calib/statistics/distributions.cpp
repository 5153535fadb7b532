#include "calib/statistics/distributions.h"

#include <unsupported/Eigen/SpecialFunctions>

namespace turncal {

double chi_square_tail(double value, double degrees) {
  return degrees > 0.0 && value > 0.0 ? Eigen::numext::igammac(0.5 * degrees, 0.5 * value) : 1.0;
}

double chi_square_1_limit(double tail_probability) {
  const double z = Eigen::numext::ndtri(0.5 * tail_probability);
  return z * z;
}

double f_tail(double f, double numerator, double denominator) {
  if (!(f > 0.0)) return 1.0;
  return Eigen::numext::betainc(0.5 * denominator, 0.5 * numerator, denominator / (denominator + numerator * f));
}

}  // namespace turncal
