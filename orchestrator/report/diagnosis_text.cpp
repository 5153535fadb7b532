#include "orchestrator/report/diagnosis_text.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>

#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/figures/report_dwells.h"
#include "orchestrator/figures/score_chart.h"

namespace turncal {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

double z_of(const EstimatedEffect& e) { return e.sigma > 0.0 ? std::abs(e.value) / e.sigma : 0.0; }

std::string component_name(const EffectColumn& column) {
  return std::string(column.entry->components[static_cast<std::size_t>(column.component)]);
}

// "accel_second_order, second-order nonlinearity K2 (IEEE 1293), x 28.35 +- 0.91 ug/g^2 (31 sigma)": strongest components first.
std::string describe_effect(const Diagnosis& diagnosis, const std::string& name, std::size_t most, bool with_term,
                            Alphabet alphabet) {
  std::vector<const EstimatedEffect*> parts;
  for (const EstimatedEffect& e : diagnosis.extended.effects)
    if (e.column.entry != nullptr && e.column.entry->name == name) parts.push_back(&e);
  std::stable_sort(parts.begin(), parts.end(), [](auto* a, auto* b) { return z_of(*a) > z_of(*b); });
  std::vector<std::string> texts;
  for (std::size_t k = 0; k < std::min(most, parts.size()); ++k) {
    const EstimatedEffect& e = *parts[k];
    texts.push_back(component_name(e.column) + " " + quantity(e.value, e.sigma, e.column.entry->unit, alphabet) + " (" +
                    significant(z_of(e), 2) + " sigma)");
  }
  if (parts.size() > most) texts.push_back("and " + std::to_string(parts.size() - most) + " more");
  const EffectEntry* entry = with_term ? find_effect(name) : nullptr;
  return name + (entry != nullptr ? ", " + std::string(entry->term) : "") + (texts.empty() ? "" : ", " + join(texts));
}

bool known(const HoldoutError& error) { return error.observations > 0; }

std::string in_mm(double velocity_mps) { return significant(1e3 * velocity_mps, 3); }

std::string holdout_name(const Diagnosis& diagnosis) {
  std::string source = diagnosis.holdout_source;
  if (diagnosis.holdout_own_noise > 1.0)
    source += ", judged by noise of its own, " + significant(diagnosis.holdout_own_noise, 2) + " times the fit's";
  return "held-out data" + (source.empty() ? "" : " (" + source + ")");
}

std::string error_clause(const Diagnosis& d) {
  if (!known(d.holdout_before) || !known(d.holdout_after)) {
    return "the rms normalised residual falls from " + ratio(d.error_before) + " to " + ratio(d.error_after) +
           " (1 is what the noise explains); there was no held-out data to confirm it on";
  }
  const double before = d.holdout_before.velocity_rms_mps;
  const double after = d.holdout_after.velocity_rms_mps;
  return "with " + std::string(d.effect_names.size() == 1 ? "it" : "them") + " the velocity error on " +
         holdout_name(d) + (after < before ? " falls from " : " goes from ") + in_mm(before) + " to " + in_mm(after) +
         " mm/s rms (" + percent_change(before, after) + "), and the normalised residual there from " +
         ratio(d.holdout_before.normalised_rms) + " to " + ratio(d.holdout_after.normalised_rms);
}

// Why a score beyond its limit made no name; empty where it is not beyond.
std::string why_not_taken(const Diagnosis& d, const CandidateScore& best, double limit) {
  if (std::abs(best.z) <= limit || d.stages.empty()) return "";
  const SelectionStage& last = d.stages.back();
  if (last.accepted) return "; held-out data speak against " + last.chosen.key();
  return "; it was not taken, for with noise and parameters fitted again 2 ln L gains " + significant(last.gain, 3) +
         (last.chosen.key() == best.column.key() ? "" : " at most (" + last.chosen.key() + ")") + " where " +
         significant(last.threshold, 3) + " is needed" +
         (last.gain > last.threshold ? ", and the effect is too few of its own sigmas" : "");
}

std::string clean_sentence(const Diagnosis& d, const DiagnosisContext& context) {
  std::string text = "the 24 parameters explain the data to the noise";
  if (const CandidateScore* best = strongest_candidate(d)) {
    text += "; the strongest of " + std::to_string(d.candidates.size()) + " candidates, " + best->column.key() +
            ", scores " + significant(std::abs(best->z), 2) + " sigma where " +
            significant(family_threshold_z(d, context.false_alarm), 2) + " are needed" +
            why_not_taken(d, *best, family_threshold_z(d, context.false_alarm));
  }
  if (!d.gated_out.empty())
    text += "; " + join(d.gated_out) + " fitted better but did not lower the error on held-out data";
  if (known(d.holdout_before)) {
    text += "; on " + holdout_name(d) + " the velocity error is " + in_mm(d.holdout_before.velocity_rms_mps) +
            " mm/s rms and the normalised residual " + ratio(d.holdout_before.normalised_rms);
  }
  return text;
}

// What is left in the final model.
std::string remaining_clause(const Diagnosis& d) {
  std::string text = "rms normalised residual " + ratio(d.error_after) + " where noise explains 1, velocity error " +
                     in_mm(velocity_rms_mps(d, true)) + " mm/s rms";
  if (known(d.holdout_after)) {
    text += ", on " + holdout_name(d) + " " + ratio(d.holdout_after.normalised_rms) + " and " +
            in_mm(d.holdout_after.velocity_rms_mps) + " mm/s";
  }
  return text;
}

// A reason as one clause: no full stop at its end.
std::string clause(std::string text) {
  while (!text.empty() && (text.back() == '.' || text.back() == ' ')) text.pop_back();
  return text;
}

// What it looks like, and how strongly the data say so.
std::string pattern_clause(const Diagnosis& d) {
  if (d.unexplained_pattern.empty()) return "";
  std::string text = "; it looks like: " + clause(d.unexplained_pattern);
  if (!d.stages.empty() && !d.stages.back().accepted && d.stages.back().gain > d.stages.back().threshold) {
    text += " (likelihood gain " + significant(d.stages.back().gain, 3) + " where " +
            significant(d.stages.back().threshold, 3) + " is needed)";
  }
  return text;
}

std::string pad(std::string text, std::size_t width) {
  text.resize(std::max(width, text.size()), ' ');
  return text;
}

class Table {
 public:
  // `label` in the first column, `text` wrapped after it; at most `most` lines.
  void row(const std::string& label, const std::string& text, std::size_t most = 1) {
    std::vector<std::string> lines = wrap(text, table_columns - label_width);
    if (lines.size() > most) {
      lines.resize(most);
      lines.back() = shorten(lines.back() + " ...", table_columns - label_width);
    }
    for (std::size_t k = 0; k < lines.size(); ++k) line(pad(k == 0 ? label : "", label_width) + lines[k]);
  }
  void line(const std::string& text) { lines_.push_back(shorten(text, table_columns)); }
  std::vector<std::string> take() {
    if (lines_.size() > table_lines) {
      lines_.resize(table_lines - 1);
      lines_.push_back("... more in the report");
    }
    return std::move(lines_);
  }

 private:
  static constexpr std::size_t label_width = 16;
  std::vector<std::string> lines_;
};

void add_errors(const Diagnosis& d, const std::vector<ErrorRow>& rows, Table& table) {
  char text[160];
  std::snprintf(text, sizeof text, "%-16s%-48s %10s %10s %9s", "error", "", has_after(d) ? "before" : "",
                has_after(d) ? "after" : "", has_after(d) ? "change" : "");
  table.line(clause(text));
  for (const ErrorRow& row : rows) {
    const std::string what = row.what + (row.unit.empty() || row.normalised ? "" : ", " + row.unit);
    if (has_after(d)) {
      std::snprintf(text, sizeof text, "  %-62s %10s %10s %9s", what.c_str(), error_text(row, row.before).c_str(),
                    error_text(row, row.after).c_str(), percent_change(row.before, row.after).c_str());
    } else {
      std::snprintf(text, sizeof text, "  %-62s %10s", what.c_str(), error_text(row, row.before).c_str());
    }
    table.line(text);
  }
}

void add_effects(const Diagnosis& d, Table& table) {
  if (!has_after(d)) return;
  constexpr std::size_t most = 6;
  char text[200];
  std::snprintf(text, sizeof text, "%-40s %14s %12s %-12s %6s", "effect added", "value", "sigma", "unit", "z");
  table.line(text);
  std::size_t shown = 0;
  for (const EstimatedEffect& e : d.extended.effects) {
    if (e.column.entry == nullptr) continue;
    if (++shown > most) continue;
    std::snprintf(text, sizeof text, "  %-38s %14s %12s %-12s %6s", e.column.key().c_str(),
                  value_with_sigma(e.value, e.sigma).c_str(), value_with_sigma(e.sigma, e.sigma).c_str(),
                  std::string(e.column.entry->unit).c_str(), significant(z_of(e), 3).c_str());
    table.line(text);
  }
  if (shown > most) table.line("  and " + std::to_string(shown - most) + " more in the report");
}

std::string strongest_scores(const Diagnosis& d, double threshold) {
  std::vector<std::string> parts;
  for (const ScoreBar& bar : score_bars(d, threshold)) {
    if (bar.role == ScoreBar::Role::invisible || parts.size() == 4) break;
    parts.push_back(bar.name + " " + significant(bar.z, 2));
  }
  return join(parts) + " (threshold " + significant(threshold, 2) + ")";
}

std::string noise_line(const JointResult& r, bool given) {
  const NoiseModel& n = r.noise;
  return std::string(given ? "configured: " : "measured: ") + "ARW " +
         significant(n.angle_random_walk.mean() / radprs_per_degprh, 3) + " deg/sqrt(h), VRW " +
         significant(n.velocity_random_walk.mean() / mpsprs_per_ugprHz, 3) + " ug/sqrt(Hz), bias instability " +
         significant(n.gyro_bias_instability_radps / radps_per_degph, 2) + " deg/h and " +
         significant(n.accel_bias_instability_mps2 / standard_gravity_mps2 * 1e6, 2) + " ug; innovations " +
         (r.whiteness.white ? "white" : "not white");
}

std::string largest_changes(const Diagnosis& d) {
  const ParameterVector change = changes_in_sigma(d);
  std::vector<int> order(parameter_count);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return (std::isfinite(change[a]) ? std::abs(change[a]) : -1.0) >
           (std::isfinite(change[b]) ? std::abs(change[b]) : -1.0);
  });
  std::vector<std::string> parts;
  for (const int k : order) {
    if (parts.size() == 6 || !std::isfinite(change[k]) || (!parts.empty() && std::abs(change[k]) < 0.05)) break;
    parts.push_back(std::string(parameter_keys[static_cast<std::size_t>(k)]) + " " + signed_number(change[k], 1));
  }
  return join(parts) + " sigma";
}

void add_limits(const Diagnosis& d, const DiagnosisContext& context, Table& table) {
  for (const auto& [name, others] : d.aliases) {
    if (others.empty()) continue;
    const auto by = d.separate_by.find(name);
    table.row("not told apart",
              name + " | " + join(others, " | ") +
                  (by != d.separate_by.end() && !by->second.empty() ? "; separated by " + by->second : ""),
              2);
  }
  if (!d.gated_out.empty())
    table.row("not confirmed", join(d.gated_out) + (context.hand_turned ? "" : " (no better on held-out data)"), 2);
  if (!d.undetectable.empty()) table.row("not visible", join(d.undetectable), 2);
  std::vector<std::string> undetermined;
  for (const Undetermined& u : d.extended.undetermined) {
    std::vector<std::string> keys;
    for (const auto& [key, weight] : u.combination) keys.push_back(key);
    undetermined.push_back(join(keys, "&"));
  }
  if (!undetermined.empty()) table.row("undetermined", join(undetermined), 2);
}

}  // namespace

std::string alias_clause(const Diagnosis& d) {
  std::vector<std::string> parts;
  for (const auto& [name, others] : d.aliases)
    if (!others.empty()) parts.push_back(name + " from " + join(others, ", "));
  return parts.empty() ? "" : "; this recording cannot tell " + join(parts, "; nor ");
}

std::string effects_clause(const Diagnosis& d, Alphabet alphabet) {
  // The more there are, the less is said of each.
  const std::size_t n = d.effect_names.size();
  std::vector<std::string> effects;
  for (const std::string& name : d.effect_names)
    effects.push_back(describe_effect(d, name, n == 1 ? 3 : 1, n < 3, alphabet));
  static constexpr const char* words[] = {"no", "one", "two", "three", "four", "five", "six"};
  return (n < std::size(words) ? words[n] : std::to_string(n)) + (n == 1 ? " effect" : " effects") +
         " beyond the 24 parameters " + (n == 1 ? "was" : "were") + " found and added: " + join(effects, "; ");
}

std::string verdict_title(Verdict verdict) {
  switch (verdict) {
    case Verdict::clean: return "Clean";
    case Verdict::extended: return "Extended";
    case Verdict::unexplained: return "Unexplained";
    case Verdict::noise_model: return "Noise model";
    case Verdict::not_tested: return "Not tested";
  }
  return "";
}

const CandidateScore* strongest_candidate(const Diagnosis& diagnosis) {
  const CandidateScore* best = nullptr;
  for (const CandidateScore& c : diagnosis.candidates)
    if (c.visible && c.column.entry != nullptr && std::isfinite(c.z) &&
        (best == nullptr || std::abs(c.z) > std::abs(best->z)))
      best = &c;
  return best;
}

std::string verdict_sentence(const Diagnosis& d, const DiagnosisContext& context, Alphabet alphabet) {
  const std::string title = verdict_title(d.verdict) + ": ";
  switch (d.verdict) {
    case Verdict::clean: return title + clean_sentence(d, context) + ".";
    case Verdict::extended: return title + effects_clause(d, alphabet) + "; " + error_clause(d) + alias_clause(d) + ".";
    case Verdict::unexplained:
      return title + "a residual is left that is not noise and that no effect of the catalogue explains (" +
             remaining_clause(d) + ")" + pattern_clause(d) +
             (has_after(d) ? "; beside it " + effects_clause(d, alphabet) : "; no effect is named") +
             (d.candidate_names.empty() ? "" : "; candidates: " + join(d.candidate_names)) +
             (d.moved.empty() ? "" : "; it may have moved " + join(d.moved)) + "; the sigmas are widened by that.";
    case Verdict::noise_model:
      return title + "the assumed noise does not fit the data (innovations " + significant(d.base.whiteness.level, 3) +
             " times the expected variance" +
             (d.base.whiteness.autocorrelation.size() > 0
                  ? ", correlation from second to second " + significant(d.base.whiteness.autocorrelation[0], 2)
                  : "") +
             "; " + remaining_clause(d) + "); nothing is claimed about effects.";
    case Verdict::not_tested: return title + "the data determine nothing that could be judged: " + d.reason + ".";
  }
  return title;
}

double excess_energy(const HoldoutError& error) {
  if (error.observations <= 0) return nan;
  return std::max(0.0, error.chi_square / static_cast<double>(error.observations) - 1.0);
}

std::vector<ErrorRow> error_rows(const Diagnosis& d, const DiagnosisContext& context) {
  std::vector<ErrorRow> rows;
  rows.push_back({"fitted recording: normalised residual rms", d.error_before, d.error_after, "", true});
  rows.push_back({"fitted recording: velocity rms, first 20 s of dwells", 1e3 * velocity_rms_mps(d, false),
                  1e3 * velocity_rms_mps(d, true), "mm/s", false});
  if (known(d.holdout_before)) {
    const HoldoutError after = known(d.holdout_after) ? d.holdout_after : HoldoutError{nan, nan, nan, 0, {}};
    rows.push_back(
        {"held-out data: normalised residual rms", d.holdout_before.normalised_rms, after.normalised_rms, "", true});
    rows.push_back({"held-out data: velocity rms, first 20 s of dwells", 1e3 * d.holdout_before.velocity_rms_mps,
                    1e3 * after.velocity_rms_mps, "mm/s", false});
    rows.push_back({"held-out data: energy beyond noise", 100.0 * excess_energy(d.holdout_before),
                    100.0 * excess_energy(after), "% of the noise's", false});
  }
  if (context.worth)
    rows.push_back({(context.holdout_path.empty() ? "fitted recording" : "held-out data") +
                        std::string(": free navigation, rms of ") + std::to_string(context.worth->branches) +
                        (context.worth->branches == 1 ? " start" : " starts"),
                    context.worth->before, context.worth->after, "nm/h", false});
  return rows;
}

std::string worth_sentence(const DiagnosisContext& context) {
  if (!context.worth) return "";
  std::vector<std::string> parts;
  for (const auto& [name, rate] : context.worth->effects) parts.push_back(name + " " + significant(rate, 2));
  return join(parts) + " nm/h of free navigation for " + significant(context.worth->free_s, 4) +
         " s; noise alone lets expect " + significant(context.worth->noise, 2);
}

std::string error_text(const ErrorRow& row, double value) {
  return row.normalised ? ratio(value) : significant(value, 3);
}

ParameterVector changes_in_sigma(const Diagnosis& d) {
  const ParameterVector before = to_vector(d.base.parameters);
  const ParameterVector after = to_vector(d.extended.parameters);
  ParameterVector change;
  for (int k = 0; k < parameter_count; ++k) {
    const double sigma = d.extended.sigma[k];
    change[k] = sigma > 0.0 ? (after[k] - before[k]) / sigma : nan;
  }
  return change;
}

std::vector<std::string> terminal_table(const Diagnosis& d, const DiagnosisContext& context) {
  return terminal_table(d, context,
                        {verdict_sentence(d, context, Alphabet::plain), error_rows(d, context),
                         noise_line(d.extended, context.noise_given)});
}

std::vector<std::string> terminal_table(const Diagnosis& d, const DiagnosisContext& context,
                                        const DiagnosisWords& words) {
  Table table;
  table.row(context.of_run ? "diagnosis" : "verdict", words.sentence, 7);
  add_errors(d, words.errors, table);
  add_effects(d, table);
  if (context.worth) table.row("worth", worth_sentence(context), 2);
  if (strongest_candidate(d) != nullptr)
    table.row("scores", strongest_scores(d, family_threshold_z(d, context.false_alarm)), 2);
  if (has_after(d)) table.row("moved most", largest_changes(d));
  table.row("noise", words.noise, 2);
  if (!d.base.faults.empty()) {
    const Fault& fault = d.base.faults.front();
    table.row("faults", std::to_string(d.base.faults.size()) + ": sample " + std::to_string(fault.first_sample) + ", " +
                            fault.what + ", " + fault.action +
                            (d.base.faults.size() > 1 ? "; more in the report" : ""));
  }
  add_limits(d, context, table);
  return table.take();
}

}  // namespace turncal
