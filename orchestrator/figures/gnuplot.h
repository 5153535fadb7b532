// Plots by gnuplot: one process draws all plots of a report, as SVG that can stand inside an HTML page.
//
// It is a filter (piped_program.h), so nothing is written to disk. Every `plot` or
// `multiplot` under `set terminal svg` and without `set output` is one drawing, in the order of the script. gnuplot is
// started without the user's own settings (-d), in the C locale, and is killed at the deadline: whatever it draws, a report
// never waits for it longer than that.
//
// Errors are one line: gnuplot is not there, took too long, stopped with an error (its first line is quoted), or drew another
// number of plots than expected. None of them is a reason to fail a diagnosis: the report then has no plots.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

struct GnuplotOptions {
  std::string program = "gnuplot";  // looked up in PATH when it has no slash
  double deadline_s = 15.0;
};

// The drawings as gnuplot wrote them.
Result<std::vector<std::string>> run_gnuplot(std::string_view script, std::size_t drawings,
                                             const GnuplotOptions& options = {});

// One drawing for an HTML page: only the <svg> element, ids made unique by `id` (letters and digits), fonts left to the page,
// `label` (plain text) for readers that cannot see it, `width` as CSS has it ("50%").
std::string embeddable_svg(std::string_view svg, std::string_view id, std::string_view label, std::string_view width);

}  // namespace turncal
