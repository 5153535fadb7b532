#include "calib/statistics/distributions.h"

#include <cmath>

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

}  // namespace turncal
