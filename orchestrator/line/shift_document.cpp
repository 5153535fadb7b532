#include "orchestrator/line/shift_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "calib/model/parameters.h"

namespace turncal {

namespace {

using namespace cell;
using Emphasis = Table::Emphasis;

std::string percent(double share) { return fmt::format("{:.1f} %", 100.0 * share); }

// Returns "95.0 % (19 of 20; 76.4 .. 99.1 %)".
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

std::string yield_text(const LineYield& yield, double target, bool reached) {
  std::string text =
      fmt::format("First pass {}, final yield {}; {}, {:.1f} h on the table", share(yield.first_pass, true).words,
                  share(yield.final_pass, false).words, counted(yield.attempts, "attempt"), yield.hours);
  if (yield.hours_lost > 0.0) text += fmt::format(", {:.1f} h of them without a good unit", yield.hours_lost);
  if (yield.running > 0) text += fmt::format("; {} still running or never ended", yield.running);
  if (target > 0.0 && yield.first_pass.all > 0)
    text += fmt::format("; the target of {} is {}", percent(target), reached ? "reached" : "missed");
  return text + ".";
}

std::string signals_text(const ShiftReport& report, std::size_t signals) {
  double expected = 0.0;
  std::size_t points = 0;  // points with a signal, counted by rule, as the expected number counts them, not stretches
  for (const ChartedQuantity& chart : report.charts) {
    if (chart.chart.sigma.value_or(0.0) <= 0.0) continue;
    points += chart.chart.signals.size();
    for (const RunRule& rule : run_rules)
      if (chart.chart.count >= rule.stretch)
        expected += rule.false_alarm * double(chart.chart.count - rule.stretch + 1);
  }
  return fmt::format(
      "Signals: {}, at {}. By chance alone about {:.0f} points would give one: look for several charts or rules "
      "that signal at the same time.",
      signals, counted(points, "point"), expected);
}

// all: total for a last row; null: none.
Table yield_table(const char* of, std::vector<YieldOf> parts, const YieldOf* all) {
  Table table{{text(of), number("attempts"), number("units"), number("first pass yield (95 %)"), number("final yield"),
               number("hours"), number("lost"), number("hours per good unit"), number("mean residual")}};
  if (all != nullptr) parts.push_back(*all);
  for (const auto& [name, y, residual, calibrated] : parts) {
    const auto good = double(y.final_pass.part);
    table.row({cell::name(name), count(y.attempts), count(y.units), share(y.first_pass, true),
               share(y.final_pass, false), fixed(y.hours, 1), fixed(y.hours_lost, 1),
               good > 0.0 ? fixed(y.hours / good, 2) : number("-"), calibrated > 0 ? fixed(residual, 3) : number("-")},
              all != nullptr && &name == &parts.back().name ? Emphasis::hit : Emphasis::none);
  }
  return table;
}

Figure yield_figure(const ShiftReport& report) {
  constexpr std::size_t names = 14, month = 7, day = 10;
  const double last = double(report.periods.size()) + 0.5, target = 100.0 * report.target;
  Series first{"first-pass yield", Series::Style::dot, Colour::after, {}},
      interval{"95 % interval", Series::Style::line, Colour::after, {}},
      wanted{"target", Series::Style::dashed, Colour::before, {{0.5, target}, {last, target}}};
  Panel panel{.title = "", .x_label = "", .y_label = "%", .series = {}, .marks = {}, .named_x = true};
  for (std::size_t k = 0; k < report.periods.size(); ++k) {
    const std::string& period = report.periods[k].name;
    const Share& share = report.periods[k].yield.first_pass;
    const auto x = double(k + 1);
    const std::string shown =
        period.size() > day ? period.substr(day + 1) + " h" : period.substr(period.size() > month ? 5 : 0);
    if (k % (1 + report.periods.size() / names) == 0) panel.marks.emplace_back(x, shown);
    if (share.all == 0) continue;
    const auto [low, high] = share.interval();
    first.points.emplace_back(x, 100.0 * share.value());
    first.names.push_back(fmt::format("{}, {} of {}", period, share.part, share.all));
    for (const double end : {100.0 * low, 100.0 * high, no_point}) interval.points.emplace_back(x, end);
  }
  panel.series = {first, interval};
  if (target > 0.0) panel.series.push_back(wanted);
  return {.id = "yield", .label = "First-pass yield over time", .caption = "", .panels = {panel}};
}

Table pareto_table(const LineYield& yield) {
  Table table{{wide("reason"), number("attempts"), bar(0.0), number("share"), number("cumulative"), number("hours"),
               name("last unit")}};
  const auto most = double(yield.reasons.front().attempts);
  for (const LossReason& reason : yield.reasons)
    table.row({wide(reason.reason), count(reason.attempts), bar(double(reason.attempts) / most),
               number(percent(reason.share), reason.share), number(percent(reason.cumulated), reason.cumulated),
               fixed(reason.hours, 1), name(reason.last_unit)});
  return table;
}

Table signal_table(const std::vector<ChartSignal>& signals) {
  Table table{
      {number("time"), name("unit"), name("chart"), number("point"), number("value"), number("rule"), text("pattern")}};
  table.most = 20;
  for (const ChartSignal& s : signals) {
    const std::size_t i = s.signal.point;
    table.row({number(s.chart->times[i]), name(s.chart->units[i]), name(s.chart->key), count(i + 1),
               with_sigma(s.chart->values[i], s.chart->chart.sigma.value_or(0.0)), count(s.signal.rule),
               text(run_rules[s.signal.rule - 1].words)},
              s.signal.rule == 1 ? Emphasis::hit : Emphasis::none);
  }
  return table;
}

Table rule_table() {
  Table table{{number("rule"), text("signal"), number("false alarms per 1000 points")}};
  for (std::size_t i = 0; i < run_rules.size(); ++i)
    table.row({count(i + 1), text(run_rules[i].words), number(1000.0 * run_rules[i].false_alarm)});
  return table;
}

Table repeatability_table(const std::vector<Repeatability>& all) {
  Table table{{name("parameter"), number("pairs"), number("s"), text("95 %"), number("due to calibration"),
               number("due to the unit")}};
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
    table.row({text(d.b + " - " + d.a), name(d.key), text(units), with_sigma(d.difference, d.sigma),
               with_sigma(d.sigma, d.sigma), d.sigma > 0.0 ? fixed(d.difference / d.sigma, 1) : number("-"),
               d.drift ? with_sigma(*d.drift, d.drift_sigma.value_or(0.0)) : number("-"), number(d.drift_sigma, 2)},
              d.stands_out() || d.drifts() ? Emphasis::hit : Emphasis::none);
  }
  return table;
}

// Adds the table with name and unit of each quantity beside its key, from `of`.
void add_with_units(Table table, std::size_t key, const std::vector<ChartedQuantity>& of, Document& document) {
  const auto insert = [&table, key](const char* head, const auto& words_of) {
    const auto at = [key](std::vector<Cell>& cells) { return cells.begin() + std::ptrdiff_t(key + 1); };
    table.head.insert(at(table.head), text(head));
    for (Table::Row& row : table.rows) row.cells.insert(at(row.cells), text(words_of(row.cells[key].words)));
  };
  insert("units", [&of](const std::string& quantity) {
    const auto at = std::ranges::find(of, quantity, &ChartedQuantity::key);
    return at == of.end() ? "" : unit_text(at->unit);
  });
  insert("meaning", quantity_name);
  document.add(std::move(table));
}

// Links to the report of its run, if it is on this machine or `link` knows of one.
Cell unit_cell(const std::string& unit, const std::string& folder, const RunLink& link = {}) {
  std::error_code none;
  const std::filesystem::path file = std::filesystem::absolute(folder, none) / "diagnosis/report.html";
  const std::string here = std::filesystem::exists(file, none) ? file.string() : "";
  const std::string report = link ? link(folder, "report.html") : here;
  return report.empty() ? name(unit) : linked(name(unit), report);
}

// Lists the newest first.
Table attempt_table(const std::vector<AttemptRecord>& attempts,
                    const std::function<Cell(const AttemptRecord&)>& first) {
  Table table{{name("unit"), number("time"), text("outcome"), wide("reason"), text("station"), number("hours"),
               number("residual")}};
  for (std::size_t k = attempts.size(); k-- > 0;) {
    const AttemptRecord& a = attempts[k];
    table.row({first(a), number(a.time_utc), word(a.outcome), wide(a.reason), text(a.station), fixed(hours_of(a), 2),
               number(a.residual)},
              kind_of(a) == AttemptKind::passed ? Emphasis::none : Emphasis::hit);
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
    add_with_units(signal_table({signals.begin() + std::ptrdiff_t(left_out), signals.end()}), 2, report.charts,
                   document);
  document.add(rule_table(), Scope::page);
}

using Points = std::vector<std::pair<double, double>>;

struct Group {
  const char* id;
  const char* title;
  std::string_view keys;
};

constexpr Group groups[] = {
    {"run", "The runs: residual (1: noise alone), temperature, time on the table", "residual temperature hours"},
    {"gyrobias", "Gyro bias", "N01 N02 N03"},
    {"accelbias", "Accelerometer bias", "A01 A02 A03"},
    {"gyroscale", "Gyro scale factors", "n11 n22 n33"},
    {"gyromisalignment", "Gyro misalignments", "n12 n13 n21 n23 n31 n32"},
    {"accelscale", "Accelerometer scale factors", "a11 a22 a33"},
    {"accelmisalignment", "Accelerometer misalignments", "a12 a13 a23"}};

// Labels some of the calibrations by the day of their end or, when all are of one day, by its time.
std::vector<std::pair<double, std::string>> names_of(const std::vector<std::string>& times) {
  constexpr std::size_t names = 4, day = 5, hour = 11, length = 5;
  const bool one_day = times.front().substr(0, hour) == times.back().substr(0, hour);
  std::vector<std::pair<double, std::string>> marks;
  const std::size_t count = std::min(names, times.size());
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = count < 2 ? 0 : k * (times.size() - 1) / (count - 1);
    const std::string name = times[i].size() > hour ? times[i].substr(one_day ? hour : day, length) : "";
    if (!name.empty() && (marks.empty() || marks.back().second != name)) marks.emplace_back(double(i + 1), name);
  }
  return marks;
}

// Returns the shift and scale of displayed values, (value - first) * factor; scale factors relative to their mean. `all` has the scale factors.
std::pair<double, DisplayUnit> scale_of(const ChartedQuantity& history, const std::vector<ChartedQuantity>& all) {
  const std::string& key = history.key;
  const auto of = std::ranges::find(all, std::string{key[0], key[2], key[2]}, &ChartedQuantity::key);
  const double scale = of == all.end() || of->chart.mean == 0.0 ? 1.0 : of->chart.mean;
  if (of == all.end() || of->key != key) return {0.0, error_unit(key, history.unit, scale)};
  const bool spread = history.chart.sigma.value_or(0.0) > 0.01 * std::abs(scale);
  return {scale,
          spread ? DisplayUnit{100.0 / scale, "% from the mean"} : DisplayUnit{1e6 / scale, "ppm from the mean"}};
}

std::string index_text(const Capability& index, double value) {
  return value_with_sigma(value, 0.25 * (index.high - index.low));  // about one sigma of a 95 % interval
}

Panel control_panel(const ChartedQuantity& history, const std::vector<ChartedQuantity>& all) {
  const ControlChart& chart = history.chart;
  const auto [zero, unit] = scale_of(history, all);
  const auto shown = [from = zero, factor = unit.factor](double value) { return (value - from) * factor; };
  const double last = double(history.values.size()) + 0.5;
  const auto level = [&](std::optional<double> value) {
    return value ? Points{{0.5, shown(*value)}, {last, shown(*value)}} : Points{};
  };
  std::set<std::size_t> signalled;
  for (const RunSignal& signal : chart.signals) signalled.insert(signal.point);
  using Style = Series::Style;
  Series inside{"one calibration", Style::dot, Colour::after, {}},
      outside{"outside the control limits", Style::square, Colour::before, {}},
      runs{"run rules 2 to 8", Style::triangle, Colour::x, {}};
  Points bars;
  for (std::size_t i = 0; i < history.values.size(); ++i) {
    const double x = double(i + 1), value = history.values[i];
    const bool out = std::ranges::find(chart.outside, i) != chart.outside.end();
    Series& curve = out ? outside : signalled.contains(i) ? runs : inside;
    curve.points.emplace_back(x, shown(value));
    curve.names.push_back(history.units[i] + ", " + history.times[i]);
    if (const std::optional<double>& sigma = history.sigmas[i])
      for (const double end : {shown(value - *sigma), shown(value + *sigma), no_point}) bars.emplace_back(x, end);
  }
  Panel panel{
      .title = quantity_name(history.key) + (chart.cpk ? ", Cpk " + index_text(*chart.cpk, chart.cpk->value) : ""),
      .x_label = "calibrations 1 to " + std::to_string(history.values.size()),
      .y_label = unit.unit,
      .series = {},
      .marks = names_of(history.times),
      .named_x = true};
  panel.series = {inside,
                  {"one sigma", Style::line, Colour::after, bars},
                  outside,
                  runs,
                  {"mean", Style::line, Colour::neutral, level(chart.mean)},
                  {"control limits: mean ± 3 sigma (moving range)", Style::dashed, Colour::neutral, level(chart.lower)},
                  {"", Style::dashed, Colour::neutral, level(chart.upper)},
                  {"limit in force", Style::line, Colour::before, level(history.limit.min)},
                  {"limit in force", Style::line, Colour::before, level(history.limit.max)}};
  return panel;
}

Cell index_cell(const std::optional<Capability>& index) {
  if (!index) return number("-");
  return number(fmt::format("{} ({} .. {})", index_text(*index, index->value), index_text(*index, index->low),
                            index_text(*index, index->high)),
                index->value);
}

Cell as_given(const std::optional<double>& limit) {
  return limit ? number(fmt::format("{:g}", *limit), *limit) : number("-");
}

Table control_table(const std::vector<ChartedQuantity>& quantities) {
  Table table{{name("quantity")}};
  for (const char* name : {"n", "mean", "s", "lower", "upper", "outside", "min", "max", "Cpk (95 %)", "Ppk (95 %)"})
    table.head.push_back(number(name));
  for (const ChartedQuantity& q : quantities) {
    const ControlChart& chart = q.chart;
    if (chart.count == 0) continue;
    // Equal values, and single ones, get the digits of their own sigmas.
    const double s = chart.sigma.value_or(0.0) > 0.0 ? *chart.sigma : q.largest_sigma();
    const auto to_place = [s](const std::optional<double>& value) {
      return !value ? number("-") : s > 0.0 ? with_sigma(*value, s) : number(*value, 4);
    };
    const bool hit = !chart.outside.empty() || (chart.cpk && chart.cpk->value < 1.0);
    table.row({name(q.key), count(chart.count), to_place(chart.mean), number(chart.sigma, 2), to_place(chart.lower),
               to_place(chart.upper), count(chart.outside.size()), as_given(q.limit.min), as_given(q.limit.max),
               index_cell(chart.cpk), index_cell(chart.ppk)},
              hit ? Table::Emphasis::hit : Table::Emphasis::none);
  }
  return table;
}

}  // namespace

Document shift_document(const ShiftReport& report) {
  Document document{"turncal: shift report of " + report.source, "Shift report"};
  document.soft(head_text(report), Scope::all);
  const bool reached = report.whole.yield.first_pass.reaches(report.target);
  const char* const style = !reached ? "unexplained" : report.whole.yield.reasons.empty() ? "clean" : "extended";
  document.add(Paragraph{yield_text(report.whole.yield, report.target, reached), std::string("verdict ") + style});
  if (report.attempts.empty()) {
    document.text("No attempt is on record.");
    if (report.of_the_other_kind > 0)
      document.add(Paragraph{report.simulated ? "Omit --simulated for a report of the real units."
                                              : "Use --simulated for a report of the dry runs."},
                   Scope::terminal);
    return document;
  }
  document.section("yield", "Yield and hours");
  document.add(yield_table("station", report.stations, report.stations.size() == 1 ? nullptr : &report.whole));
  if (report.periods.size() > 1) {
    document.subsection("Over time");
    document.figure(yield_figure(report));
    document.add(yield_table("period, UTC", report.periods, nullptr));
  }
  document.section("reasons", "Why attempts did not pass");
  if (report.whole.yield.reasons.empty())
    document.text("All judged attempts passed.");
  else
    document.add(pareto_table(report.whole.yield));
  document.add(Heading{2, "units", "Attempts, newest first"}, Scope::page);
  document.add(attempt_table(report.attempts, [](const AttemptRecord& a) { return unit_cell(a.unit, a.folder); }),
               Scope::page);
  if (report.calibrations.size() > 1) add_charts(report, document);
  document.section("stations", "Stations compared");
  if (report.differences.empty()) {
    document.text(report.stations.size() < 2
                      ? "There is only one station, so there is nothing to compare."
                      : fmt::format("Too few units: expected {} at both stations, or at each.", least_units));
  } else {
    add_with_units(difference_table(report.differences), 1, report.charts, document);
    document.soft(
        "Bold: beyond 3.04 sigma, which one of 21 parameters exceeds in 5 % of the reports of equal stations.");
  }
  document.section("repeatability", "Repeatability");
  for (const auto& [title, list] : {std::pair{"Turn-on: pairs up to 3 days apart", &report.turn_on},
                                    std::pair{"Month to month: pairs 20 to 45 days apart", &report.month}}) {
    document.subsection(title);
    if (list->empty())
      document.text("No unit was calibrated twice at such an interval at one station.");
    else
      add_with_units(repeatability_table(*list), 0, report.charts, document);
  }
  return document;
}

std::string shift_csv(const ShiftReport& report) {
  DataTable text({"table", "item", "quantity", "value"});
  const auto add = [&text](const char* table, const std::string& item,
                           std::initializer_list<std::pair<const char*, std::optional<double>>> quantities) {
    for (const auto& [quantity, value] : quantities)
      if (value) text.row({table, item, quantity, *value});
  };
  const auto yield = [&add](const char* table, const std::string& of, const LineYield& y) {
    add(table, of,
        {{"attempts", y.attempts},
         {"units", y.units},
         {"first_pass", y.first_pass.part},
         {"first_pass_of", y.first_pass.all},
         {"final_pass", y.final_pass.part},
         {"final_pass_of", y.final_pass.all},
         {"hours", y.hours},
         {"hours_lost", y.hours_lost}});
  };
  const auto value_of = [](const std::optional<Capability>& index) {
    return index ? std::optional(index->value) : std::nullopt;
  };
  yield("yield", "all", report.whole.yield);
  for (const YieldOf& station : report.stations) yield("yield", station.name, station.yield);
  for (const YieldOf& period : report.periods) yield("yield_over_time", period.name, period.yield);
  for (const LossReason& reason : report.whole.yield.reasons)
    add("reason", reason.reason, {{"attempts", reason.attempts}});
  for (const ChartedQuantity& q : report.charts)
    if (const ControlChart& chart = q.chart; chart.count > 0)
      add("chart", q.key,
          {{"n", chart.count},
           {"mean", chart.mean},
           {"s", chart.sigma},
           {"cpk", value_of(chart.cpk)},
           {"ppk", value_of(chart.ppk)}});
  for (const auto& [name, list] : {std::pair{"turn_on", &report.turn_on}, std::pair{"month_to_month", &report.month}})
    for (const Repeatability& r : *list)
      add(name, r.key, {{"pairs", r.pairs}, {"s", r.spread}, {"calibration_sigma", r.calibration_sigma}});
  for (const StationDifference& d : report.differences)
    add("stations", d.b + " - " + d.a + " " + d.key, {{"difference", d.difference}, {"sigma", d.sigma}});
  return text.csv();
}

std::string signals_csv(const ShiftReport& report) {
  DataTable text({"time_utc", "unit", "chart", "point", "value", "rule", "words"});
  for (const ChartSignal& s : signals_of(report.charts)) {
    const std::size_t i = s.signal.point;
    text.row({s.chart->times[i], s.chart->units[i], s.chart->key, i + 1, s.chart->values[i], s.signal.rule,
              run_rules[s.signal.rule - 1].words});
  }
  return text.csv();
}

void add_control_table(const std::vector<ChartedQuantity>& quantities, Document& document) {
  add_with_units(control_table(quantities), 0, quantities, document);
}

void add_control_charts(const std::vector<ChartedQuantity>& quantities, Document& document) {
  add_control_table(quantities, document);
  document.soft(
      "lower, upper: control limits; min, max: limits in force. Bold: a calibration outside the control limits, or Cpk "
      "below 1.");
  for (const Group& group : groups) {
    Figure figure = small_panels(group.id, group.title);
    for (const ChartedQuantity& quantity : quantities)
      if (group.keys.find(quantity.key) != std::string_view::npos && !quantity.values.empty())
        figure.panels.push_back(control_panel(quantity, quantities));
    if (figure.panels.empty()) continue;
    document.add(Heading{3, "", figure.label}, Scope::page);
    document.figure(figure);
  }
}

Document history_document(const std::vector<StoredCalibration>& all, const std::string& source, const RunLink& link) {
  const bool simulated = !all.empty() && all.front().simulated;
  Document document{"turncal: control charts of " + source, "Control charts"};
  document.soft(source + ", " + counted(std::ssize(all), "calibration") + (simulated ? " of simulated units" : ""),
                Scope::all);
  if (all.empty()) {
    document.text("No calibration is on record.");
    return document;
  }
  std::vector<ChartedQuantity> histories;
  for (const int k : free_parameters()) histories.push_back(parameter_history(all, parameter_key(k)).charted);
  document.section("control", "Parameters");
  add_control_charts(histories, document);
  document.section("calibrations", "Calibrations");
  Table table{{number("calibration"), number("id"), name("unit"), number("time"), text("verdict"), text("operator"),
               text("station")}};
  for (std::size_t i = 0; i < all.size(); ++i) {
    const StoredCalibration& c = all[i];
    table.row({count(i + 1), count(std::size_t(c.id)), unit_cell(c.unit, c.folder, link), number(c.time_utc),
               word(c.verdict), text(c.operator_name), text(c.station)});
  }
  document.add(std::move(table));
  return document;
}

Document unit_document(const UnitRecord& record) {
  Document document{"turncal: unit " + record.unit, "Unit " + record.unit};
  std::vector<AttemptRecord> attempts = record.attempts;
  std::vector<StoredCalibration> calibrations = record.calibrations;
  const bool simulated = attempts.empty() ? calibrations.back().simulated : attempts.back().simulated;
  const auto other = [simulated](const auto& row) { return row.simulated != simulated; };
  std::erase_if(attempts, other);
  std::erase_if(calibrations, [&](const StoredCalibration& c) { return other(c) || !c.defect.empty(); });
  if (simulated) document.add(Paragraph{"Simulated: no real unit.", "loud"});
  if (!attempts.empty()) {
    const AttemptRecord& last = attempts.back();
    document.add(Paragraph{fmt::format("{}: {}{}run of {}, station {}.", in_words(last.outcome), last.reason,
                                       last.reason.empty() ? "" : "; ", last.time_utc, last.station),
                           kind_of(last) == AttemptKind::passed ? "verdict clean" : "verdict unexplained"});
  }
  document.section("runs", "Runs, newest first");
  const auto linked_to = [&record](const AttemptRecord& a, const std::string& what, const char* otherwise) {
    const std::string link = record.link(a.folder, what + ".html");
    return link.empty() ? text(otherwise) : linked(text(what), link);
  };
  Table runs = attempt_table(attempts, [&](const AttemptRecord& a) { return linked_to(a, "report", "no report"); });
  runs.head.push_back(text("certificate"));
  for (std::size_t k = 0; k < attempts.size(); ++k)
    runs.rows[k].cells.push_back(linked_to(attempts[attempts.size() - 1 - k], "certificate", "-"));
  runs.head.front() = text("");
  document.add(std::move(runs));
  if (calibrations.size() < 2) return document;  // there are no control limits
  const Document history = history_document(calibrations, "The parameters over time", record.link);
  document.blocks.insert(document.blocks.end(), history.blocks.begin(), history.blocks.end());
  return document;
}

}  // namespace turncal
