// A shift report on the terminal, and its tables as CSV.
#include <cstdio>

#include "imu_io/base/data_text.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/line_report/shift_page.h"
#include "orchestrator/line_report/shift_words.h"

namespace turncal {

namespace {

void print_stations(const ShiftReport& report, std::ostream& out) {
  print_line(out, "\n%-16s %8s  %-38s %-26s %8s %6s", "station", "attempts", "first pass", "in the end", "hours",
             "lost");
  for (const StationFigures& s : report.stations)
    print_line(out, "%-16s %8zu  %-38s %-26s %8.1f %6.1f", s.station.c_str(), s.yield.attempts,
               share_text(s.yield.first_pass, true).c_str(), share_text(s.yield.final_pass, false).c_str(),
               s.yield.hours, s.yield.hours_lost);
}

void print_reasons(const LineYield& yield, std::ostream& out) {
  print_line(out, "\n%-60s %8s %10s %6s  %s", "reason", "attempts", "cumulated", "hours", "last unit");
  for (const LossReason& r : yield.reasons)
    print_line(out, "%-60s %8zu %10s %6.1f  %s", shorten(r.reason, 60).c_str(), r.attempts,
               percent(r.cumulated).c_str(), r.hours, r.last_unit.c_str());
}

void print_repeatability(const char* title, const std::vector<Repeatability>& all, std::ostream& out) {
  for (const Repeatability& r : all) {
    if (&r == &all.front()) print_line(out, "\n%-16s %6s %10s %22s %12s", title, "pairs", "s", "95 %", "calibration");
    char text[60];
    std::snprintf(text, sizeof text, "%.3g .. %.3g", r.low, r.high);
    print_line(out, "%-16s %6zu %10.3g %22s %12.3g", r.key.c_str(), r.pairs, r.spread, text, r.calibration_sigma);
  }
}

}  // namespace

void print_shift(const ShiftReport& report, std::ostream& out) {
  out << head_text(report) << '\n' << yield_text(report.yield) << '\n';
  if (report.attempts.empty() && report.of_the_other_kind > 0)
    out << (report.simulated ? "Without --simulated it is of the real units.\n"
                             : "With --simulated it is of the dry runs.\n");
  if (report.attempts.empty()) return;
  print_stations(report, out);
  if (!report.yield.reasons.empty()) print_reasons(report.yield, out);
  const std::vector<ChartSignal> signals = signals_of(report.charts);
  out << '\n' << signals_text(report, signals.size()) << '\n';
  for (const ChartSignal& s : signals) {
    if (s.signal.rule != 1) continue;  // the others: page and CSV
    const std::size_t i = s.signal.point;
    print_line(out, "%s  %-16s %-12s %14.7g  rule 1: %s", s.chart->times[i].c_str(), s.chart->units[i].c_str(),
               s.chart->key.c_str(), s.chart->values[i], run_rules[0].words);
  }
  for (const ChartedQuantity& q : report.charts) {
    const auto& [cpk, ppk] = std::pair(q.chart.cpk, q.chart.ppk);
    if (cpk && ppk)
      print_line(out, "%-12s n %zu, Cpk %.2f (%.2f .. %.2f), Ppk %.2f (%.2f .. %.2f)", q.key.c_str(), q.chart.count,
                 cpk->value, cpk->low, cpk->high, ppk->value, ppk->low, ppk->high);
  }
  for (const StationDifference& d : report.differences) {
    if (!d.stands_out() && !d.drifts()) continue;
    print_line(out, "%s - %s: %s differs by %.3g, sigma %.2g (%s)", d.b.c_str(), d.a.c_str(), d.key.c_str(),
               d.difference, d.sigma, compared_text(d).c_str());
  }
  print_repeatability("turn-on", report.turn_on, out);
  print_repeatability("month to month", report.month, out);
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
