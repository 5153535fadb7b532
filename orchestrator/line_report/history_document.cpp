#include "orchestrator/line_report/history_document.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "calib/model/parameters.h"

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
      {"run",
       "Residual (1: noise alone); highest temperature, C; hours on the table",
       {"residual", "temperature", "hours"}},
      {"gyrobias", "Gyro bias, deg/h", {"N01", "N02", "N03"}},
      {"accelbias", "Accelerometer bias, g", {"A01", "A02", "A03"}},
      {"gyroscale", "Gyro scale factor, arcsec/pulse (ratio for a unit that counts in rad)", {"n11", "n22", "n33"}},
      {"gyroinstallation", "Gyro installation errors, as n", {"n12", "n13", "n21", "n23", "n31", "n32"}},
      {"accelscale", "Accelerometer scale factor, ratio to the nominal pulse", {"a11", "a22", "a33"}},
      {"accelinstallation", "Accelerometer installation errors, as a", {"a12", "a13", "a23"}}};
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
    const bool out = std::find(chart.outside.begin(), chart.outside.end(), i) != chart.outside.end();
    (out ? outside : signalled.contains(i) ? runs : inside).emplace_back(x, y);
    if (const std::optional<double>& sigma = history.sigmas[i]) {
      for (const double end : {y - *sigma, y + *sigma, no_point}) bars.emplace_back(x, end);
    }
  }
  Panel panel;
  panel.title = history.key + " less " + significant(chart.mean, 7) +
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

Cell figure_cell(std::optional<double> value, int digits) {
  return value ? cell::number(*value, digits) : cell::number("-");
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
    table.row({cell::name(q.key), cell::count(chart.count), figure_cell(chart.mean, 8), figure_cell(chart.sigma, 3),
               figure_cell(chart.lower, 8), figure_cell(chart.upper, 8), cell::count(chart.outside.size()),
               figure_cell(q.limit.min, 5), figure_cell(q.limit.max, 5), index_cell(chart.cpk), index_cell(chart.ppk)},
              hit ? Table::Emphasis::hit : Table::Emphasis::none);
  }
  return table;
}

}  // namespace

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
      const bool here = std::find(group.keys.begin(), group.keys.end(), quantity.key) != group.keys.end();
      const bool same = quantity.chart.sigma == 0.0;  // nothing to see
      if (here && !same && !quantity.values.empty()) figure.panels.push_back(control_panel(quantity));
    }
    if (figure.panels.empty()) continue;
    document.add(Heading{3, "", figure.label}, Scope::page);
    document.figure(figure);
  }
}

Document history_document(const std::vector<StoredCalibration>& all, const std::string& source) {
  using namespace cell;
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
  const std::vector<std::string> columns = {"id",
                                            "unit",
                                            "began_utc",
                                            "time_utc",
                                            "outcome",
                                            "reason",
                                            "station",
                                            "part",
                                            "revision",
                                            "operator",
                                            "ambient",
                                            "simulated",
                                            "temperature_min_c",
                                            "temperature_max_c",
                                            "residual",
                                            "diagnosis",
                                            "recorded_s",
                                            "sessions",
                                            "repeated_dwells",
                                            "lost_samples",
                                            "calibration",
                                            "folder"};
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
