#include "orchestrator/report/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace turncal {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Returns "accel_second_order, second-order nonlinearity K2 (IEEE 1293), x 28.35 +- 0.91 ug/g^2 (31 sigma)", strongest components first.
std::string describe_effect(const Diagnosis& diagnosis, const std::string& name, std::size_t most, bool with_term) {
  const std::vector<const EstimatedEffect*> parts = strongest_of(diagnosis.extended, name);
  std::vector<std::string> texts;
  for (std::size_t k = 0; k < std::min(most, parts.size()); ++k) {
    const EstimatedEffect& e = *parts[k];
    texts.push_back(component_name(e.column) + " " + quantity(e.value, e.sigma, e.column.entry->unit) + " (" +
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
    source += ", judged by its own noise, " + significant(diagnosis.holdout_own_noise, 2) + " times the fit's";
  return "held-out data" + (source.empty() ? "" : " (" + source + ")");
}

std::string error_clause(const Diagnosis& d) {
  if (!known(d.holdout_before) || !known(d.holdout_after))
    return "the rms normalised residual falls from " + ratio(d.error_before) + " to " + ratio(d.error_after) +
           " (1: noise alone); no held-out data confirm it";
  const double before = d.holdout_before.velocity_rms_mps;
  const double after = d.holdout_after.velocity_rms_mps;
  return "with " + std::string(d.effect_names.size() == 1 ? "it" : "them") + " the velocity error on " +
         holdout_name(d) + (after < before ? " falls from " : " goes from ") + in_mm(before) + " to " + in_mm(after) +
         " mm/s rms (" + percent_change(before, after) + "), and the normalised residual there from " +
         ratio(d.holdout_before.normalised_rms) + " to " + ratio(d.holdout_after.normalised_rms);
}

std::string clean_sentence(const Diagnosis& d) {
  std::string text = "the 24 parameters explain the data to the noise";
  if (d.statements.tested)
    text += "; the probability that something is missing is " + words_of_probability(d.statements.anything);
  if (const auto scores = strongest_candidates(d); !scores.empty())
    text += fmt::format("; the strongest of {} candidates, {}, scores {} sigma", d.candidates.size(),
                        scores.front()->column.key(), significant(std::abs(scores.front()->z), 2));
  if (known(d.holdout_before))
    text += "; on " + holdout_name(d) + " the velocity error is " + in_mm(d.holdout_before.velocity_rms_mps) +
            " mm/s rms and the normalised residual " + ratio(d.holdout_before.normalised_rms);
  return text;
}

// Describes the residual of the final model.
std::string remaining_clause(const Diagnosis& d) {
  std::string text = "rms normalised residual " + ratio(d.error_after) + " against 1 for noise alone, velocity error " +
                     in_mm(velocity_rms_mps(d, true)) + " mm/s rms";
  if (known(d.holdout_after))
    text += ", on " + holdout_name(d) + " " + ratio(d.holdout_after.normalised_rms) + " and " +
            in_mm(d.holdout_after.velocity_rms_mps) + " mm/s";
  return text;
}

// Returns a reason as one clause, without a full stop.
std::string clause(std::string text) {
  while (!text.empty() && (text.back() == '.' || text.back() == ' ')) text.pop_back();
  return text;
}

std::string strongest_scores(const Diagnosis& d, double threshold) {
  std::vector<std::string> parts;
  for (const CandidateScore* best : strongest_candidates(d)) {
    if (parts.size() == 4) break;
    parts.push_back(std::string(best->column.entry->name) + " " + significant(std::abs(best->z), 2));
  }
  return join(parts) + " (threshold " + significant(threshold, 2) + ")";
}

std::string largest_changes(const Diagnosis& d) {
  const ParameterVector change = changes_in_sigma(d);
  std::vector<int> order(parameter_count);
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, [&](int a, int b) {
    return (std::isfinite(change[a]) ? std::abs(change[a]) : -1.0) >
           (std::isfinite(change[b]) ? std::abs(change[b]) : -1.0);
  });
  std::vector<std::string> parts;
  for (const int k : order) {
    if (parts.size() == 6 || !std::isfinite(change[k]) || (!parts.empty() && std::abs(change[k]) < 0.05)) break;
    parts.push_back(parameter_key(k) + " " + signed_number(change[k], 1));
  }
  return join(parts) + " sigma";
}

// Returns the energy beyond noise, relative to it: (chi-square - observations) / observations, not below 0.
double excess_energy(const HoldoutError& error) {
  if (error.observations <= 0) return nan;
  return std::max(0.0, error.chi_square / double(error.observations) - 1.0);
}

}  // namespace

std::string alias_clause(const Diagnosis& d) {
  std::vector<std::string> parts;
  for (const auto& [name, others] : d.aliases)
    if (!others.empty()) parts.push_back(name + " from " + join(others, ", "));
  return parts.empty() ? "" : "; this recording cannot tell " + join(parts, "; nor ");
}

std::string effects_clause(const Diagnosis& d) {
  // With more effects each gets fewer words.
  const std::size_t n = d.effect_names.size();
  std::vector<std::string> effects;
  for (const std::string& name : d.effect_names) effects.push_back(describe_effect(d, name, n == 1 ? 3 : 1, n < 3));
  static constexpr const char* words[] = {"no", "one", "two", "three", "four", "five", "six"};
  return (n < std::size(words) ? words[n] : std::to_string(n)) + (n == 1 ? " effect" : " effects") +
         " beyond the 24 parameters " + (n == 1 ? "was" : "were") + " found and added: " + join(effects, "; ");
}

std::string verdict_title(std::string_view word) {
  std::string title = in_words(word);
  title.front() = char(title.front() - 'a' + 'A');
  return title;
}

Facts verdict_facts(const std::string& verdict, bool trusted, const std::string& reason) {
  return {{{"verdict", verdict + (trusted ? "; parameters trusted" : "; parameters not trusted")}, {"reason", reason}}};
}

std::string brief_reason(const Diagnosis& d) {
  const std::string latitude = d.why_not_trusted.starts_with(d.latitude) ? "" : d.latitude + "; ";
  if (d.verdict == Verdict::extended) {
    std::vector<std::string> effects;
    for (const std::string& name : d.effect_names) {
      double probability = 0.0;
      for (const Statement& s : d.statements.nodes)
        if (s.formula == name) probability = std::max(probability, s.probability);
      effects.push_back(describe_effect(d, name, 1, false));
      if (probability > 0.0) effects.back() += ", probability " + words_of_probability(probability);
    }
    return latitude + "added: " + join(effects, "; ") + (d.trusted() ? "" : "; " + d.why_not_trusted);
  }
  if (!d.trusted()) return latitude + d.why_not_trusted;
  const std::string missing = "; probability that something is missing: " + words_of_probability(d.statements.anything);
  return latitude + "the parameters explain the data" + (d.statements.tested ? missing : "");
}

std::string verdict_sentence(const Diagnosis& d) {
  const std::string title = verdict_title(to_string(d.verdict)) + ": ";
  switch (d.verdict) {
    case Verdict::clean: return title + clean_sentence(d) + ".";
    case Verdict::extended: return title + effects_clause(d) + "; " + error_clause(d) + alias_clause(d) + ".";
    case Verdict::unexplained:
      return title + "a residual is left that is not noise and that effects of the catalogue do not explain (" +
             remaining_clause(d) + ")" +
             (d.unexplained_pattern.empty() ? "" : "; it looks like: " + clause(d.unexplained_pattern)) +
             (has_after(d) ? "; beside it " + effects_clause(d) : "; no effect is named") +
             "; the sigmas allow for it.";
    case Verdict::noise_model:
      return title + "the assumed noise does not fit the data (innovations " + significant(d.base.whiteness.level, 3) +
             " times the expected variance" +
             (d.base.whiteness.autocorrelation.size() > 0
                  ? ", correlation from second to second " + significant(d.base.whiteness.autocorrelation[0], 2)
                  : "") +
             "; " + remaining_clause(d) + "); nothing is claimed about effects.";
    case Verdict::not_tested: return title + "the data determine nothing to be judged: " + d.reason + ".";
  }
  return title;
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
                    100.0 * excess_energy(after), "% of noise", false});
  }
  if (context.worth)
    rows.push_back({(context.holdout_path.empty() ? "fitted recording" : "held-out data") +
                        std::string(": free navigation, rms of ") + std::to_string(context.worth->branches) +
                        (context.worth->branches == 1 ? " start" : " starts"),
                    context.worth->before, context.worth->after, "NM/h", false});
  return rows;
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

std::string noise_line(const JointResult& r, bool given) {
  const NoiseModel& n = r.noise;
  return fmt::format("{}: ARW {} °/√h, VRW {} µg/√Hz, bias instability {} °/h and {} µg; innovations {}",
                     given ? "configured" : "measured", significant(n.angle_random_walk.mean() / radprs_per_degprh, 3),
                     significant(n.velocity_random_walk.mean() / mpsprs_per_ugprHz, 3),
                     significant(n.gyro_bias_instability_radps / radps_per_degph, 2),
                     significant(n.accel_bias_instability_mps2 / standard_gravity_mps2 * 1e6, 2),
                     r.whiteness.white ? "white" : "not white");
}

Facts diagnosis_facts(const Diagnosis& d, const std::string& noise) {
  Facts facts;
  if (!strongest_candidates(d).empty())
    facts.rows.emplace_back("scores", strongest_scores(d, family_threshold_z(d, score_false_alarm)));
  if (has_after(d)) facts.rows.emplace_back("moved most", largest_changes(d));
  facts.rows.emplace_back("noise", noise);
  if (!d.undetectable.empty()) facts.rows.emplace_back("not visible", join(d.undetectable));
  std::vector<std::string> undetermined;
  for (const Undetermined& u : d.extended.undetermined) {
    std::vector<std::string> names;
    for (const auto& [name, weight] : u.combination) names.push_back(name);
    undetermined.push_back(join(names, "&"));
  }
  if (!undetermined.empty()) facts.rows.emplace_back("undetermined", join(undetermined));
  return facts;
}

}  // namespace turncal
