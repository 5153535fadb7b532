// Figures as data: what is drawn, before anybody thinks about gnuplot. diagnosis_figures.h makes them, drawing.h draws them.
#pragma once

#include <array>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace turncal {

inline constexpr double no_point = std::numeric_limits<double>::quiet_NaN();  // breaks a line
inline constexpr std::array<const char*, 3> body_names = {"x", "y", "z"};
inline constexpr std::array<const char*, 3> n_names = {"north", "up", "east"};

// Distinguishable with every kind of colour blindness and in grey print (Okabe and Ito, 2008).
enum class Colour { before, after, x, y, z, neutral };
const char* html_colour(Colour colour);

struct Series {
  enum class Style { line, dashed, open_circle, dot, triangle, square };
  std::string label;  // of the legend; empty: none
  Style style = Style::line;
  Colour colour = Colour::before;
  std::vector<std::pair<double, double>> points;  // NaN in either breaks a line
};

struct Panel {
  std::string title;
  std::string x_label, y_label;  // with unit
  std::vector<Series> series;
  bool logarithmic = false;  // both axes
  bool legend = false;       // the names of its series stand in it, for a drawing without a page around it
  bool angle = false;        // x in degrees: ticks at 30, 45, 90, ...
  double y_limit = 0.0;      // above 0: the frame ends at +- this
  bool whole_frame = false;  // and is as large as that whatever is in it: panels that are compared
  std::vector<std::pair<double, std::string>>
      marks;           // x and a short name: thin lines, named at the top where there is room
  bool empty() const;  // nothing to draw
};

struct Figure {
  std::string id;       // letters and digits
  std::string label;    // what it shows, for those who cannot see it
  std::string caption;  // below it
  int columns = 1;
  bool stacked = false;                       // panels over one another that share their x axis
  int panel_width = 960, panel_height = 200;  // of one panel, in px of the page
  std::vector<Panel> panels;
};

// At most `limit` points that keep the outline: the smallest and the largest of each stretch. Breaks stay where they are as far
// as there is room for them.
std::vector<std::pair<double, double>> outline(const std::vector<std::pair<double, double>>& points, std::size_t limit);

}  // namespace turncal
