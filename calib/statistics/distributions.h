// Tail probabilities of the distributions that tests are judged by; regularised incomplete gamma and beta functions are Eigen's.
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <span>

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

// What stands at a place of some numbers once they are in order. Rearranges them.
inline double value_at_rank(std::span<double> values, std::size_t place) {
  assert(place < values.size());
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(place);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}
// The middle: at place size / 2, so the upper of two middles.
inline double median(std::span<double> values) { return value_at_rank(values, values.size() / 2); }

}  // namespace turncal
