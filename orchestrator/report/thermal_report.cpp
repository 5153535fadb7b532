#include "orchestrator/report/thermal_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/evidence/statement.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

using namespace cell;

constexpr int curve_points = 41;
constexpr std::array<const char*, 7> term_names = {"0", "1", "2", "3", "rate", "hysteresis", "loop"};

DisplayUnit error_unit_of(const ThermalReport& report, int key) {
  const double nominal = key < 15 && report.gyro_increment == IncrementKind::pulses ? 0.932920 : 1.0;
  const std::string name = parameter_key(key);
  return error_unit(name, parameter_unit(name, report.gyro_increment), nominal);
}

template <class Numbers>
std::string list_of(const Numbers& numbers) {
  std::vector<std::string> texts;
  for (const double x : numbers) texts.push_back(format_number(x));
  return join(texts);
}

double temperature_at(const ThermalModel& model, int k) {
  return model.low_c + (model.high_c - model.low_c) * k / (curve_points - 1);
}

// Returns "order 2 (more than 0.99), rate (0.97)"; an uncertain statement has its probability.
std::string what_is_said(const ThermalParameter& p) {
  const int order = p.said_order();
  std::string text =
      order == 0 ? "constant" : fmt::format("order {} ({})", order, words_of_probability(p.at_least(order)));
  if (p.smooth >= said_from) text = "no polynomial (" + words_of_probability(p.smooth) + ")";
  if (order < 3 && p.smooth < said_from && p.at_least(order + 1) >= listed_from)
    text += fmt::format(", maybe more ({})", words_of_probability(p.at_least(order + 1)));
  for (const auto& [name, of] : {std::pair{"rate", p.rate}, std::pair{"hysteresis", p.hysteresis}})
    if (of >= listed_from)
      text += fmt::format(", {}{} ({})", of < said_from ? "maybe " : "", name, words_of_probability(of));
  return text;
}

Table error_table(const ThermalReport& report) {
  Table table{{text("left-out temperatures, rms"), text("unit"), number("constant"), number("with temperature"),
               number("as expected"), number("the leg's own sigma")}};
  const auto kind_of = [](int key) {
    if (key < 6) return key / 3;
    const bool gyro = key < 15, diagonal = (key - (gyro ? 6 : 15)) % 4 == 0;
    return (diagonal ? 2 : 4) + (gyro ? 0 : 1);
  };
  constexpr std::array<const char*, 6> kinds = {"gyro bias",         "accelerometer bias",
                                                "gyro scale factor", "accelerometer scale factor",
                                                "gyro misalignment", "accelerometer misalignment"};
  for (int kind = 0; kind < 6; ++kind) {
    std::array<double, 4> sum{};  // sum of squares over the kind's parameters
    double count = 0.0;
    std::string unit;
    for (const ThermalParameter& p : report.model.parameters) {
      if (kind_of(p.key) != kind) continue;
      const DisplayUnit of = error_unit_of(report, p.key);
      for (std::size_t k = 0; k < 4; ++k) sum[k] += std::pow(of.factor * p.left_out[k], 2);
      count += 1.0, unit = of.unit;
    }
    for (double& s : sum) s = std::sqrt(s / count);
    if (count > 0.0)
      table.row(
          {text(kinds[std::size_t(kind)]), text(unit), number(sum[0]), number(sum[1]), number(sum[2]), number(sum[3])});
  }
  table.row({text("free navigation at rest, 1 h"), text("NM/h"), number(report.before_nm_per_h),
             number(report.after_nm_per_h), number("-"), number(report.noise_nm_per_h)});
  return table;
}

Figure figure_of(const ThermalReport& report, std::size_t j) {
  const ThermalModel& model = report.model;
  const ThermalParameter& p = model.parameters[j];
  const DisplayUnit unit = error_unit_of(report, p.key);
  const auto points = [](std::string label, Series::Style style, Colour colour) {
    return Series{std::move(label), style, colour, {}};
  };
  Series middle = points("average over models", Series::Style::line, Colour::after),
         low = points("two sigma", Series::Style::dashed, Colour::after),
         high = points("", Series::Style::dashed, Colour::after),
         up = points("legs, from below", Series::Style::triangle, Colour::before),
         down = points("legs, from above", Series::Style::open_circle, Colour::before), off_up = up, off_down = down,
         least = points("two sigma of a leg", Series::Style::dashed, Colour::neutral),
         most = points("", Series::Style::dashed, Colour::neutral);
  const double reference = model.coefficient(j, 0);
  for (int k = 0; k < curve_points; ++k) {
    const double t = temperature_at(model, k);
    const ThermalPoint at = evaluate(model, t);
    const double value = unit.factor * (at.value[p.key] - reference),
                 two = 2.0 * unit.factor * std::sqrt(std::max(0.0, at.covariance(p.key, p.key)));
    middle.points.emplace_back(t, value), low.points.emplace_back(t, value - two),
        high.points.emplace_back(t, value + two);
    const double band = 2.0 * unit.factor * p.left_out[3];
    if (band > 0.0) least.points.emplace_back(t, -band), most.points.emplace_back(t, band);
  }
  for (std::size_t k = 0; k < report.legs.size(); ++k) {
    const ThermalLeg& leg = report.legs[k];
    if (std::ranges::find(leg.free, p.key) == leg.free.end()) continue;
    const bool below = leg.direction >= 0;
    (below ? up : down).points.emplace_back(leg.temperature_c, unit.factor * (leg.value[p.key] - reference));
    (below ? off_up : off_down)
        .points.emplace_back(leg.temperature_c, unit.factor * (leg.value[p.key] - model.at_legs[k][p.key]));
  }
  const std::string key = parameter_key(p.key);
  Figure figure{"thermal" + key, key + " against temperature, and what the model leaves of each leg", ""};
  figure.stacked = true;
  figure.panels.resize(2);
  figure.panels[0].title = key + ", " + quantity_name(key) + ": " + what_is_said(p);
  figure.panels[0].y_label = fmt::format("from that at {:.1f} °C, {}", model.reference_c, unit.unit);
  figure.panels[0].series = {up, down, middle, low, high};
  figure.panels[1].x_label = "temperature, °C";
  figure.panels[1].y_label = "residual, " + std::string(unit.unit);
  figure.panels[1].series = {off_up, off_down, least, most};
  return figure;
}

}  // namespace

std::string format_thermal(const ThermalReport& report) {
  const ThermalModel& model = report.model;
  KeyValues lines;
  lines.comment("turncal thermal: parameters as functions of temperature, an average over models (docs/thermal.md)");
  if (report.simulated) lines.comment("simulated data: a dry run, or a twin");
  lines.text("unit_serial", report.unit);
  lines.number("reference_c", model.reference_c);
  lines.text("range_c", list_of(std::array{model.low_c, model.high_c}));
  lines.number("temperatures", model.temperatures);
  lines.number("most_order", model.most_order);
  for (std::size_t k = 0; k < report.legs.size(); ++k) {
    const ThermalLeg& leg = report.legs[k];
    const std::string begin = fmt::format("leg.{}.", k + 1);
    lines.text(begin + "name", leg.name);
    lines.number(begin + "temperature_c", leg.temperature_c);
    lines.number(begin + "rate_c_per_h", leg.rate_c_per_h);
    lines.text(begin + "direction", leg.direction > 0 ? "up" : leg.direction < 0 ? "down" : "unknown");
    lines.number(begin + "switch_on", leg.switch_on);
  }
  std::vector<double> grid;
  for (int k = 0; k < curve_points; k += 2) grid.push_back(temperature_at(model, k));
  lines.text("curve_c", list_of(grid));
  std::vector<std::pair<Eigen::Index, std::string>> rows;
  for (std::size_t j = 0; j < model.parameters.size(); ++j) {
    const ThermalParameter& p = model.parameters[j];
    const std::string begin = parameter_key(p.key) + ".";
    for (int c = 0; c < int(term_names.size()); ++c) {
      if (c > 0 && model.coefficient(j, c) == 0.0) continue;
      const std::string name = begin + term_names[std::size_t(c)];
      lines.number("coefficient." + name, model.coefficient(j, c));
      lines.number("sigma." + name, model.sigma(j, c));
      rows.emplace_back(Eigen::Index(j) * thermal_columns + c, name);
    }
    lines.text("probability." + begin + "order", list_of(p.order));
    lines.number("probability." + begin + "smooth", p.smooth);
    lines.number("probability." + begin + "rate", p.rate);
    lines.number("probability." + begin + "hysteresis", p.hysteresis);
    if (p.smooth >= listed_from) {
      std::vector<double> values;
      for (const double t : grid) values.push_back(evaluate(model, t).value[p.key]);
      lines.text("curve." + parameter_key(p.key), list_of(values));
    }
    if (p.key < 6) lines.number("switch_on." + parameter_key(p.key), p.switch_on);
    for (std::size_t k = 0; k < 4; ++k)
      lines.number("left_out." + begin + std::array{"constant", "with_temperature", "expected", "leg"}[k],
                   p.left_out[k]);
  }
  lines.number("lag_h", model.lag_h());
  lines.number("sigma.lag_h", model.lag_sigma_h());
  lines.number("probability.lag", model.lag);
  lines.number("navigation.constant_nm_per_h", report.before_nm_per_h);
  lines.number("navigation.with_temperature_nm_per_h", report.after_nm_per_h);
  lines.number("navigation.leg_nm_per_h", report.noise_nm_per_h);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::vector<double> row;
    for (std::size_t j = 0; j <= i; ++j) row.push_back(model.covariance(rows[i].first, rows[j].first));
    lines.text("covariance." + rows[i].second, fmt::format("{:.6e}", fmt::join(row, " ")));
  }
  return lines.take();
}

Document thermal_document(const ThermalReport& report) {
  const ThermalModel& model = report.model;
  Document document{"Temperature of " + report.unit, "Parameters as functions of temperature, unit " + report.unit};
  if (report.simulated) document.add(Paragraph{"SIMULATED: a dry run, or a twin.", "loud"});
  document.text(fmt::format("Legs: {}, at {} temperatures, {:.1f} to {:.1f} °C, parameters at {:.1f} °C.",
                            report.legs.size(), model.temperatures, model.low_c, model.high_c, model.reference_c));
  for (const std::string& note : report.notes) document.add(Paragraph{note, "note"});
  for (const std::string& note : model.notes) document.add(Paragraph{note, "note"});
  if (model.lag >= listed_from)
    document.text(fmt::format("Lag of the sensors behind the thermometer: {} ({}).",
                              quantity(model.lag_h(), model.lag_sigma_h(), "h"), words_of_probability(model.lag)));
  document.section("errors", "Error of the model");
  document.add(error_table(report));
  document.section("parameters", "Parameters");
  Table table{{name("parameter"), text("meaning"), number("switch-on, 1σ"), number("constant"), number("with temp."),
               text("unit"), wide("depends on temperature as")}};
  for (const ThermalParameter& p : model.parameters) {
    const DisplayUnit unit = error_unit_of(report, p.key);
    const std::string key = parameter_key(p.key);
    table.row({name(key), text(quantity_name(key)), p.key < 6 ? number(unit.factor * p.switch_on) : number("-"),
               number(unit.factor * p.left_out[0]), number(unit.factor * p.left_out[1]), text(unit.unit),
               wide(what_is_said(p))});
  }
  document.add(std::move(table));
  Table legs{{name("leg"), number("temperature, °C"), number("rate, °C/h"), text("from"), number("switch-on")}};
  for (const ThermalLeg& leg : report.legs)
    legs.row({name(leg.name), fixed(leg.temperature_c, 2), fixed(leg.rate_c_per_h, 2),
              text(leg.direction > 0   ? "below"
                   : leg.direction < 0 ? "above"
                                       : "-"),
              number(std::to_string(leg.switch_on))});
  document.section("legs", "Legs");
  document.add(std::move(legs));
  document.add(Heading{2, "curves", "Each parameter"}, Scope::page);
  for (std::size_t j = 0; j < model.parameters.size(); ++j) document.figure(figure_of(report, j));
  return document;
}

void describe_thermal(const ThermalModel& model, ParameterFile& file) {
  TemperaturePolynomials& t = file.temperature.emplace();
  t.reference_c = model.reference_c, t.low_c = model.low_c, t.high_c = model.high_c;
  file.reference_temperature_c = model.reference_c;
  file.sigma = {};
  std::vector<std::string> open;
  for (int key = 0; key < parameter_count; ++key)
    if (!model.find(key) && parameter_is_free[std::size_t(key)]) open.push_back(parameter_key(key));
  if (!open.empty()) file.add_further(std::string(undetermined_key), join(open, " "));
  for (std::size_t j = 0; j < model.parameters.size(); ++j) {
    const ThermalParameter& p = model.parameters[j];
    file.parameters[p.key] = model.coefficient(j, 0);
    file.sigma[std::size_t(p.key)] = model.sigma(j, 0);
    for (int order = 1; order <= 3; ++order)
      if (model.coefficient(j, order) != 0.0)
        t.coefficient(p.key, order - 1) = model.coefficient(j, order),
                                     t.sigma(p.key, order - 1) = model.sigma(j, order);
    std::vector<double> row;  // parameters in the order of their keys
    for (std::size_t k = 0; k <= j; ++k)
      row.push_back(model.covariance(Eigen::Index(j) * thermal_columns, Eigen::Index(k) * thermal_columns));
    file.add_further("quality.covariance." + parameter_key(p.key), fmt::format("{:.9e}", fmt::join(row, " ")));
    if (p.key < 6) file.add_further("quality.turn_on_repeatability." + parameter_key(p.key), p.switch_on);
    if (const double worst = off_its_cubic(model, j); worst > model.sigma(j, 0))
      file.add_further("quality.temperature.not_held." + parameter_key(p.key), worst);
  }
}

}  // namespace turncal
