#include "orchestrator/report/history_page.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "orchestrator/figures/report_format.h"
#include "orchestrator/records/parameter_history.h"
#include "orchestrator/report/report_page.h"

namespace turncal {

namespace {

using Points = std::vector<std::pair<double, double>>;

struct Group {
  const char* id;
  const char* title;
  std::vector<std::string_view> keys;
};

const std::vector<Group>& groups() {
  static const std::vector<Group> all = {
      {"gyrobias", "Gyro bias, deg/h", {"N01", "N02", "N03"}},
      {"accelbias", "Accelerometer bias, g", {"A01", "A02", "A03"}},
      {"gyroscale", "Gyro scale factor, arcsec/pulse (ratio for a unit that counts in rad)", {"n11", "n22", "n33"}},
      {"gyroinstallation", "Gyro installation errors, as n", {"n12", "n13", "n21", "n23", "n31", "n32"}},
      {"accelscale", "Accelerometer scale factor, ratio to the nominal pulse", {"a11", "a22", "a33"}},
      {"accelinstallation", "Accelerometer installation errors, as a", {"a12", "a13", "a23"}}};
  return all;
}

// Points run from 1; all ordinates are less the mean, which stands in the title.
Panel panel_of(const ParameterHistory& history) {
  const ControlChart& chart = history.chart;
  const double last = static_cast<double>(history.values.size()) + 0.5;
  const auto level = [&](std::optional<double> value) {
    return value ? Points{{0.5, *value - chart.mean}, {last, *value - chart.mean}} : Points{};
  };
  Points inside, outside, bars;
  for (std::size_t i = 0; i < history.values.size(); ++i) {
    const double x = static_cast<double>(i + 1), y = history.values[i] - chart.mean;
    const bool out = std::find(chart.outside.begin(), chart.outside.end(), i) != chart.outside.end();
    (out ? outside : inside).emplace_back(x, y);
    if (const std::optional<double>& sigma = history.sigmas[i]) {
      for (const double end : {y - *sigma, y + *sigma, no_point}) bars.emplace_back(x, end);
    }
  }
  Panel panel;
  panel.title =
      history.key + " less " + significant(chart.mean, 7) + (chart.cpk ? ", Cpk " + significant(*chart.cpk, 3) : "");
  panel.x_label = "calibration";
  using Style = ::turncal::Series::Style;
  const auto add = [&panel](const char* label, Style style, Colour colour, Points points) {
    if (!points.empty()) panel.series.push_back({label, style, colour, std::move(points)});
  };
  add("one calibration", Style::dot, Colour::after, std::move(inside));
  add("one sigma", Style::line, Colour::after, std::move(bars));
  add("outside the control limits", Style::square, Colour::before, std::move(outside));
  add("control limits: mean ± 3 s of the moving range", Style::dashed, Colour::neutral, level(chart.lower));
  add("", Style::dashed, Colour::neutral, level(chart.upper));
  add("limit in force", Style::line, Colour::before, level(history.limit.min));
  add("limit in force", Style::line, Colour::before, level(history.limit.max));
  return panel;
}

std::string cell(const std::string& text) { return "<td class=\"n\">" + html_escape(text) + "</td>"; }
std::string cell(std::optional<double> value, int digits) { return cell(value ? significant(*value, digits) : "-"); }

std::string control_table(const std::vector<ParameterHistory>& histories) {
  std::string html =
      "<table>\n<thead><tr><th></th><th class=\"n\">n</th><th class=\"n\">mean</th><th class=\"n\">s</th><th "
      "class=\"n\">lower "
      "control limit</th><th class=\"n\">upper</th><th class=\"n\">outside</th><th class=\"n\">lower limit in "
      "force</th>"
      "<th class=\"n\">upper</th><th class=\"n\">Cpk</th></tr></thead>\n<tbody>\n";
  for (const ParameterHistory& h : histories) {
    const bool hit = !h.chart.outside.empty() || (h.chart.cpk && *h.chart.cpk < 1.0);
    html += std::string(hit ? "<tr class=\"hit\">" : "<tr>") + "<td class=\"name\">" + h.key + "</td>" +
            cell(std::to_string(h.chart.count)) + cell(h.chart.mean, 8) + cell(h.chart.sigma, 3) +
            cell(h.chart.lower, 8) + cell(h.chart.upper, 8) + cell(std::to_string(h.chart.outside.size())) +
            cell(h.limit.min, 8) + cell(h.limit.max, 8) + cell(h.chart.cpk, 3) + "</tr>\n";
  }
  return html +
         "</tbody>\n</table>\n<p class=\"soft\">Bold: a calibration outside the control limits, or Cpk below 1.</p>\n";
}

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
  std::vector<ParameterHistory> histories;
  for (const std::string_view key : free_parameter_keys()) histories.push_back(parameter_history(all, key));
  Plots plots;
  std::vector<Figure> figures;
  for (const Group& group : groups()) {
    Figure figure{.id = group.id,
                  .label = group.title,
                  .caption = "",
                  .columns = 3,
                  .panel_width = 320,
                  .panel_height = 220,
                  .panels = {}};
    for (const ParameterHistory& history : histories) {
      const bool here = std::find(group.keys.begin(), group.keys.end(), history.key) != group.keys.end();
      if (here && !history.values.empty()) figure.panels.push_back(panel_of(history));
    }
    figures.push_back(plots.add(std::move(figure)));
  }
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
      if (figure.panels.empty()) continue;
      page.subsection(figure.label);
      page.raw(plots.html(figure));
    }
    page.section("calibrations", "Calibrations");
    page.raw(calibration_table(all));
  }
  return page.finish();
}

}  // namespace turncal
