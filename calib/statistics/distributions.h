// Tail probabilities of the distributions that tests are judged by; regularised incomplete gamma and beta functions are Eigen's.
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <vector>

namespace turncal {

inline constexpr double normal_95 = 1.959964;  // standard deviations that hold 95 % of a normal distribution
// Upper tail of chi-square with n degrees of freedom; 1 for none.
double chi_square_tail(double value, double degrees);
// What chi-square with one degree of freedom exceeds with this probability.
double chi_square_1_limit(double tail_probability);
// What chi-square with n degrees of freedom exceeds with this probability; n above 0.
double chi_square_limit(double tail_probability, double degrees);
// Upper tail of Fisher's F with these degrees of freedom.
double f_tail(double f, double numerator, double denominator);

// The middle of some numbers: the element at place size / 2 in order, so the upper of two middles. Rearranges them; one at least.
inline double median(std::vector<double>& values) {
  assert(!values.empty());
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace turncal
