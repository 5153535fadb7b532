#include "orchestrator/line_report/history_page.h"

#include "orchestrator/figures/report_format.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line_report/control_panel.h"
#include "orchestrator/report/report_page.h"

namespace turncal {

namespace {

std::string cell(const std::string& text) { return "<td class=\"n\">" + html_escape(text) + "</td>"; }

std::string calibration_table(const std::vector<StoredCalibration>& all) {
  std::string html =
      "<table>\n<thead><tr><th class=\"n\">calibration</th><th class=\"n\">id</th><th>unit</th><th>time</th>"
      "<th>verdict</th><th>operator</th><th>station</th></tr></thead>\n<tbody>\n";
  for (std::size_t i = 0; i < all.size(); ++i) {
    const StoredCalibration& c = all[i];
    html += "<tr>" + cell(std::to_string(i + 1)) + cell(std::to_string(c.id));
    for (const std::string* text : {&c.unit, &c.time_utc, &c.verdict, &c.operator_name, &c.station}) {
      html += "<td>" + html_escape(*text) + "</td>";
    }
    html += "</tr>\n";
  }
  return html + "</tbody>\n</table>\n";
}

}  // namespace

std::string history_page(const std::vector<StoredCalibration>& all, const std::string& source,
                         const GnuplotOptions& gnuplot) {
  std::vector<ChartedQuantity> histories;
  for (const std::string_view key : free_parameter_keys()) histories.push_back(parameter_history(all, key));
  Plots plots;
  std::vector<Figure> figures;
  for (const Figure& figure : control_figures(histories)) figures.push_back(plots.add(figure));
  plots.render_all(gnuplot);

  const bool simulated = !all.empty() && all.front().simulated;
  Page page("turncal: control charts of " + source);
  page.raw("<h1>Control charts</h1>\n<p class=\"soft\">" + html_escape(source) + ", " + std::to_string(all.size()) +
           " calibrations" + (simulated ? " of simulated units" : "") + "</p>\n");
  if (all.empty()) page.text("No calibration is on record.");
  if (!all.empty()) {
    page.section("control", "Parameters");
    page.raw(control_table(histories));
    for (const Figure& figure : figures) {
      page.subsection(figure.label);
      page.raw(plots.html(figure));
    }
    page.section("calibrations", "Calibrations");
    page.raw(calibration_table(all));
  }
  return page.finish();
}

}  // namespace turncal
