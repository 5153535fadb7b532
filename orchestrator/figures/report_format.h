// Numbers and texts as people read them, for the report and the terminal. Files have format_number.h instead.
//
// Text for people comes in two alphabets: plain (terminal: ug/g^2, +-) and typographic (HTML, UTF-8: µg/g², ±).
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace turncal {

enum class IncrementKind;  // calib/types/recording_types.h

enum class Alphabet { plain, typographic };

// & < > " ' replaced; control characters become blanks; bytes that are not UTF-8 become '?'.
std::string html_escape(std::string_view text);

// `digits` significant ones: 28.3, 0.00123, 1.23e-07 (typographic 1.23×10⁻⁷); "-" for a number that is not finite.
std::string significant(double value, int digits = 3, Alphabet alphabet = Alphabet::plain);
// As many decimals as two digits of sigma have: value_with_sigma(28.3456, 0.91) = "28.35". Without a sigma six digits.
std::string value_with_sigma(double value, double sigma, Alphabet alphabet = Alphabet::plain);
// "28.35 ± 0.91 µg/g²"
std::string quantity(double value, double sigma, std::string_view unit);
// 0.00 for -0.001; "-" for a number that is not finite.
std::string with_decimals(double value, int decimals);
// Three decimals: numbers near 1 that are compared with one another.
std::string ratio(double value);
// "-69 %", "+3 %", "0 %"; "-" when there is nothing to compare.
std::string percent_change(double before, double after);
// "+12.3", always with its sign.
std::string signed_number(double value, int decimals);
// 1:45:42
std::string clock_time(double seconds);

// The unit of one of the 24 parameters in a parameter file, as the catalogue would write it; "-": it has none.
const char* parameter_unit(std::string_view key, IncrementKind gyro_increment);
// "µg/g²" of the catalogue's ug/g^2.
std::string unit_text(std::string_view unit);

// A unit in which numbers up to `largest` are easy to read: value in SI times factor.
struct DisplayUnit {
  double factor = 1.0;
  std::string unit;  // typographic
};
DisplayUnit velocity_unit(double largest_mps);
DisplayUnit acceleration_unit(double largest_mps2);  // µg, mg, g
DisplayUnit rate_unit(double largest_radps);         // °/h, °/s
DisplayUnit angle_unit(double largest_rad);          // ″, mrad

std::string join(const std::vector<std::string>& parts, std::string_view separator = ", ");
// Lines of at most `width` characters, broken at blanks.
std::vector<std::string> wrap(std::string_view text, std::size_t width);
// At most `width` characters; what is cut is replaced by "...".
std::string shorten(std::string_view text, std::size_t width);

}  // namespace turncal
