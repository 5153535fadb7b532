// Tail probabilities of the distributions that tests are judged by; regularised incomplete gamma and beta functions are Eigen's.
#pragma once

namespace turncal {

// Upper tail of chi-square with n degrees of freedom; 1 for none.
double chi_square_tail(double value, double degrees);
// What chi-square with one degree of freedom exceeds with this probability.
double chi_square_1_limit(double tail_probability);
// Upper tail of Fisher's F with these degrees of freedom.
double f_tail(double f, double numerator, double denominator);

}  // namespace turncal
