// Tables and paragraphs of a report, as HTML.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/figures/report_format.h"

namespace turncal::html {

inline constexpr Alphabet typo = Alphabet::typographic;

// Cells are HTML already; the class says how they are set: "n" numbers, "name" keys, "w" text that may be broken, "" text.
struct Cell {
  std::string html;
  std::string kind;
};
Cell text(std::string_view plain);
Cell long_text(std::string_view plain);
Cell name(std::string_view plain);
Cell number(std::string_view plain);
Cell number(double value, int digits = 3);

class HtmlTable {
 public:
  explicit HtmlTable(const std::vector<Cell>& head);
  void row(const std::vector<Cell>& cells, const std::string& kind = "");
  std::string finish() const { return html_ + "</tbody>\n</table>\n"; }

 private:
  std::string html_;
};

std::string paragraph(std::string_view plain, const char* kind = nullptr);
std::string item(const std::string& html);  // of a list
std::string heading(std::string_view plain);

}  // namespace turncal::html
