// The eight tests for special causes on a chart of individuals.
//
//   z_i = (x_i - mean) / sigma; a test gives a signal at the last point of the stretch that meets it
//
// L. S. Nelson, "The Shewhart Control Chart: Tests for Special Causes", Journal of Quality Technology 16 (4), 1984, 237-239. The
// false alarm rates are exact: independent normal values of known mean and sigma, for each point that has enough before it. With mean
// and sigma estimated from few values they are higher, above all that of test 1.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace turncal {

struct RunRule {
  const char* words;
  std::size_t stretch;  // points
  double false_alarm;   // a point
};
// Numbered from 1 in the paper.
inline constexpr std::array<RunRule, 8> run_rules = {{
    {"one point beyond 3 sigma", 1, 0.00270},                                // 2 (1 - Phi(3))
    {"nine in a row on one side of the mean", 9, 0.00391},                   // 2 / 2^9
    {"six in a row rising, or falling", 6, 0.00278},                         // 2 / 6!
    {"fourteen in a row up and down by turns", 14, 0.00457},                 // 2 E_14 / 14!, E_14 = 199360981
    {"two of three beyond 2 sigma on one side", 3, 0.00306},                 // 2 (3 p^2 - 2 p^3), p = 1 - Phi(2)
    {"four of five beyond 1 sigma on one side", 5, 0.00553},                 // 2 (5 p^4 - 4 p^5), p = 1 - Phi(1)
    {"fifteen in a row within 1 sigma", 15, 0.00326},                        // (1 - 2 p)^15
    {"eight in a row on both sides with none within 1 sigma", 8, 0.000102},  // (2 p)^8 - 2 p^8
}};

struct RunSignal {
  std::size_t rule = 1;   // number of the paper
  std::size_t point = 0;  // the last one of the stretch
  bool operator==(const RunSignal&) const = default;
};

// By point, then by rule.
std::vector<RunSignal> run_signals(std::span<const double> z);

}  // namespace turncal
