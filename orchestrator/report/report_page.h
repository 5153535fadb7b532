// A report page: one self-contained HTML file, and the plots that have their places in it.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "orchestrator/figures/drawing.h"

namespace turncal {

class Page {
 public:
  explicit Page(const std::string& title);
  void section(const std::string& id, const std::string& title);
  void subsection(const std::string& title);
  void text(const std::string& plain);
  void raw(const std::string& html) { html_ += html; }
  std::string finish() { return std::move(html_) + "</main>\n</body>\n</html>\n"; }

 private:
  std::string html_;
};

// Figures by the place they have in the report; what gnuplot made of them comes in later.
struct Plots {
  std::vector<Drawing> drawings;
  std::map<std::string, std::string> svg;  // by id
  std::string problem;

  Figure add(Figure figure);  // drawn unless it is empty
  void render_all(const GnuplotOptions& options);
  std::string html(const std::string& id, const std::string& legend_html, const std::string& caption) const;
  std::string html(const Figure& figure) const;
};

std::string score_legend();

}  // namespace turncal
