#include "orchestrator/line_report/shift_page.h"

#include "orchestrator/figures/report_format.h"
#include "orchestrator/line_report/control_panel.h"
#include "orchestrator/line_report/shift_words.h"
#include "orchestrator/report/html_table.h"
#include "orchestrator/report/report_page.h"

namespace turncal {

namespace {

using html::Cell;

std::string yield_table(const ShiftReport& report) {
  html::HtmlTable table({html::text("station"), html::number("attempts"), html::number("units"),
                         html::number("first pass yield (95 %)"), html::number("final yield"), html::number("hours"),
                         html::number("lost"), html::number("hours a good unit"), html::number("mean residual")});
  const auto row = [&table](const std::string& name, const LineYield& y, const StationFigures* of) {
    table.row(
        {html::name(name), html::number(std::to_string(y.attempts)), html::number(std::to_string(y.units)),
         html::number(share_text(y.first_pass, true)), html::number(share_text(y.final_pass, false)),
         html::number(decimals(y.hours, 1)), html::number(decimals(y.hours_lost, 1)),
         html::number(y.final_pass.part > 0 ? decimals(y.hours / static_cast<double>(y.final_pass.part), 2) : "-"),
         html::number(of && of->calibrated > 0 ? decimals(of->mean_residual, 3) : "-")},
        of ? "" : "hit");
  };
  for (const StationFigures& station : report.stations) row(station.station, station.yield, &station);
  if (report.stations.size() != 1) row("all", report.yield, nullptr);
  return table.finish();
}

std::string pareto_table(const LineYield& yield) {
  html::HtmlTable table({html::text("reason"), html::number("attempts"), html::text(""), html::number("share"),
                         html::number("cumulated"), html::number("hours"), html::text("last unit")});
  constexpr double widest_px = 160.0;
  const double most = static_cast<double>(yield.reasons.front().attempts);
  for (const LossReason& reason : yield.reasons) {
    const double width = widest_px * static_cast<double>(reason.attempts) / most;
    table.row({html::long_text(reason.reason), html::number(std::to_string(reason.attempts)),
               Cell{"<span class=\"bar\" style=\"width:" + decimals(width, 0) + "px\"></span>", ""},
               html::number(percent(reason.share)), html::number(percent(reason.cumulated)),
               html::number(decimals(reason.hours, 1)), html::name(reason.last_unit)});
  }
  return table.finish();
}

std::string signal_table(const std::vector<ChartSignal>& signals) {
  html::HtmlTable table({html::text("time"), html::text("unit"), html::text("chart"), html::number("point"),
                         html::number("value"), html::number("rule"), html::text("what was seen")});
  for (const ChartSignal& s : signals) {
    const std::size_t i = s.signal.point;
    table.row({html::text(s.chart->times[i]), html::name(s.chart->units[i]), html::name(s.chart->key),
               html::number(std::to_string(i + 1)), html::number(significant(s.chart->values[i], 7)),
               html::number(std::to_string(s.signal.rule)), html::text(run_rules[s.signal.rule - 1].words)},
              s.signal.rule == 1 ? "hit" : "");
  }
  return table.finish();
}

std::string repeatability_table(const std::vector<Repeatability>& all) {
  html::HtmlTable table({html::text(""), html::number("pairs"), html::number("s (95 %)"),
                         html::number("of that the calibration"), html::number("left for the unit")});
  for (const Repeatability& r : all)
    table.row(
        {html::name(r.key), html::number(std::to_string(r.pairs)),
         html::number(significant(r.spread, 3) + " (" + significant(r.low, 3) + " .. " + significant(r.high, 3) + ")"),
         html::number(significant(r.calibration_sigma, 3)),
         html::number(r.of_unit() ? significant(*r.of_unit(), 3) : "-")});
  return table.finish();
}

std::string difference_table(const std::vector<StationDifference>& all) {
  html::HtmlTable table({html::text("stations"), html::text(""), html::text("compared"), html::number("difference"),
                         html::number("sigma"), html::number("in sigmas"), html::number("drift in 30 days"),
                         html::number("sigma")});
  for (const StationDifference& d : all)
    table.row({html::text(d.b + " - " + d.a), html::name(d.key), html::text(compared_text(d)),
               html::number(significant(d.difference, 3)), html::number(significant(d.sigma, 3)),
               html::number(d.sigma > 0.0 ? decimals(d.difference / d.sigma, 1) : "-"),
               html::number(d.drift ? significant(*d.drift, 3) : "-"),
               html::number(d.drift_sigma ? significant(*d.drift_sigma, 3) : "-")},
              d.stands_out() || d.drifts() ? "hit" : "");
  return table.finish();
}

std::string rule_table() {
  html::HtmlTable table({html::number("rule"), html::text("a signal"), html::number("false alarms a 1000 points")});
  for (std::size_t i = 0; i < run_rules.size(); ++i)
    table.row({html::number(std::to_string(i + 1)), html::text(run_rules[i].words),
               html::number(significant(1000.0 * run_rules[i].false_alarm, 3))});
  return table.finish();
}

void add_charts(const ShiftReport& report, Page& page, const GnuplotOptions& gnuplot) {
  Plots plots;
  std::vector<Figure> figures;
  for (const Figure& figure : control_figures(report.charts)) figures.push_back(plots.add(figure));
  plots.render_all(gnuplot);
  page.section("charts", "Control charts");
  page.raw(control_table(report.charts));
  for (const Figure& figure : figures) {
    page.subsection(figure.label);
    page.raw(plots.html(figure));
  }
  const std::vector<ChartSignal> signals = signals_of(report.charts);
  page.section("signals", "Signals of the run rules");
  page.raw(html::paragraph(signals_text(report, signals.size()), "soft"));
  constexpr std::size_t most = 60;
  const std::size_t left_out = signals.size() > most ? signals.size() - most : 0;
  if (left_out > 0)
    page.raw(html::paragraph("The " + std::to_string(left_out) + " before these stand in signals.csv.", "soft"));
  if (!signals.empty())
    page.raw(signal_table({signals.begin() + static_cast<std::ptrdiff_t>(left_out), signals.end()}));
  page.raw(rule_table());
}

}  // namespace

std::string shift_page(const ShiftReport& report, const GnuplotOptions& gnuplot) {
  Page page("turncal: shift report of " + report.source);
  page.raw("<h1>Shift report</h1>\n" + html::paragraph(head_text(report), "soft"));
  if (report.attempts.empty()) {
    page.text("No attempt is on record.");
    return page.finish();
  }
  page.raw("<div class=\"verdict " + std::string(report.yield.reasons.empty() ? "clean" : "extended") + "\">" +
           html::paragraph(yield_text(report.yield)) + "</div>\n");
  page.section("yield", "Yield and hours");
  page.raw(yield_table(report));
  page.section("reasons", "Why attempts did not pass");
  if (report.yield.reasons.empty())
    page.text("Every attempt that was judged passed.");
  else
    page.raw(pareto_table(report.yield));
  if (!report.calibrations.empty()) add_charts(report, page, gnuplot);
  page.section("stations", "Stations against each other");
  if (report.differences.empty())
    page.text(no_differences_text(report));
  else
    page.raw(difference_table(report.differences) + html::paragraph(differences_text(), "soft"));
  page.section("repeatability", "Repeatability");
  for (const auto& [title, list] : {std::pair{"Turn-on: pairs up to 3 days apart", &report.turn_on},
                                    std::pair{"Month to month: pairs 20 to 45 days apart", &report.month}}) {
    page.subsection(title);
    if (list->empty())
      page.text("No unit was calibrated twice at such an interval at one station.");
    else
      page.raw(repeatability_table(*list));
  }
  return page.finish();
}

}  // namespace turncal
