#include "orchestrator/line_report/shift_words.h"

#include <cstdio>

namespace turncal {

std::string decimals(double value, int digits) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string percent(double share) { return decimals(100.0 * share, 1) + " %"; }

std::string share_text(const Share& share, bool with_interval) {
  if (share.all == 0) return "-";
  const auto [low, high] = share.interval();
  return percent(share.value()) + " (" + std::to_string(share.part) + " of " + std::to_string(share.all) +
         (with_interval ? "; " + decimals(100.0 * low, 1) + " .. " + percent(high) : "") + ")";
}

std::string head_text(const ShiftReport& report) {
  std::string text = report.source;
  if (!report.attempts.empty())
    text += "; from " + report.attempts.front().time_utc + " to " + report.attempts.back().time_utc;
  if (report.simulated) text += "; simulated units";
  if (report.of_the_other_kind > 0)
    text += "; attempts of " + std::string(report.simulated ? "real" : "simulated") +
            " units left out: " + std::to_string(report.of_the_other_kind);
  if (report.damaged > 0) text += "; damaged rows left out: " + std::to_string(report.damaged);
  return text;
}

std::string yield_text(const LineYield& yield) {
  std::string text = "First pass " + share_text(yield.first_pass, true) + ", in the end " +
                     share_text(yield.final_pass, false) + "; " + std::to_string(yield.attempts) + " attempts, " +
                     decimals(yield.hours, 1) + " h on the table";
  if (yield.hours_lost > 0.0) text += ", " + decimals(yield.hours_lost, 1) + " h of them without a good unit";
  if (yield.running > 0) text += "; " + std::to_string(yield.running) + " going on, or never ended";
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
  return std::to_string(signals) + " signals, of " + std::to_string(points) +
         " points. With nothing wrong at all about " + decimals(expected, 0) +
         " points would give one: look for several charts, or several rules, at one time.";
}

std::string compared_text(const StationDifference& d) {
  if (d.of_the_same_units) return std::to_string(d.count_a) + " units at both";
  return std::to_string(d.count_b) + " units against " + std::to_string(d.count_a);
}

std::string differences_text() {
  return "Bold: beyond 3.04 sigma, by which one of 21 parameters goes in 5 % of the reports of equal stations.";
}

std::string no_differences_text(const ShiftReport& report) {
  if (report.stations.size() < 2) return "There is one station.";
  return "Too few units: expected " + std::to_string(least_units) + " at both stations, or at each.";
}

}  // namespace turncal
