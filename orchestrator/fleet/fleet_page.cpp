#include "orchestrator/fleet/fleet_page.h"

#include <algorithm>
#include <cmath>

#include "orchestrator/figures/report_format.h"
#include "orchestrator/fleet/fleet_text.h"
#include "orchestrator/report/html_table.h"
#include "orchestrator/report/report_page.h"

namespace turncal {
namespace {

constexpr std::size_t most_components = 12;  // of the table of levels, the most conspicuous ones
constexpr std::size_t most_levels = 12;

double worst_z(const ComponentSummary& c) {
  double worst = 0.0;
  for (const auto& factor : c.levels)
    for (const ComponentLevel& level : factor) worst = std::max(worst, std::abs(level.z));
  return worst;
}

std::string effect_table(const FleetDiagnosis& d, const FleetSource& source) {
  html::HtmlTable table({html::text("common to"), html::text("effect"), html::number("value"), html::text(""),
                         html::number("sigmas"), html::text("since (95 %)"), html::text("or"),
                         html::text("what to look at")});
  for (const FleetEffect& e : d.effects) {
    std::string since = "always", rivals;
    if (e.shape != FleetShape::constant)
      since = date_of(source.first_day + e.begin_day) + " (" + date_of(source.first_day + e.begin_low) + " to " +
              date_of(source.first_day + e.begin_high) + ")";
    for (const std::string& r : e.rivals) rivals += (rivals.empty() ? "" : ", ") + r;
    table.row({html::text(e.factor.empty() ? "all units" : e.factor + " " + e.level), html::name(e.component),
               html::number(significant(e.value, 3) + " ± " + significant(e.sigma, 2)),
               html::text(unit_of_component(e.component) + (e.shape == FleetShape::ramp ? " a day" : "")),
               html::number(significant(std::abs(e.z), 2)), html::long_text(since), html::long_text(rivals),
               html::long_text(what_to_do(e))},
              "hit");
  }
  return table.finish();
}

std::string unit_table(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors) {
  std::vector<html::Cell> head = {html::text("unit")};
  for (const std::string& factor : factors) head.push_back(html::text(factor));
  for (const char* name : {"effect", "value", "", "sigmas"}) head.push_back(html::text(name));
  html::HtmlTable table(head);
  for (const OutstandingUnit& u : d.units) {
    const FleetMember& m = source.members[u.member];
    std::vector<html::Cell> row = {html::name(m.unit)};
    for (const std::string& level : m.level) row.push_back(html::text(level));
    row.push_back(html::name(u.component));
    row.push_back(html::number(significant(u.value, 3) + " ± " + significant(u.sigma, 2)));
    row.push_back(html::text(unit_of_component(u.component)));
    row.push_back(html::number(significant(std::abs(u.z), 2)));
    table.row(row);
  }
  return table.finish();
}

// The most conspicuous components, by level of one factor: what is left after what was found.
std::string level_table(const FleetDiagnosis& d, std::size_t factor) {
  std::vector<const ComponentSummary*> chosen;
  for (const ComponentSummary& c : d.components) chosen.push_back(&c);
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const auto* a, const auto* b) { return worst_z(*a) > worst_z(*b); });
  chosen.resize(std::min(chosen.size(), most_components));
  std::vector<html::Cell> head = {html::text("effect"), html::text(""), html::number("one recording"),
                                  html::number("scatter of units"), html::number("scatter of levels")};
  const std::size_t levels = std::min(d.levels[factor].size(), most_levels);
  for (std::size_t l = 0; l < levels; ++l) head.push_back(html::number(d.levels[factor][l]));
  html::HtmlTable table(head);
  for (const ComponentSummary* c : chosen) {
    std::vector<html::Cell> row = {
        html::name(c->component), html::text(unit_of_component(c->component)),
        html::number(significant(c->one_unit, 2)), html::number(significant(c->unit_scatter, 2)),
        html::number(c->factor_scatter.empty() ? "" : significant(c->factor_scatter[factor], 2))};
    for (std::size_t l = 0; l < levels; ++l) {
      const ComponentLevel& level = c->levels[factor][l];
      row.push_back(html::number(significant(level.value, 2) + " (" + significant(level.z, 2) + ")"));
    }
    table.row(row);
  }
  return table.finish();
}

// One panel a level, a point a recording.
Figure figure_of(const FleetEffect& effect, const FleetSource& source, const std::vector<std::string>& factors,
                 const FleetDiagnosis& d, std::size_t number) {
  const auto place = std::find(factors.begin(), factors.end(), effect.factor.empty() ? factors.front() : effect.factor);
  const auto f = static_cast<std::size_t>(place - factors.begin());
  Figure figure{.id = "effect" + std::to_string(number),
                .label = effect.component + ", " + unit_of_component(effect.component),
                .caption = "A point is a recording, over days since " + date_of(source.first_day) +
                           "; the line is what was found.",
                .columns = 3,
                .panel_width = 320,
                .panel_height = 200,
                .panels = {}};
  double last = 0.0;
  std::vector<double> sizes;
  std::vector<std::vector<std::pair<double, double>>> points(d.levels[f].size());
  for (const FleetMember& m : source.members) {
    const auto column = std::find(m.statistics.columns.begin(), m.statistics.columns.end(), effect.component);
    if (column == m.statistics.columns.end() || !std::isfinite(m.day)) continue;
    const auto k = column - m.statistics.columns.begin();
    const double Q = static_cast<double>(m.statistics.Q(k, k));
    if (!(Q > 0.0)) continue;
    const auto level = std::find(d.levels[f].begin(), d.levels[f].end(), m.level[f]) - d.levels[f].begin();
    points[static_cast<std::size_t>(level)].emplace_back(m.day, m.statistics.s[k] / Q);
    sizes.push_back(std::abs(m.statistics.s[k] / Q));
    last = std::max(last, m.day);
  }
  if (sizes.empty()) return figure;
  std::sort(sizes.begin(), sizes.end());
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

}  // namespace

std::string fleet_page(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors,
                       const GnuplotOptions& gnuplot) {
  Plots plots;
  std::vector<Figure> figures;
  for (std::size_t k = 0; k < d.effects.size(); ++k) {
    const Figure figure = figure_of(d.effects[k], source, factors, d, k + 1);
    if (!figure.panels.empty()) figures.push_back(plots.add(figure));
  }
  plots.render_all(gnuplot);
  Page page("turncal: fleet");
  const std::vector<std::string> words = describe(d, source, factors);
  page.raw("<h1>Fleet</h1>\n<p class=\"soft\">" + html_escape(words.front()) + "</p>\n");
  page.section("common", "Common to several units");
  if (d.effects.empty())
    page.text("Nothing that " + std::to_string(d.tests) + " tests find.");
  else
    page.raw(effect_table(d, source));
  if (!d.explained()) page.text(words.back() + ".");
  for (const Figure& figure : figures) {
    page.subsection(figure.label);
    page.raw(plots.html(figure));
  }
  for (std::size_t f = 0; f < factors.size(); ++f) {
    if (d.levels[f].size() < 2) continue;  // nothing to compare
    page.section("by-" + factors[f], "By " + factors[f] + ", what is left");
    page.raw(level_table(d, f));
    page.raw(
        html::paragraph("In brackets: in its own sigmas, from nothing; of parameters from the other levels.", "soft"));
  }
  page.section("units", "Units that stand out");
  if (d.units.empty())
    page.text("None.");
  else
    page.raw(unit_table(d, source, factors));
  return page.finish();
}

}  // namespace turncal
