// The report of a shift: as a page, in few lines for the terminal, and its tables as CSV.
#pragma once

#include <ostream>
#include <string>

#include "orchestrator/figures/gnuplot.h"
#include "orchestrator/line/shift_report.h"

namespace turncal {

std::string shift_page(const ShiftReport& report, const GnuplotOptions& gnuplot = {});
void print_shift(const ShiftReport& report, std::ostream& out);
std::string shift_csv(const ShiftReport& report);  // table,item,quantity,value: what stands in the page's tables
std::string signals_csv(const ShiftReport& report);

}  // namespace turncal
