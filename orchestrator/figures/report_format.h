// Texts as people read them, for the report and the terminal; numbers and units: number_text.h.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/station/number_text.h"

namespace turncal {

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
// 1:45:42
std::string clock_time(double seconds);

// For numbers up to `largest`, in SI.
DisplayUnit velocity_unit(double largest_mps);
DisplayUnit acceleration_unit(double largest_mps2);  // µg, mg, g
DisplayUnit rate_unit(double largest_radps);         // °/h, °/s
DisplayUnit angle_unit(double largest_rad);          // ″, mrad

std::string join(const std::vector<std::string>& parts, std::string_view separator = ", ");

}  // namespace turncal
