#include "orchestrator/report/report_page.h"

#include <algorithm>

#include "orchestrator/figures/report_format.h"

namespace turncal {

extern const std::string_view report_page_css;  // report_page.css

namespace {

const char* glyph(Series::Style style) {
  switch (style) {
    case Series::Style::line: return "—";
    case Series::Style::dashed: return "┄";
    case Series::Style::open_circle: return "○";
    case Series::Style::dot: return "●";
    case Series::Style::triangle: return "▲";
    case Series::Style::square: return "■";
  }
  return "";
}

std::string legend(const Figure& figure) {
  std::string html;
  std::vector<std::string> seen;
  for (const Panel& panel : figure.panels)
    for (const Series& series : panel.series) {
      if (series.label.empty() || std::find(seen.begin(), seen.end(), series.label) != seen.end()) continue;
      seen.push_back(series.label);
      html += "<span><i style=\"color:" + std::string(html_colour(series.colour)) + "\">" + glyph(series.style) +
              "</i> " + html_escape(series.label) + "</span>";
    }
  return html.empty() ? "" : "<p class=\"legend\">" + html + "</p>\n";
}

}  // namespace

Page::Page(const std::string& title) {
  html_ =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
      html_escape(title) + "</title>\n<style>" + std::string(report_page_css) + "</style>\n</head>\n<body>\n<main>\n";
}
void Page::section(const std::string& id, const std::string& title) {
  html_ += "<h2 id=\"" + id + "\">" + html_escape(title) + "</h2>\n";
}
void Page::subsection(const std::string& title) { html_ += "<h3>" + html_escape(title) + "</h3>\n"; }
void Page::text(const std::string& plain) { html_ += "<p>" + html_escape(plain) + "</p>\n"; }

Figure Plots::add(Figure figure) {
  if (!figure.panels.empty()) drawings.push_back(draw(figure));
  return figure;
}

void Plots::render_all(const GnuplotOptions& options) {
  if (drawings.empty()) return;
  Result<std::vector<std::string>> rendered = render(drawings, options);
  if (!rendered) {
    problem = rendered.error().message;
    return;
  }
  for (std::size_t k = 0; k < drawings.size(); ++k) svg[drawings[k].id] = (*rendered)[k];
}

std::string Plots::html(const std::string& id, const std::string& legend_html, const std::string& caption) const {
  const auto found = svg.find(id);
  if (found == svg.end()) return "<p class=\"missing\">This plot is missing: " + html_escape(problem) + ".</p>\n";
  return "<figure>\n" + legend_html + found->second + "\n" +
         (caption.empty() ? "" : "<figcaption>" + html_escape(caption) + "</figcaption>\n") + "</figure>\n";
}

std::string Plots::html(const Figure& figure) const { return html(figure.id, legend(figure), figure.caption); }

std::string score_legend() {
  const auto item = [](const char* colour, const char* text) {
    return "<span><i style=\"color:" + std::string(colour) + "\">■</i> " + text + "</span>";
  };
  return "<p class=\"legend\">" + item("#0072B2", "added to the model") +
         item("#E69F00", "above the threshold, not added") + item("#B8B8B8", "below the threshold") + "</p>\n";
}

}  // namespace turncal
