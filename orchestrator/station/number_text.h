// Quantities, words and lines as people read them, and the 24 parameters by name and unit. Files have imu_io/base/text.h instead.
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

// The unit of one of the 24 parameters in a parameter file, as the catalogue would write it; "-": it has none.
const char* parameter_unit(std::string_view key, IncrementKind gyro_increment);
// "gyro x bias" of N01, "accelerometer y towards z" of a23; of what else is judged or charted: "normalised residual" of residual,
// "highest temperature", "hours on the table". What has no other name: the key.
std::string quantity_name(std::string_view key);
// Of the same, in the unit of a parameter file: "deg/h", "g"; empty: none, or the increments decide (n).
std::string quantity_unit(std::string_view key);
// "µg/g²" of the catalogue's ug/g^2.
std::string unit_text(std::string_view unit);
// A unit in which a number is easy to read, and the factor to it.
struct DisplayUnit {
  double factor = 1.0;
  std::string unit;  // typographic; empty: none
};
// Of a value in that unit, on a page: g as µg.
DisplayUnit page_unit(std::string_view unit);
// How errors of a parameter are compared: ppm of a scale factor, µrad of a misalignment. scale: the scale factor of its sensor, n22 of n12.
DisplayUnit error_unit(std::string_view key, std::string_view unit, double scale);
// "conditional fail" of conditional_fail, a word of a file.
std::string in_words(std::string_view word);

// Columns that a text takes on a terminal: a Chinese, Japanese or Korean character has two (Unicode Standard Annex 11, wide).
std::size_t columns_of(std::string_view text);
// Lines of at most so many columns (2 or more), broken at blanks, behind a wide character, or within a word that is longer than a line.
std::vector<std::string> wrap(std::string_view text, std::size_t columns);
// At most so many columns, 3 or more; what is cut is replaced by "...".
std::string shorten(std::string_view text, std::size_t columns);

// & < > " ' replaced; control characters become blanks; bytes that are not UTF-8 become '?'.
std::string html_escape(std::string_view text);

// A path as a link has it: what is neither letter, digit nor one of "-._~/:" as %XX.
std::string url_escape(std::string_view path);

// Three decimals: numbers near 1 that are compared with one another.
std::string ratio(double value);
// "-69 %", "+3 %", "0 %"; "-" when there is nothing to compare.
std::string percent_change(double before, double after);
// "+12.3", always with its sign.
std::string signed_number(double value, int decimals);

// For numbers up to `largest`, in SI.
DisplayUnit velocity_unit(double largest_mps);
DisplayUnit acceleration_unit(double largest_mps2);  // µg, mg, g
DisplayUnit rate_unit(double largest_radps);         // °/h, °/s
DisplayUnit angle_unit(double largest_rad);          // ″, mrad

std::string join(const std::vector<std::string>& parts, std::string_view separator = ", ");

}  // namespace turncal
