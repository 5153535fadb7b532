// Numbers as people read them, with digits that follow the sigma; in two alphabets: plain (terminal: +-, 1e-07) and typographic (HTML,
// UTF-8: ±, 10⁻⁷).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace turncal {

enum class Alphabet { plain, typographic };

// Returns `digits` significant digits: 28.3, 0.00123, 1.23e-07 (typographic 1.23×10⁻⁷); "-" for a number that is not finite.
std::string significant(double value, int digits = 3, Alphabet alphabet = Alphabet::plain);
// Rounds to the place of the second significant digit of sigma, the one function for it: value_with_sigma(28.3456,
// 0.91) = "28.35", value_with_sigma(12345.6, 310) = "12350". Without a sigma: six significant digits.
std::string value_with_sigma(double value, double sigma, Alphabet alphabet = Alphabet::plain);
// Returns "28.35 ± 0.91", "28.35 +- 0.91"; without a sigma the value alone.
std::string plus_minus(double value, double sigma, Alphabet alphabet = Alphabet::plain);
// Returns 0.00 for -0.001; "-" for a number that is not finite.
std::string with_decimals(double value, int decimals);
std::string counted(std::int64_t count, std::string_view noun);  // "1 sample", "2 samples", "2 batches"

}  // namespace turncal
