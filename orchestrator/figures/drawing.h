// Figures as data, and their drawing by gnuplot: one script and one process for all of them, as SVG for use inside an HTML page.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

// gnuplot runs as a filter (child_program.h), without the user's settings, and is killed at the deadline. Every `plot` or `multiplot` under
// `set terminal svg` is one drawing, in the order of the script. Errors are one line: those of the filter, or an unexpected number of
// plots; the report then has no plots.
struct GnuplotOptions {
  std::string program = "gnuplot";  // looked up in PATH when it has no slash
  double deadline_s = 15.0;
};

// Returns the drawings as gnuplot wrote them.
Result<std::vector<std::string>> run_gnuplot(std::string_view script, std::size_t drawings,
                                             const GnuplotOptions& options = {});

// What is drawn, independent of gnuplot.
inline constexpr double no_point = std::numeric_limits<double>::quiet_NaN();  // breaks a line
inline constexpr std::array<const char*, 3> body_names = {"x", "y", "z"};
inline constexpr std::array<const char*, 3> n_names = {"north", "up", "east"};

// Distinguishable with every kind of colour blindness and in grey print (Okabe and Ito, 2008): vermillion, blue; blue, vermillion, bluish
// green; grey.
enum class Colour { before, after, x, y, z, neutral };

struct Series {
  enum class Style { line, dashed, open_circle, dot, triangle, square };
  std::string label = {};  // in the legend; empty: none
  Style style = Style::line;
  Colour colour = Colour::before;
  std::vector<std::pair<double, double>> points = {};  // NaN in either breaks a line
  std::vector<std::string> names = {};                 // shown when the pointer is on a point; empty: its x
};

struct Panel {
  std::string title = {};
  std::string x_label = {}, y_label = {};  // with unit
  std::vector<Series> series = {};
  bool logarithmic = false;  // both axes
  bool angle = false;        // x in degrees: ticks at 30, 45, 90, ...
  double y_limit = 0.0;      // above 0: the frame ends at +- this value
  bool whole_frame = false;  // the frame always has that size, to compare panels
  // Thin lines at x with a short name at the top where there is room.
  std::vector<std::pair<double, std::string>> marks = {};
  bool named_x = false;  // no lines: the names replace the numbers below the axis
  bool empty() const;    // nothing to draw
};

struct Figure {
  std::string id = {};       // letters and digits
  std::string label = {};    // text alternative: what it shows
  std::string caption = {};  // below it
  int columns = 1;
  bool stacked = false;                       // panels above one another with one x axis
  int panel_width = 960, panel_height = 200;  // of one panel, in px of the page
  std::vector<Panel> panels = {};
};

Figure small_panels(std::string id, std::string label, std::string caption = "");  // three to a row

// Returns at most `limit` points that keep the outline: the smallest and the largest of each stretch. Breaks are kept as far
// as there is room for them.
std::vector<std::pair<double, double>> outline(const std::vector<std::pair<double, double>>& points, std::size_t limit);

// A figure in the form for gnuplot.
struct Drawing {
  struct Key {
    const char *colour, *glyph;
    std::string label;
  };
  std::string id;
  std::string label;
  std::string script;                   // from `set terminal` on
  int width = 960;                      // px; 960 is the whole width of the page
  std::vector<std::string> parts = {};  // what each of several drawings side by side shows; width is that of one
  std::vector<Key> legend = {};
  std::string caption = {};
};
// Returns panels side by side as separate drawings, so that a narrow page can stack them; whole: as one, with a legend.
Drawing draw(const Figure& figure, bool whole = false);

// Renders all of them with one gnuplot, for embedding, in order.
Result<std::vector<std::string>> render(const std::vector<Drawing>& drawings, const GnuplotOptions& options);
// Returns the text of a separate file; it is dark when the reader's display is.
Result<std::string> standalone_svg(const Figure& figure, const GnuplotOptions& options = {});

}  // namespace turncal
