// Quantities, words and lines as people read them, and the 24 parameters by name and unit. For files see imu_io/base/text.h.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/value_text.h"

namespace turncal {

enum class IncrementKind;  // calib/types/recording_types.h

// "28.35 ± 0.91 µg/g²"
std::string quantity(double value, double sigma, std::string_view unit);

// Returns the unit of one of the 24 parameters in a parameter file, spelt as in the catalogue of effects; "-" when it has none.
const char* parameter_unit(std::string_view key, IncrementKind gyro_increment);
// Returns "gyro x bias" for N01, "accelerometer y towards z" for a23; for other judged or charted values "normalised residual",
// "highest temperature", "hours on the table". A key without a name of its own is returned as it is.
std::string quantity_name(std::string_view key);
// Returns the unit of the same quantity in a parameter file: "deg/h", "g"; empty when it has none, or when the kind of increments decides (n).
std::string quantity_unit(std::string_view key);
// Returns "µg/g²" for the catalogue's ug/g^2.
std::string unit_text(std::string_view unit);
// A unit in which a number is easy to read, and the factor to it.
struct DisplayUnit {
  double factor = 1.0;
  std::string unit;  // typographic; empty: none
};
// Returns the unit in which a page shows a value: µg for g.
DisplayUnit page_unit(std::string_view unit);
// Returns the unit for errors of a parameter: ppm for a scale factor, µrad for a misalignment. scale: the sensor's scale factor (n22 for n12).
DisplayUnit error_unit(std::string_view key, std::string_view unit, double scale);
// Returns "conditional fail" for conditional_fail, a word of a file.
std::string in_words(std::string_view word);

// Returns the columns that a text takes on a terminal: Chinese, Japanese and Korean characters take two (Unicode Standard Annex 11, wide).
std::size_t columns_of(std::string_view text);
// Breaks a text into lines of at most `columns` (2 or more): at blanks, after a wide character, or within a word that is longer than a line.
std::vector<std::string> wrap(std::string_view text, std::size_t columns);
// Cuts a text to at most `columns` (3 or more); "..." replaces what is cut.
std::string shorten(std::string_view text, std::size_t columns);

// Replaces & < > " ' by entities, control characters by blanks, and bytes that are not UTF-8 by '?'.
std::string html_escape(std::string_view text);

// Returns a path for use in a link: %XX replaces whatever is not a letter, a digit or one of "-._~/:".
std::string url_escape(std::string_view path);

// Formats with three decimals, for numbers near 1 that are compared with one another.
std::string ratio(double value);
// Returns "-69 %", "+3 %", "0 %"; "-" when there is nothing to compare.
std::string percent_change(double before, double after);
// "+12.3", always with its sign.
std::string signed_number(double value, int decimals);

// Return a unit for numbers up to `largest`, which is in SI.
DisplayUnit velocity_unit(double largest_mps);
DisplayUnit acceleration_unit(double largest_mps2);  // µg, mg, g
DisplayUnit rate_unit(double largest_radps);         // °/h, °/s
DisplayUnit angle_unit(double largest_rad);          // ″, mrad

std::string join(const std::vector<std::string>& parts, std::string_view separator = ", ");

}  // namespace turncal
