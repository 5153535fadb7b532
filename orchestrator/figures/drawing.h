// Figures into gnuplot's language, one script for all of them.
#pragma once

#include <string>
#include <vector>

#include "orchestrator/figures/gnuplot.h"
#include "orchestrator/figures/report_figure.h"

namespace turncal {

// A drawing: a Figure, or the score chart.
struct Drawing {
  struct Key {
    const char *colour, *glyph;
    std::string label;
  };
  std::string id;
  std::string label;
  std::string script;  // from `set terminal` on
  int width = 960;     // px; 960 is the whole width of the page
  std::vector<Key> legend = {};
  std::string caption = {};
};
Drawing draw(const Figure& figure);

// Pieces of a script: where a drawing begins, and a text in single quotes (only our own labels and catalogue names come here).
inline constexpr const char* drawing_ink = "#333333";
std::string gnuplot_terminal(int width, int height);
std::string gnuplot_text(const std::string& text);

// All of them by one gnuplot, embeddable, in order.
Result<std::vector<std::string>> render(const std::vector<Drawing>& drawings, const GnuplotOptions& options);

}  // namespace turncal
