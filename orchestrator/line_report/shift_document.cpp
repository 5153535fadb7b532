#include "orchestrator/line_report/shift_document.h"

#include <fmt/format.h>

#include <algorithm>

#include "imu_io/base/data_text.h"
#include "orchestrator/line_report/history_document.h"

namespace turncal {
namespace {

using namespace cell;
using Emphasis = Table::Emphasis;

std::string percent(double share) { return fmt::format("{:.1f} %", 100.0 * share); }

// "95.0 % (19 of 20; 76.4 .. 99.1 %)"
Cell share(const Share& share, bool with_interval) {
  if (share.all == 0) return number("-");
  const auto [low, high] = share.interval();
  const std::string interval = with_interval ? fmt::format("; {:.1f} .. {}", 100.0 * low, percent(high)) : "";
  return number(fmt::format("{} ({} of {}{})", percent(share.value()), share.part, share.all, interval), share.value());
}

std::string head_text(const ShiftReport& report) {
  std::string text = report.source;
  if (!report.attempts.empty())
    text += "; from " + report.attempts.front().time_utc + " to " + report.attempts.back().time_utc;
  if (report.simulated) text += "; simulated units";
  if (report.of_the_other_kind > 0)
    text += fmt::format("; attempts of {} units left out: {}", report.simulated ? "real" : "simulated",
                        report.of_the_other_kind);
  if (report.damaged > 0) text += fmt::format("; damaged rows left out: {}", report.damaged);
  return text;
}

std::string yield_text(const LineYield& yield) {
  std::string text = fmt::format("First pass {}, in the end {}; {} attempts, {:.1f} h on the table",
                                 share(yield.first_pass, true).words, share(yield.final_pass, false).words,
                                 yield.attempts, yield.hours);
  if (yield.hours_lost > 0.0) text += fmt::format(", {:.1f} h of them without a good unit", yield.hours_lost);
  if (yield.running > 0) text += fmt::format("; {} going on, or never ended", yield.running);
  return text + ".";
}

std::string signals_text(const ShiftReport& report, std::size_t signals) {
  double expected = 0.0;
  std::size_t points = 0;  // with a signal, rule by rule: what is expected counts these, not stretches of them
  for (const ChartedQuantity& chart : report.charts) {
    if (chart.chart.sigma.value_or(0.0) <= 0.0) continue;
    points += chart.chart.signals.size();
    for (const RunRule& rule : run_rules)
      if (chart.chart.count >= rule.stretch)
        expected += rule.false_alarm * static_cast<double>(chart.chart.count - rule.stretch + 1);
  }
  return fmt::format(
      "{} signals, of {} points. With nothing wrong at all about {:.0f} points would give one: look for several "
      "charts, or several "
      "rules, at one time.",
      signals, points, expected);
}

Table yield_table(const ShiftReport& report) {
  Table table{{text("station"), number("attempts"), number("units"), number("first pass yield (95 %)"),
               number("final yield"), number("hours"), number("lost"), number("hours a good unit"),
               number("mean residual")}};
  const auto row = [&table](const std::string& station, const LineYield& y, const StationFigures* of) {
    const auto good = static_cast<double>(y.final_pass.part);
    table.row({name(station), count(y.attempts), count(y.units), share(y.first_pass, true), share(y.final_pass, false),
               fixed(y.hours, 1), fixed(y.hours_lost, 1), good > 0.0 ? fixed(y.hours / good, 2) : number("-"),
               of && of->calibrated > 0 ? fixed(of->mean_residual, 3) : number("-")},
              of ? Emphasis::none : Emphasis::hit);
  };
  for (const StationFigures& station : report.stations) row(station.station, station.yield, &station);
  if (report.stations.size() != 1) row("all", report.yield, nullptr);
  return table;
}

Table pareto_table(const LineYield& yield) {
  Table table{{wide("reason"), number("attempts"), bar(0.0), number("share"), number("cumulated"), number("hours"),
               name("last unit")}};
  const auto most = static_cast<double>(yield.reasons.front().attempts);
  for (const LossReason& reason : yield.reasons)
    table.row({wide(reason.reason), count(reason.attempts), bar(static_cast<double>(reason.attempts) / most),
               number(percent(reason.share), reason.share), number(percent(reason.cumulated), reason.cumulated),
               fixed(reason.hours, 1), name(reason.last_unit)});
  return table;
}

Table signal_table(const std::vector<ChartSignal>& signals) {
  Table table{{text("time"), name("unit"), name("chart"), number("point"), number("value"), number("rule"),
               text("what was seen")}};
  table.most = 20;
  for (const ChartSignal& s : signals) {
    const std::size_t i = s.signal.point;
    table.row({text(s.chart->times[i]), name(s.chart->units[i]), name(s.chart->key), count(i + 1),
               number(s.chart->values[i], 7), count(s.signal.rule), text(run_rules[s.signal.rule - 1].words)},
              s.signal.rule == 1 ? Emphasis::hit : Emphasis::none);
  }
  return table;
}

Table rule_table() {
  Table table{{number("rule"), text("a signal"), number("false alarms a 1000 points")}};
  for (std::size_t i = 0; i < run_rules.size(); ++i)
    table.row({count(i + 1), text(run_rules[i].words), number(1000.0 * run_rules[i].false_alarm)});
  return table;
}

Table repeatability_table(const std::vector<Repeatability>& all) {
  Table table{{name("parameter"), number("pairs"), number("s"), text("95 %"), number("of that the calibration"),
               number("left for the unit")}};
  for (const Repeatability& r : all)
    table.row({name(r.key), count(r.pairs), number(r.spread), text(number(r.low).words + " .. " + number(r.high).words),
               number(r.calibration_sigma), r.of_unit() ? number(*r.of_unit()) : number("-")});
  return table;
}

Table difference_table(const std::vector<StationDifference>& all) {
  Table table{{text("stations"), name("parameter"), text("compared"), number("difference"), number("sigma"),
               number("in sigmas"), number("drift in 30 days"), number("its sigma")}};
  for (const StationDifference& d : all) {
    const std::string units = d.of_the_same_units ? fmt::format("{} units at both", d.count_a)
                                                  : fmt::format("{} units against {}", d.count_b, d.count_a);
    table.row({text(d.b + " - " + d.a), name(d.key), text(units), number(d.difference), number(d.sigma),
               d.sigma > 0.0 ? fixed(d.difference / d.sigma, 1) : number("-"), d.drift ? number(*d.drift) : number("-"),
               d.drift_sigma ? number(*d.drift_sigma) : number("-")},
              d.stands_out() || d.drifts() ? Emphasis::hit : Emphasis::none);
  }
  return table;
}

void add_charts(const ShiftReport& report, Document& document) {
  document.section("charts", "Control charts");
  add_control_charts(report.charts, document);
  const std::vector<ChartSignal> signals = signals_of(report.charts);
  document.section("signals", "Signals of the run rules");
  document.soft(signals_text(report, signals.size()), Scope::all);
  constexpr std::size_t most = 60;
  const std::size_t left_out = signals.size() - std::min(signals.size(), most);
  if (left_out > 0) document.soft(fmt::format("The {} before these stand in signals.csv.", left_out), Scope::all);
  if (!signals.empty())
    document.add(signal_table({signals.begin() + static_cast<std::ptrdiff_t>(left_out), signals.end()}));
  document.add(rule_table(), Scope::page);
}

}  // namespace

Document shift_document(const ShiftReport& report) {
  Document document{"turncal: shift report of " + report.source, "Shift report"};
  document.soft(head_text(report), Scope::all);
  document.add(
      Paragraph{yield_text(report.yield), report.yield.reasons.empty() ? "verdict clean" : "verdict extended"});
  if (report.attempts.empty()) {
    document.text("No attempt is on record.");
    if (report.of_the_other_kind > 0)
      document.add(Paragraph{report.simulated ? "Without --simulated it is of the real units."
                                              : "With --simulated it is of the dry runs."},
                   Scope::terminal);
    return document;
  }
  document.section("yield", "Yield and hours");
  document.add(yield_table(report));
  document.section("reasons", "Why attempts did not pass");
  if (report.yield.reasons.empty())
    document.text("Every attempt that was judged passed.");
  else
    document.add(pareto_table(report.yield));
  if (!report.calibrations.empty()) add_charts(report, document);
  document.section("stations", "Stations against each other");
  if (report.differences.empty()) {
    document.text(report.stations.size() < 2
                      ? "There is one station."
                      : fmt::format("Too few units: expected {} at both stations, or at each.", least_units));
  } else {
    document.add(difference_table(report.differences));
    document.soft(
        "Bold: beyond 3.04 sigma, by which one of 21 parameters goes in 5 % of the reports of equal stations.");
  }
  document.section("repeatability", "Repeatability");
  for (const auto& [title, list] : {std::pair{"Turn-on: pairs up to 3 days apart", &report.turn_on},
                                    std::pair{"Month to month: pairs 20 to 45 days apart", &report.month}}) {
    document.subsection(title);
    if (list->empty())
      document.text("No unit was calibrated twice at such an interval at one station.");
    else
      document.add(repeatability_table(*list));
  }
  return document;
}

std::string shift_csv(const ShiftReport& report) {
  DataTable text({"table", "item", "quantity", "value"});
  const auto add = [&text](const char* table, const std::string& item, const char* quantity, double value) {
    text.begin_row();
    for (const std::string_view word : {std::string_view(table), std::string_view(item), std::string_view(quantity)})
      text.text(word);
    text.number(value);
  };
  const auto yield = [&add](const std::string& station, const LineYield& y) {
    add("yield", station, "attempts", static_cast<double>(y.attempts));
    add("yield", station, "units", static_cast<double>(y.units));
    add("yield", station, "first_pass", static_cast<double>(y.first_pass.part));
    add("yield", station, "first_pass_of", static_cast<double>(y.first_pass.all));
    add("yield", station, "final_pass", static_cast<double>(y.final_pass.part));
    add("yield", station, "final_pass_of", static_cast<double>(y.final_pass.all));
    add("yield", station, "hours", y.hours);
    add("yield", station, "hours_lost", y.hours_lost);
  };
  yield("all", report.yield);
  for (const StationFigures& station : report.stations) yield(station.station, station.yield);
  for (const LossReason& reason : report.yield.reasons)
    add("reason", reason.reason, "attempts", static_cast<double>(reason.attempts));
  for (const ChartedQuantity& q : report.charts) {
    if (q.chart.count == 0) continue;
    add("chart", q.key, "n", static_cast<double>(q.chart.count));
    add("chart", q.key, "mean", q.chart.mean);
    if (q.chart.sigma) add("chart", q.key, "s", *q.chart.sigma);
    for (const auto& [name, index] : {std::pair{"cpk", &q.chart.cpk}, std::pair{"ppk", &q.chart.ppk}})
      if (*index) add("chart", q.key, name, (*index)->value);
  }
  for (const auto& [name, list] : {std::pair{"turn_on", &report.turn_on}, std::pair{"month_to_month", &report.month}}) {
    for (const Repeatability& r : *list) {
      add(name, r.key, "pairs", static_cast<double>(r.pairs));
      add(name, r.key, "s", r.spread);
      add(name, r.key, "calibration_sigma", r.calibration_sigma);
    }
  }
  for (const StationDifference& d : report.differences) {
    const std::string item = d.b + " - " + d.a + " " + d.key;
    add("stations", item, "difference", d.difference);
    add("stations", item, "sigma", d.sigma);
  }
  return text.csv();
}

std::string signals_csv(const ShiftReport& report) {
  DataTable text({"time_utc", "unit", "chart", "point", "value", "rule", "words"});
  for (const ChartSignal& s : signals_of(report.charts)) {
    const std::size_t i = s.signal.point;
    text.begin_row();
    for (const std::string* word : {&s.chart->times[i], &s.chart->units[i], &s.chart->key}) text.text(*word);
    text.count(static_cast<std::int64_t>(i) + 1);
    text.number(s.chart->values[i]);
    text.count(s.signal.rule);
    text.text(run_rules[s.signal.rule - 1].words);
  }
  return text.csv();
}

}  // namespace turncal
