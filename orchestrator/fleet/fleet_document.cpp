#include "orchestrator/fleet/fleet_members.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "calib/model/effects.h"

namespace turncal {

std::string unit_of_component(const std::string& component) {
  if (const EffectEntry* const entry = find_effect(component.substr(0, component.find('.'))))
    return std::string(entry->unit);
  constexpr std::string_view of_parameter = "parameter ";
  if (!component.starts_with(of_parameter)) return "";
  const std::string unit = parameter_unit(component.substr(of_parameter.size()), IncrementKind::physical);
  return unit == "-" ? "" : unit;
}

namespace {

using namespace cell;

constexpr std::size_t most_components = 12;  // of the table of levels, the most conspicuous ones
constexpr std::size_t most_levels = 12;

Cell display_unit(const std::string& component, const char* more = "") {
  return text(unit_text(unit_of_component(component)) + more);
}

Cell with_error(double value, double sigma) { return number(plus_minus(value, sigma), value); }

Table effect_table(const FleetDiagnosis& d, const FleetSource& source) {
  Table table{{text("common to"), name("effect"), number("value"), text("unit"), number("sigmas"), number("recordings"),
               text("since (95 %)"), wide("confounded with"), wide("what to check")}};
  for (const FleetEffect& e : d.effects) {
    const auto date = [&](double day) { return date_of(source.first_day + day); };
    const bool ramp = e.shape == FleetShape::ramp;
    const std::string since = e.shape == FleetShape::constant
                                  ? "always"
                                  : fmt::format("{}{} ({} to {})", ramp ? "growing from " : "", date(e.begin_day),
                                                date(e.begin_low), date(e.begin_high));
    table.row({text(e.factor.empty() ? "all units" : e.factor + " " + e.level), name(e.component),
               with_error(e.value, e.sigma), display_unit(e.component, ramp ? " per day" : ""),
               number(std::abs(e.z), 2), count(e.recordings), text(since), wide(join(e.rivals)),
               wide(e.factor == "station" ? cause_at_station(e.component) : "")},
              Table::Emphasis::hit);
  }
  return table;
}

Table unit_table(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors) {
  Table table{{name("unit")}};
  for (const std::string& factor : factors) table.head.push_back(text(factor));
  for (const Cell& column : {name("effect"), number("value"), text("in"), number("sigmas")})
    table.head.push_back(column);
  for (const OutstandingUnit& u : d.units) {
    const FleetMember& m = source.members[u.member];
    std::vector<Cell> row = {name(m.unit)};
    for (const std::string& level : m.level) row.push_back(text(level));
    for (const Cell& column :
         {name(u.component), with_error(u.value, u.sigma), display_unit(u.component), number(std::abs(u.z), 2)})
      row.push_back(column);
    table.row(std::move(row));
  }
  return table;
}

// The most conspicuous components, by level of one factor: what is left after what was found.
Table level_table(const FleetDiagnosis& d, std::size_t factor) {
  const auto worst_z = [](const ComponentSummary& c) {
    double worst = 0.0;
    for (const auto& levels : c.levels)
      for (const FleetEstimate& level : levels) worst = std::max(worst, std::abs(level.z));
    return worst;
  };
  std::vector<const ComponentSummary*> chosen;
  for (const ComponentSummary& c : d.components) chosen.push_back(&c);
  std::ranges::stable_sort(chosen, [&](const auto* a, const auto* b) { return worst_z(*a) > worst_z(*b); });
  chosen.resize(std::min(chosen.size(), most_components));
  Table table{
      {name("effect"), text("unit"), number("one recording"), number("scatter of units"), number("scatter of levels")}};
  const std::size_t levels = std::min(d.levels[factor].size(), most_levels);
  for (std::size_t l = 0; l < levels; ++l) table.head.push_back(number(d.levels[factor][l]));
  for (const ComponentSummary* c : chosen) {
    const std::string key = c->component.substr(c->component.find(' ') + 1), meaning = quantity_name(key);
    std::vector<Cell> row = {name(c->component + (meaning == key ? "" : ", " + meaning)), display_unit(c->component),
                             number(c->one_unit, 2), number(c->unit_scatter, 2),
                             c->factor_scatter.empty() ? number("") : number(c->factor_scatter[factor], 2)};
    for (std::size_t l = 0; l < levels; ++l) {
      const FleetEstimate& level = c->levels[factor][l];
      row.push_back(number(significant(level.value, 2) + " (" + significant(level.z, 2) + ")", level.value));
    }
    table.row(std::move(row));
  }
  return table;
}

// One panel a level, a point a recording.
Figure figure_of(const FleetEffect& effect, const FleetSource& source, const std::vector<std::string>& factors,
                 const FleetDiagnosis& d, std::size_t place_in_list) {
  const auto place = std::ranges::find(factors, effect.factor.empty() ? factors.front() : effect.factor);
  const auto f = std::size_t(place - factors.begin());
  Figure figure = small_panels("effect" + std::to_string(place_in_list),
                               effect.component + ", " + unit_of_component(effect.component),
                               "A point is a recording, over days since " + date_of(source.first_day) +
                                   "; the line is the effect that was found.");
  double last = 0.0;
  std::vector<double> sizes;
  std::vector<std::vector<std::pair<double, double>>> points(d.levels[f].size());
  for (const FleetMember& m : source.members) {
    const auto column = std::ranges::find(m.statistics.columns, effect.component);
    if (column == m.statistics.columns.end() || !std::isfinite(m.day)) continue;
    const auto k = column - m.statistics.columns.begin();
    const double Q = double(m.statistics.Q(k, k));
    if (!(Q > 0.0)) continue;
    const auto level = std::ranges::find(d.levels[f], m.level[f]) - d.levels[f].begin();
    points[std::size_t(level)].emplace_back(m.day, m.statistics.s[k] / Q);
    sizes.push_back(std::abs(m.statistics.s[k] / Q));
    last = std::max(last, m.day);
  }
  if (sizes.empty()) return figure;
  std::ranges::sort(sizes);
  const double limit = 1.3 * sizes[sizes.size() * 98 / 100];
  for (std::size_t l = 0; l < std::min(points.size(), most_levels); ++l) {
    const bool here = effect.factor.empty() || d.levels[f][l] == effect.level;
    Panel panel;
    panel.title = factors[f] + " " + d.levels[f][l];
    panel.x_label = "day";
    panel.y_limit = limit;
    panel.whole_frame = true;
    panel.series.push_back({"", Series::Style::dot, here ? Colour::before : Colour::after, points[l]});
    if (here) {
      const double begin = effect.shape == FleetShape::constant ? 0.0 : effect.begin_day;
      const double end = effect.shape == FleetShape::ramp ? effect.value * (last - begin) : effect.value;
      const double first = effect.shape == FleetShape::ramp ? 0.0 : effect.value;
      panel.series.push_back({"", Series::Style::line, Colour::neutral, {{begin, first}, {last, end}}});
    }
    figure.panels.push_back(std::move(panel));
  }
  return figure;
}

std::string head_text(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors) {
  std::string of;
  for (std::size_t f = 0; f < factors.size(); ++f)
    of += fmt::format(", {} {}{}", d.levels[f].size(), factors[f], d.levels[f].size() == 1 ? "" : "s");
  std::size_t units = 0;
  for (std::size_t k = 0; k < source.members.size(); ++k)
    units += k == 0 || source.members[k].unit != source.members[k - 1].unit;
  return fmt::format("{} recordings of {} units{}{}", source.members.size(), units, of,
                     source.simulated ? "; simulated" : "");
}

}  // namespace

Document fleet_document(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors) {
  Document document{"turncal: fleet", "Fleet"};
  document.soft(head_text(d, source, factors), Scope::all);
  for (const std::string& line : source.skipped) document.soft("left out: " + line, Scope::all);
  std::set<std::string> outstanding;
  for (const OutstandingUnit& u : d.units) outstanding.insert(source.members[u.member].unit);
  const bool clean = d.effects.empty() && d.units.empty() && d.explained();
  document.add(
      Paragraph{clean ? fmt::format("Clean: no common effect found in {} tests, and no unit stands out.", d.tests)
                      : fmt::format("Found: effects common to several units: {}; units that stand out: {}.",
                                    d.effects.size(), outstanding.size()),
                clean ? "verdict clean" : "verdict extended"},
      Scope::page);
  document.section("common", "Common to several units");
  if (d.effects.empty())
    document.text(fmt::format("No common effect found in {} tests.", d.tests));
  else
    document.add(effect_table(d, source));
  if (!d.explained())
    document.text("NOT EXPLAINED: the residual at " + d.lack_of_fit_at + " is more than noise, p = 10^" +
                  significant(d.lack_of_fit_log10_p, 2) + ".");
  for (std::size_t k = 0; k < d.effects.size(); ++k) {
    const Figure figure = figure_of(d.effects[k], source, factors, d, k + 1);
    if (figure.panels.empty()) continue;
    document.add(Heading{3, "", figure.label}, Scope::page);
    document.figure(figure);
  }
  for (std::size_t f = 0; f < factors.size() && !d.components.empty(); ++f) {
    document.add(Heading{2, "by-" + factors[f], "By " + factors[f] + ": remaining effects"}, Scope::page);
    document.add(level_table(d, f), Scope::page);
    document.soft("In brackets: the value in its own sigmas; of parameters, the difference from the other levels.");
  }
  document.section("units", "Units that stand out");
  if (d.units.empty())
    document.text("None.");
  else
    document.add(unit_table(d, source, factors));
  return document;
}

DataTable table_of(const FleetDiagnosis& d, const FleetSource& source) {
  DataTable table({"what", "level", "component", "shape", "value", "sigma", "unit", "z", "begin", "begin_low",
                   "begin_high", "recordings", "rivals"});
  const auto begin = [&table](const std::string& what, const std::string& level, const std::string& component,
                              FleetShape shape, double value, double sigma, double z) {
    table.begin_row();
    for (const std::string& word : {what, level, component, std::string(to_string(shape))}) table.text(word);
    table.number(value);
    table.number(sigma);
    table.text(unit_of_component(component));
    table.number(z);
  };
  const auto date = [&](const FleetEffect& e, double day) {
    if (e.shape == FleetShape::constant)
      table.nothing();
    else
      table.text(date_of(source.first_day + day));
  };
  for (const FleetEffect& e : d.effects) {
    begin(e.factor.empty() ? "all" : e.factor, e.level, e.component, e.shape, e.value, e.sigma, e.z);
    for (const double day : {e.begin_day, e.begin_low, e.begin_high}) date(e, day);
    table.count(std::int64_t(e.recordings));
    table.text(join(e.rivals, "; "));
  }
  for (const OutstandingUnit& u : d.units) {
    begin("unit", source.members[u.member].unit, u.component, FleetShape::constant, u.value, u.sigma, u.z);
    for (int k = 0; k < 3; ++k) table.nothing();
    table.count(1);
    table.text("");
  }
  return table;
}

}  // namespace turncal
