#include "orchestrator/fleet/fleet_text.h"

#include <cmath>
#include <cstdio>

#include "calib/model/effects.h"
#include "orchestrator/figures/report_format.h"

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

std::string with_sigma(double value, double sigma, const std::string& unit) {
  return significant(value, 3) + " +- " + significant(sigma, 2) + (unit.empty() ? "" : " " + unit);
}

std::string where(const FleetEffect& effect) {
  return effect.factor.empty() ? "all units" : effect.factor + " " + effect.level;
}

}  // namespace

std::string describe(const FleetEffect& e, double first_day) {
  const std::string unit = unit_of_component(e.component);
  const bool ramp = e.shape == FleetShape::ramp;
  std::string text = where(e) + ": " + e.component + " " + with_sigma(e.value, e.sigma, unit) + (ramp ? " a day" : "") +
                     " (" + significant(std::abs(e.z), 2) + " sigma, " + std::to_string(e.recordings) + " recordings)";
  if (e.shape != FleetShape::constant)
    text += std::string(ramp ? ", growing" : ", all at once") + " since " + date_of(first_day + e.begin_day) +
            " (95 %: " + date_of(first_day + e.begin_low) + " to " + date_of(first_day + e.begin_high) + ")";
  for (std::size_t k = 0; k < e.rivals.size(); ++k) text += (k == 0 ? "; or " : ", ") + e.rivals[k];
  return text;
}

std::string what_to_do(const FleetEffect& e) {
  if (e.factor != "station") return {};
  const std::string cause = cause_at_station(e.component);
  return cause.empty() ? "" : "look at " + cause;
}

std::vector<std::string> describe(const FleetDiagnosis& d, const FleetSource& source,
                                  const std::vector<std::string>& factors) {
  std::vector<std::string> lines;
  std::string of;
  for (std::size_t f = 0; f < factors.size(); ++f)
    of += ", " + std::to_string(d.levels[f].size()) + " " + factors[f] + (d.levels[f].size() == 1 ? "" : "s");
  std::size_t units = 0;
  for (std::size_t k = 0; k < source.members.size(); ++k)
    units += k == 0 || source.members[k].unit != source.members[k - 1].unit;
  lines.push_back(std::to_string(source.members.size()) + " recordings of " + std::to_string(units) + " units" + of +
                  (source.simulated ? "; simulated" : ""));
  for (const std::string& line : source.skipped) lines.push_back("left out: " + line);
  if (d.effects.empty()) lines.push_back("common to several units: nothing (" + std::to_string(d.tests) + " tests)");
  for (const FleetEffect& e : d.effects) {
    lines.push_back(describe(e, source.first_day));
    if (const std::string hint = what_to_do(e); !hint.empty()) lines.push_back("  " + hint);
  }
  for (const OutstandingUnit& u : d.units) {
    const FleetMember& m = source.members[u.member];
    lines.push_back("unit " + m.unit + " stands out: " + u.component + " " +
                    with_sigma(u.value, u.sigma, unit_of_component(u.component)) + " (" +
                    significant(std::abs(u.z), 2) + " sigma)");
  }
  if (!d.explained())
    lines.push_back("NOT EXPLAINED: what is left at " + d.lack_of_fit_at + " is more than noise, p = 10^" +
                    significant(d.lack_of_fit_log10_p, 2));
  return lines;
}

DataTable table_of(const FleetDiagnosis& d, const FleetSource& source) {
  DataTable table({"what", "level", "component", "shape", "value", "sigma", "unit", "z", "begin", "begin_low",
                   "begin_high", "recordings", "rivals"});
  const auto date = [&](const FleetEffect& e, double day) {
    if (e.shape == FleetShape::constant)
      table.nothing();
    else
      table.text(date_of(source.first_day + day));
  };
  for (const FleetEffect& e : d.effects) {
    table.begin_row();
    table.text(e.factor.empty() ? "all" : e.factor);
    table.text(e.level);
    table.text(e.component);
    table.text(to_string(e.shape));
    table.number(e.value);
    table.number(e.sigma);
    table.text(unit_of_component(e.component));
    table.number(e.z);
    date(e, e.begin_day);
    date(e, e.begin_low);
    date(e, e.begin_high);
    table.count(static_cast<std::int64_t>(e.recordings));
    std::string rivals;
    for (const std::string& r : e.rivals) rivals += (rivals.empty() ? "" : "; ") + r;
    table.text(rivals);
  }
  for (const OutstandingUnit& u : d.units) {
    table.begin_row();
    table.text("unit");
    table.text(source.members[u.member].unit);
    table.text(u.component);
    table.text("constant");
    table.number(u.value);
    table.number(u.sigma);
    table.text(unit_of_component(u.component));
    table.number(u.z);
    for (int k = 0; k < 3; ++k) table.nothing();
    table.count(1);
    table.text("");
  }
  return table;
}

}  // namespace turncal
