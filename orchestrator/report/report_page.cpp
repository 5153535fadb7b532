#include "orchestrator/report/report_page.h"

#include <algorithm>

#include "orchestrator/report/report_format.h"

namespace turncal {
namespace {

constexpr const char* style_sheet = R"(
:root { --ink:#222; --soft:#5c5c5c; --line:#d9d9d9; --paper:#fff; --before:#D55E00; --after:#0072B2; }
* { box-sizing:border-box; }
body { margin:0; background:#f3f3f1; color:var(--ink); font:15px/1.45 "Helvetica Neue",Helvetica,Arial,"Liberation Sans","DejaVu Sans",sans-serif; }
main { max-width:1040px; margin:0 auto; padding:28px 40px 48px; background:var(--paper); }
h1 { font-size:24px; margin:0 0 4px; }
h2 { font-size:18px; margin:34px 0 8px; padding-top:10px; border-top:1px solid var(--line); }
h3 { font-size:15px; margin:20px 0 6px; }
p { margin:6px 0; max-width:78ch; }
.soft, figcaption { color:var(--soft); font-size:13px; }
p.soft { max-width:none; }
.verdict { margin:18px 0 8px; padding:14px 18px; border-left:8px solid; background:#f6f6f4; font-size:17px; }
.verdict p { max-width:none; margin:0; }
.clean { border-color:#009E73; } .extended { border-color:#0072B2; } .unexplained { border-color:#D55E00; } .noise_model { border-color:#E69F00; }
table { border-collapse:collapse; max-width:100%; font-size:13.5px; margin:8px 0; font-variant-numeric:tabular-nums; }
th, td { padding:3px 12px 3px 0; text-align:left; vertical-align:baseline; border-bottom:1px solid #ececec; white-space:nowrap; }
td.w { white-space:normal; }
thead th { border-bottom:1.5px solid #999; color:var(--soft); font-weight:600; }
td.n, th.n { text-align:right; }
td.name { font-family:ui-monospace,"DejaVu Sans Mono",Menlo,Consolas,monospace; font-size:12.5px; }
tr.hit td { font-weight:600; }
tr.dim td { color:#8a8a8a; }
.big { font-size:20px; font-weight:600; }
.bar { display:inline-block; height:9px; background:var(--after); vertical-align:middle; }
td.half { width:74px; min-width:74px; padding:3px 0; border-bottom:1px solid #ececec; }
td.half.left { text-align:right; border-right:1px solid #777; }
figure { margin:10px 0 4px; }
figure svg { display:block; height:auto; }
.legend { font-size:13px; margin:8px 0 0; }
.legend span { margin-right:22px; white-space:nowrap; }
.legend i { display:inline-block; width:14px; font-style:normal; text-align:center; }
.missing { border:1px dashed #aaa; padding:10px 14px; color:var(--soft); }
ul { margin:6px 0; padding-left:20px; }
li { margin:2px 0; }
.columns { columns:2; column-gap:36px; }
@media screen and (max-width:700px) {
  main { padding:16px 14px 32px; } .columns { columns:1; }
  table { display:block; overflow-x:auto; }
  figure { overflow-x:auto; } .verdict { padding:10px 12px; }
  h1, p, li { overflow-wrap:anywhere; }
}
@media print {
  body { background:#fff; font-size:9.5pt; }
  table { font-size:8pt; } td.name { font-size:7.5pt; } .soft, figcaption, .legend { font-size:8pt; } .verdict { font-size:11pt; } .big { font-size:12pt; }
  th, td { padding-right:8px; } .bar { height:7px; }
  main { max-width:none; padding:0; }
  h2 { break-after:avoid; } h3 { break-after:avoid; }
  figure, table, tr, .verdict { break-inside:avoid; }
  thead { display:table-header-group; }
  * { -webkit-print-color-adjust:exact; print-color-adjust:exact; }
  @page { size:A4; margin:16mm 14mm; }
}
)";

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
      html_escape(title) + "</title>\n<style>" + style_sheet + "</style>\n</head>\n<body>\n<main>\n";
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
  Result<std::vector<std::string>> made = render(drawings, options);
  if (!made) {
    problem = made.error().message;
    return;
  }
  for (std::size_t k = 0; k < drawings.size(); ++k) svg[drawings[k].id] = (*made)[k];
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
