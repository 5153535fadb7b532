#include "orchestrator/report/html_table.h"

#include "orchestrator/figures/report_format.h"

namespace turncal::html {
namespace {

std::string row_html(const std::vector<Cell>& cells, const std::string& tag, const std::string& kind) {
  std::string html = kind.empty() ? "<tr>" : "<tr class=\"" + kind + "\">";
  for (const Cell& cell : cells)
    html += "<" + tag + (cell.kind.empty() ? "" : " class=\"" + cell.kind + "\"") + ">" + cell.html + "</" + tag + ">";
  return html + "</tr>\n";
}

}  // namespace

Cell text(std::string_view plain) { return {html_escape(plain), ""}; }
Cell long_text(std::string_view plain) { return {html_escape(plain), "w"}; }
Cell name(std::string_view plain) { return {html_escape(plain), "name"}; }
Cell number(std::string_view plain) { return {html_escape(plain), "n"}; }
Cell number(double value, int digits) { return number(significant(value, digits, Alphabet::typographic)); }

HtmlTable::HtmlTable(const std::vector<Cell>& head) {
  html_ = "<table>\n<thead>" + row_html(head, "th", "") + "</thead>\n<tbody>\n";
}

void HtmlTable::row(const std::vector<Cell>& cells, const std::string& kind) { html_ += row_html(cells, "td", kind); }

std::string paragraph(std::string_view plain, const char* kind) {
  return (kind != nullptr ? "<p class=\"" + std::string(kind) + "\">" : std::string("<p>")) + html_escape(plain) +
         "</p>\n";
}

std::string item(const std::string& html) { return "<li>" + html + "</li>\n"; }

std::string heading(std::string_view plain) { return "<h3>" + html_escape(plain) + "</h3>\n"; }

}  // namespace turncal::html
