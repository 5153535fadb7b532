#include "orchestrator/line_report/shift_document.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "calib/model/parameters.h"
#include "imu_io/base/text_pieces.h"

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
  std::string text = fmt::format("First pass {}, final yield {}; {} attempts, {:.1f} h on the table",
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
      "charts, or several rules, at one time.",
      signals, points, expected);
}

Table yield_table(const ShiftReport& report) {
  Table table{{text("station"), number("attempts"), number("units"), number("first pass yield (95 %)"),
               number("final yield"), number("hours"), number("lost"), number("hours per good unit"),
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
               number(r.calibration_sigma), number(r.of_unit())});
  return table;
}

Table difference_table(const std::vector<StationDifference>& all) {
  Table table{{text("stations"), name("parameter"), text("compared"), number("difference"), number("sigma"),
               number("in sigmas"), number("drift in 30 days"), number("its sigma")}};
  for (const StationDifference& d : all) {
    const std::string units = d.of_the_same_units ? fmt::format("{} units at both", d.count_a)
                                                  : fmt::format("{} units against {}", d.count_b, d.count_a);
    table.row({text(d.b + " - " + d.a), name(d.key), text(units), number(d.difference), number(d.sigma),
               d.sigma > 0.0 ? fixed(d.difference / d.sigma, 1) : number("-"), number(d.drift), number(d.drift_sigma)},
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

using Points = std::vector<std::pair<double, double>>;

struct Group {
  const char* id;
  const char* title;
  std::vector<std::string_view> keys;
};

const std::vector<Group>& groups() {
  static const std::vector<Group> all = {
      {"run",
       "Residual (1: noise alone); highest temperature, C; hours on the table",
       {"residual", "temperature", "hours"}},
      {"gyrobias", "Gyro bias, deg/h", {"N01", "N02", "N03"}},
      {"accelbias", "Accelerometer bias, g", {"A01", "A02", "A03"}},
      {"gyroscale", "Gyro scale factor, arcsec/pulse (ratio for a unit that counts in rad)", {"n11", "n22", "n33"}},
      {"gyroinstallation", "Gyro misalignments, as n", {"n12", "n13", "n21", "n23", "n31", "n32"}},
      {"accelscale", "Accelerometer scale factor, ratio to the nominal pulse", {"a11", "a22", "a33"}},
      {"accelinstallation", "Accelerometer misalignments, as a", {"a12", "a13", "a23"}}};
  return all;
}

// Where a new day begins, as 01-31; of many days some.
std::vector<std::pair<double, std::string>> date_marks(const std::vector<std::string>& times) {
  constexpr std::size_t most = 5, month = 5, to_day = 10;
  std::vector<std::pair<double, std::string>> marks;
  double last = 0.0;
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (times[i].size() < to_day) continue;
    const std::string day = times[i].substr(month, to_day - month);
    if (!marks.empty() &&
        (marks.back().second == day || (static_cast<double>(i + 1) - last) * most < static_cast<double>(times.size())))
      continue;
    last = static_cast<double>(i + 1);
    marks.emplace_back(last, day);
  }
  return marks;
}

// Points run from 1; all ordinates are less the mean, which stands in the title.
Panel control_panel(const ChartedQuantity& history) {
  const ControlChart& chart = history.chart;
  const double last = static_cast<double>(history.values.size()) + 0.5;
  const auto level = [&](std::optional<double> value) {
    return value ? Points{{0.5, *value - chart.mean}, {last, *value - chart.mean}} : Points{};
  };
  std::set<std::size_t> signalled;
  for (const RunSignal& signal : chart.signals) signalled.insert(signal.point);
  Points inside, outside, runs, bars;
  for (std::size_t i = 0; i < history.values.size(); ++i) {
    const double x = static_cast<double>(i + 1), y = history.values[i] - chart.mean;
    const bool out = std::ranges::find(chart.outside, i) != chart.outside.end();
    (out ? outside : signalled.contains(i) ? runs : inside).emplace_back(x, y);
    if (const std::optional<double>& sigma = history.sigmas[i]) {
      for (const double end : {y - *sigma, y + *sigma, no_point}) bars.emplace_back(x, end);
    }
  }
  Panel panel;
  panel.title = history.key + " minus its mean, " + value_with_sigma(chart.mean, chart.sigma.value_or(0.0)) +
                (chart.cpk ? ", Cpk " + significant(chart.cpk->value, 3) : "");
  panel.x_label = "calibration";
  panel.marks = date_marks(history.times);
  using Style = ::turncal::Series::Style;
  const auto add = [&panel](const char* label, Style style, Colour colour, Points points) {
    if (!points.empty()) panel.series.push_back({label, style, colour, std::move(points)});
  };
  add("one calibration", Style::dot, Colour::after, std::move(inside));
  add("one sigma", Style::line, Colour::after, std::move(bars));
  add("outside the control limits", Style::square, Colour::before, std::move(outside));
  add("run rules 2 to 8", Style::triangle, Colour::x, std::move(runs));
  add("control limits: mean ± 3 s of the moving range", Style::dashed, Colour::neutral, level(chart.lower));
  add("", Style::dashed, Colour::neutral, level(chart.upper));
  add("limit in force", Style::line, Colour::before, level(history.limit.min));
  add("limit in force", Style::line, Colour::before, level(history.limit.max));
  return panel;
}

Cell index_cell(const std::optional<Capability>& index) {
  if (!index) return cell::number("-");
  return cell::number(
      significant(index->value, 3) + " (" + significant(index->low, 2) + " .. " + significant(index->high, 2) + ")",
      index->value);
}

Table control_table(const std::vector<ChartedQuantity>& quantities) {
  Table table{{cell::name("quantity")}};
  for (const char* name : {"n", "mean", "s", "lower", "upper", "outside", "min", "max", "Cpk (95 %)", "Ppk (95 %)"})
    table.head.push_back(cell::number(name));
  for (const ChartedQuantity& q : quantities) {
    const ControlChart& chart = q.chart;
    if (chart.count == 0) continue;
    const bool hit = !chart.outside.empty() || (chart.cpk && chart.cpk->value < 1.0);
    table.row(
        {cell::name(q.key), cell::count(chart.count), cell::number(chart.mean, 8), cell::number(chart.sigma, 3),
         cell::number(chart.lower, 8), cell::number(chart.upper, 8), cell::count(chart.outside.size()),
         cell::number(q.limit.min, 5), cell::number(q.limit.max, 5), index_cell(chart.cpk), index_cell(chart.ppk)},
        hit ? Table::Emphasis::hit : Table::Emphasis::none);
  }
  return table;
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

void add_control_charts(const std::vector<ChartedQuantity>& quantities, Document& document) {
  document.add(control_table(quantities));
  document.soft(
      "lower, upper: control limits; min, max: limits in force. Bold: a calibration outside the control limits, or Cpk "
      "below 1.");
  for (const Group& group : groups()) {
    Figure figure{.id = group.id,
                  .label = group.title,
                  .caption = "",
                  .columns = 3,
                  .panel_width = 320,
                  .panel_height = 220,
                  .panels = {}};
    for (const ChartedQuantity& quantity : quantities) {
      const bool here = std::ranges::find(group.keys, quantity.key) != group.keys.end();
      const bool same = quantity.chart.sigma == 0.0;  // nothing to see
      if (here && !same && !quantity.values.empty()) figure.panels.push_back(control_panel(quantity));
    }
    if (figure.panels.empty()) continue;
    document.add(Heading{3, "", figure.label}, Scope::page);
    document.figure(figure);
  }
}

Document history_document(const std::vector<StoredCalibration>& all, const std::string& source) {
  const bool simulated = !all.empty() && all.front().simulated;
  Document document{"turncal: control charts of " + source, "Control charts"};
  document.soft(fmt::format("{}, {} calibrations{}", source, all.size(), simulated ? " of simulated units" : ""),
                Scope::all);
  if (all.empty()) {
    document.text("No calibration is on record.");
    return document;
  }
  std::vector<ChartedQuantity> histories;
  for (const std::string_view key : free_parameter_keys()) histories.push_back(parameter_history(all, key));
  document.section("control", "Parameters");
  add_control_charts(histories, document);
  document.section("calibrations", "Calibrations");
  Table table{{number("calibration"), number("id"), text("unit"), text("time"), text("verdict"), text("operator"),
               text("station")}};
  for (std::size_t i = 0; i < all.size(); ++i) {
    const StoredCalibration& c = all[i];
    table.row({count(i + 1), count(static_cast<std::size_t>(c.id)), text(c.unit), text(c.time_utc), text(c.verdict),
               text(c.operator_name), text(c.station)});
  }
  document.add(std::move(table));
  return document;
}

DataTable calibrations_table(const std::vector<StoredCalibration>& all) {
  std::vector<std::string> columns;
  StoredCalibration named;
  for (const Field& field : fields_of(named)) columns.push_back(field.key);
  for (const std::string_view key : parameter_keys) {
    columns.emplace_back(key);
    columns.push_back("sigma." + std::string(key));
  }
  DataTable table(std::move(columns));
  for (StoredCalibration c : all) {
    add_row(fields_of(c), table);
    for (StoredValue& value : c.values) {
      add_cell({"", &value.value}, table);
      add_cell({"", &value.sigma}, table);
    }
  }
  return table;
}

DataTable attempts_table(const std::vector<AttemptRecord>& all) {
  const std::vector<std::string_view> words = split_words(
      "id unit began_utc time_utc outcome reason station part revision operator ambient simulated temperature_min_c "
      "temperature_max_c residual diagnosis recorded_s sessions repeated_dwells lost_samples calibration folder");
  const std::vector<std::string> columns(words.begin(), words.end());
  DataTable table(columns);
  for (AttemptRecord attempt : all) {
    Fields fields = fields_of(attempt);
    fields.push_back({"id", &attempt.id});
    table.begin_row();
    for (const std::string& column : columns) add_cell(field_named(column, fields), table);
  }
  return table;
}

}  // namespace turncal
