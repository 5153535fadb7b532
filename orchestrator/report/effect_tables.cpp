// The tables of the report that are about effects: added, scored, tried, and what the recording cannot see.
#include "orchestrator/report/report_tables.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "orchestrator/figures/report_format.h"
#include "orchestrator/figures/score_chart.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/html_table.h"

namespace turncal {

using namespace html;

namespace {

std::string component_text(const EffectColumn& column) {
  std::string result(column.entry->components[static_cast<std::size_t>(column.component)]);
  if (column.tau_s > 0.0)
    result += column.entry->variant == "tau_s" ? ", τ " + significant(column.tau_s, 3) + " s"
                                               : ", w0 " + significant(column.tau_s, 3) + " deg/h";
  return result;
}
std::string key_text(const EffectColumn& column) {
  if (column.entry == nullptr) return "-";
  return std::string(column.entry->name) + "." + component_text(column);
}

std::string probability(double p) { return p < 1e-300 ? "< 1×10⁻³⁰⁰" : significant(p, 2, typo); }

}  // namespace

std::string html_added_effects(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  std::vector<Cell> head = {text("effect"),
                            text("component"),
                            number("value"),
                            number("σ"),
                            text("unit"),
                            number("z"),
                            text("added to the reading"),
                            text("term")};
  if (context.worth) head.insert(head.begin() + 6, number("nm/h"));
  HtmlTable table(head);
  for (const std::string& wanted : diagnosis.effect_names) {
    std::string worth;  // of the whole effect, in its first row
    if (context.worth)
      for (const auto& [effect, rate] : context.worth->effects)
        if (effect == wanted) worth = significant(rate, 2);
    for (const EstimatedEffect& e : diagnosis.extended.effects) {
      if (e.column.entry == nullptr || e.column.entry->name != wanted) continue;
      std::vector<Cell> cells = {name(wanted),
                                 name(component_text(e.column)),
                                 number(value_with_sigma(e.value, e.sigma, typo)),
                                 number(value_with_sigma(e.sigma, e.sigma, typo)),
                                 text(unit_text(e.column.entry->unit, typo)),
                                 number(e.sigma > 0.0 ? std::abs(e.value) / e.sigma : 0.0),
                                 text(e.column.entry->formula),
                                 long_text(e.column.entry->term)};
      if (context.worth) cells.insert(cells.begin() + 6, number(std::exchange(worth, "")));
      table.row(cells);
    }
  }
  std::string html = table.finish();
  if (context.worth)
    html += paragraph(
        "nm/h: what leaving out the whole effect moves the track of free inertial navigation by, the "
        "other parameters estimated without it. Noise is the same in both tracks; alone it lets expect " +
            significant(context.worth->noise, 2) + " nm/h after " + significant(context.worth->free_s, 4) + " s.",
        "soft");
  return html;
}

std::string html_scores(const Diagnosis& diagnosis, double threshold_z) {
  HtmlTable table({text("effect"), text("strongest"), number("value alone"), number("σ"), text("unit"), number("|z|"),
                   number("detectable"), number("χ² of all"), number("directions"), number("p")});
  for (const ScoreBar& row : score_bars(diagnosis, threshold_z)) {
    const EffectEntry* entry = find_effect(row.name);
    if (row.role == ScoreBar::Role::invisible || entry == nullptr) continue;
    const CandidateScore* best = nullptr;
    for (const CandidateScore& c : diagnosis.candidates)
      if (c.column.entry == entry && c.visible && (best == nullptr || std::abs(c.z) > std::abs(best->z))) best = &c;
    if (best == nullptr) continue;
    std::vector<Cell> cells = {name(row.name),
                               name(component_text(best->column)),
                               number(value_with_sigma(best->value, best->sigma, typo)),
                               number(value_with_sigma(best->sigma, best->sigma, typo)),
                               text(unit_text(entry->unit, typo)),
                               number(std::abs(best->z)),
                               number(best->detectable, 2)};
    const auto group = std::find_if(diagnosis.groups.begin(), diagnosis.groups.end(),
                                    [&](const GroupScore& g) { return g.name == row.name; });
    if (group != diagnosis.groups.end()) {
      cells.push_back(number(group->chi_square));
      cells.push_back(number(std::to_string(group->rank) + " of " + std::to_string(entry->components.size())));
      cells.push_back(number(probability(group->p_value)));
    } else {
      for (int k = 0; k < 3; ++k) cells.push_back(number("-"));
    }
    table.row(cells, row.role == ScoreBar::Role::below ? "" : "hit");
  }
  return table.finish() + paragraph(
                              "χ² tests all components of an effect together, in as many directions as the recording "
                              "can tell apart; p is for "
                              "that one test, not for the family.",
                              "soft");
}

std::string html_components(const Diagnosis& diagnosis, double threshold_z) {
  HtmlTable table(
      {text("component"), number("value alone"), number("σ"), text("unit"), number("z"), number("detectable (5 σ)")});
  for (const CandidateScore& c : diagnosis.candidates) {
    if (c.column.entry == nullptr) continue;
    const std::string unit = unit_text(c.column.entry->unit, typo);
    if (!c.visible) {
      table.row({name(key_text(c.column)), number("not visible"), number("-"), text(unit), number("-"), number("-")},
                "dim");
      continue;
    }
    table.row({name(key_text(c.column)), number(value_with_sigma(c.value, c.sigma, typo)),
               number(value_with_sigma(c.sigma, c.sigma, typo)), text(unit), number(signed_number(c.z, 1)),
               number(c.detectable, 2)},
              std::abs(c.z) > threshold_z ? "hit" : "");
  }
  return table.finish();
}

std::string html_limits(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  std::string html;
  bool any_alias = false;
  for (const auto& [wanted, others] : diagnosis.aliases) {
    if (others.empty()) continue;
    if (!any_alias) html += heading("Effects it cannot tell apart") + "<ul>\n";
    any_alias = true;
    std::string line = "<b>" + html_escape(wanted) + "</b> could as well be " + html_escape(join(others)) + ".";
    const auto by = diagnosis.separate_by.find(wanted);
    if (by != diagnosis.separate_by.end() && !by->second.empty())
      line += " Positions or rates that would separate them: " + html_escape(by->second) + ".";
    html += item(line);
  }
  if (any_alias) html += "</ul>\n";
  if (any_alias && !context.hand_turned)
    html += paragraph(
        "The sequence sequences/extended.seq has such positions and rates; turncal predict shows by how much "
        "they help.",
        "soft");
  if (!diagnosis.gated_out.empty())
    html += heading("Found but not confirmed") +
            paragraph(
                join(diagnosis.gated_out, "; ") +
                (context.hand_turned ? "." : ": fitted the recording better but not the held-out data, so not added."));
  html += heading("Effects it cannot see");
  if (diagnosis.undetectable.empty()) {
    html += paragraph(
        "Every effect of the catalogue would be seen if it were large enough; the smallest size of each is listed "
        "under "
        "“detectable”.");
  } else {
    HtmlTable table({text("effect"), text("what would show it")});
    for (const std::string& wanted : diagnosis.undetectable) {
      const EffectEntry* entry = find_effect(wanted);
      table.row({name(wanted), long_text(entry != nullptr ? entry->seen_by : "")});
    }
    html += table.finish();
  }
  std::vector<std::string> blind;
  for (const CandidateScore& c : diagnosis.candidates) {
    if (c.visible || c.column.entry == nullptr) continue;
    if (std::find(diagnosis.undetectable.begin(), diagnosis.undetectable.end(), c.column.entry->name) ==
        diagnosis.undetectable.end())
      blind.push_back(key_text(c.column));
  }
  if (!blind.empty()) html += paragraph("Single components it cannot see: " + join(blind) + ".");
  html +=
      heading(context.hand_turned ? "Never observable without a table" : "Never observable on such a table") + "<ul>\n";
  if (context.hand_turned) {
    html += item(html_escape(unobservable_quantities().front())) +
            item(
                "headings, and with them everything that depends on the heading alone: the horizontal earth rate, the "
                "earth's field");
  } else {
    for (const std::string_view quantity_name : unobservable_quantities()) html += item(html_escape(quantity_name));
  }
  return html + "</ul>\n";
}

std::string html_selection(const Diagnosis& diagnosis) {
  std::string html;
  if (diagnosis.stages.empty()) {
    html += paragraph("No candidate was strong enough to be tried.");
  } else {
    HtmlTable table({number("stage"), text("tried"), number("z"), number("gain 2 Δ ln L"), number("needed"),
                     text("result"), text("rivals (their z²)")});
    for (std::size_t k = 0; k < diagnosis.stages.size(); ++k) {
      const SelectionStage& s = diagnosis.stages[k];
      std::vector<std::string> rivals;
      for (const auto& [rival, z_square] : s.rivals) rivals.push_back(rival + " " + significant(z_square, 3));
      const std::string result = s.note.empty() ? s.accepted ? "accepted" : "not accepted" : s.note;
      table.row(
          {number(std::to_string(k + 1)), name(key_text(s.chosen)), number(signed_number(s.z, 1)), number(s.gain, 3),
           number(s.threshold, 3), long_text(result), long_text(rivals.empty() ? "-" : join(rivals))},
          s.accepted ? "" : "dim");
    }
    html += table.finish();
  }
  if (!diagnosis.gated_out.empty())
    html += paragraph("Taken out again, because the error on held-out data did not fall: " + join(diagnosis.gated_out) +
                      ".");
  return html;
}

}  // namespace turncal
