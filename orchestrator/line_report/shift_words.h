// The sentences and figures that page and terminal of a shift report have in common.
#pragma once

#include <string>

#include "orchestrator/line/shift_report.h"

namespace turncal {

std::string decimals(double value, int digits);
std::string percent(double share);
std::string share_text(const Share& share, bool with_interval);  // "95.0 % (19 of 20; 76.4 .. 99.1 %)"
std::string head_text(const ShiftReport& report);
std::string yield_text(const LineYield& yield);
std::string signals_text(const ShiftReport& report, std::size_t signals);
std::string compared_text(const StationDifference& difference);
std::string differences_text();
std::string no_differences_text(const ShiftReport& report);

}  // namespace turncal
