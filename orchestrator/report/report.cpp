#include "orchestrator/report/report.h"
#include "orchestrator/report/allan_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "imu_io/base/text.h"
#include "orchestrator/station/version.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

extern const std::string_view how_to_read;  // how_to_read.txt

namespace {

using namespace cell;
using Emphasis = Table::Emphasis;
constexpr Alphabet typo = Alphabet::typographic;

std::string component_text(const EffectColumn& column) {
  std::string result = component_name(column);
  if (column.tau_s > 0.0)
    result += fmt::format(fmt::runtime(column.entry->variant == "tau_s" ? ", τ {} s" : ", w0 {} deg/h"),
                          significant(column.tau_s, 3));
  return result;
}
std::string key_text(const EffectColumn& column) {
  return column.entry == nullptr ? "-" : std::string(column.entry->name) + "." + component_text(column);
}
Cell unit_of(const EffectColumn& column) { return text(unit_text(column.entry->unit)); }

// Returns the sigma in ppm or µrad, for scale factors and misalignments.
std::string handy_sigma(std::size_t k, double sigma, const ParameterVector& values) {
  if (k < 6) return "";
  const std::string_view key = parameter_keys[k];
  const double scale = values[Eigen::Index((k < 15 ? 6 : 15) + 4 * std::size_t(key[2] - '1'))];
  const DisplayUnit unit = error_unit(key, "", scale);
  return significant(unit.factor * sigma, 2, typo) + " " + unit.unit;
}

std::string combination_text(const Undetermined& u) {
  std::string result;
  for (const auto& [key, weight] : u.combination) {
    if (!result.empty())
      result += weight < 0.0 ? " − " : " + ";
    else if (weight < 0.0)
      result += "−";
    result += significant(std::abs(weight), 2) + " " + key;
  }
  return result;
}

void add_identity(const DiagnosisContext& context, Document& document) {
  const CompressedRecording& r = context.recording;
  double still_s = 0.0, low = 1e300, high = -1e300;
  for (const Block& block : r.blocks) {
    if (block.whole_second) still_s += block.duration_s;
    if (!std::isnan(block.temperature_c)) {
      low = std::min(low, double(block.temperature_c));
      high = std::max(high, double(block.temperature_c));
    }
  }
  std::string line = fmt::format("Recording {}{}: {} samples, {}, of which {} at rest; latitude {}°, gravity {} m/s²",
                                 context.recording_path,
                                 context.recording_hash.empty() ? "" : " (content " + context.recording_hash + ")",
                                 r.samples, clock_time(double(r.samples) * r.info.sample_period_s), clock_time(still_s),
                                 r.info.latitude_deg, r.info.gravity_mps2);
  if (low <= high) line += fmt::format("; {} to {} °C", significant(low, 3), significant(high, 3));
  if (!context.holdout_path.empty()) line += "; held-out data: " + context.holdout_path;
  document.soft(line + ".");
  if (r.info.simulated)
    document.add(Paragraph{"Simulated data: these are not the parameters of a real unit.", "loud"}, Scope::page);
  for (const std::string& note : context.notes) document.add(Paragraph{note, "note"});
}

void add_errors(const Diagnosis& diagnosis, const std::vector<ErrorRow>& rows, Document& document) {
  const bool both = has_after(diagnosis);
  Table table{{text("error"), text("unit"), number(both ? "before" : "value"), number("after"), number("change")}};
  table.style = "errors";
  for (const ErrorRow& row : rows)
    table.row({text(row.what), text(row.normalised && row.unit.empty() ? "1: noise alone" : unit_text(row.unit)),
               number(error_text(row, row.before), row.before), number(error_text(row, row.after), row.after),
               number(percent_change(row.before, row.after))});
  if (!both) table.drop(3, 2);
  document.add(std::move(table));
  document.soft(
      "Held-out source: " + (diagnosis.holdout_source.empty() ? "none" : diagnosis.holdout_source) +
      (both ? ". Before: the 24 parameters alone; after: with the effects added; the noise is the same in both."
            : ". The model is that of the 24 parameters."));
  if (diagnosis.verdict == Verdict::unexplained && diagnosis.extended.noise_fit)
    document.soft(
        "The noise was measured on the same data and may have taken up a part of the residual: a normalised residual "
        "near 1 does not prove that nothing is missing.");
}

void add_effects(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document) {
  Table table{{name("effect added"), number("value"), number("σ"), text("unit"), number("z"), number("NM/h")}};
  table.most = 6;
  Table terms{{name("effect"), text("added to the reading"), wide("term")}};
  for (const std::string& wanted : diagnosis.effect_names) {
    Cell worth = number("");  // worth of the whole effect, in its first row
    if (context.worth)
      for (const auto& [effect, rate] : context.worth->effects)
        if (effect == wanted) worth = number(rate, 2);
    for (const EstimatedEffect* part : components_of(diagnosis.extended, wanted)) {
      const EstimatedEffect& e = *part;
      if (terms.rows.empty() || terms.rows.back().cells.front().words != wanted)
        terms.row({name(wanted), text(e.column.entry->formula), wide(e.column.entry->term)});
      table.row({name(key_text(e.column)), with_sigma(e.value, e.sigma), with_sigma(e.sigma, e.sigma),
                 unit_of(e.column), number(z_of(e)), std::exchange(worth, number(""))});
    }
  }
  if (!context.worth) table.drop(5);
  document.add(std::move(table));
  document.add(std::move(terms), Scope::page);
  if (context.worth)
    document.soft(fmt::format(
        "NM/h: drift of free inertial navigation when the whole effect is left out and the other parameters are "
        "estimated without it. Both tracks have the same noise, which alone would give {} NM/h after {} s.",
        significant(context.worth->noise, 2), significant(context.worth->free_s, 4)));
}

Table score_table(const Diagnosis& diagnosis, double threshold_z) {
  Table table{{name("effect"), name("strongest"), number("value alone"), number("σ"), text("unit"),
               number("detectable"), number("|z|"), bar(0.0), text("")}};
  const std::vector<const CandidateScore*> rows = strongest_candidates(diagnosis);
  for (const CandidateScore* best : rows) {
    const std::string_view effect = best->column.entry->name;
    const bool added = std::ranges::find(diagnosis.effect_names, effect) != diagnosis.effect_names.end();
    const double z = std::abs(best->z);
    table.row({name(effect), name(component_text(best->column)), with_sigma(best->value, best->sigma),
               with_sigma(best->sigma, best->sigma), unit_of(best->column), number(best->detectable, 2), number(z),
               bar(std::sqrt(z / std::abs(rows.front()->z))), text(added ? "added" : "")},
              added || z > threshold_z ? Emphasis::hit : Emphasis::none);
  }
  return table;
}

void add_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document) {
  const bool both = has_after(diagnosis);
  const ParameterVector before = to_vector(diagnosis.base.parameters);
  const ParameterVector after = to_vector(diagnosis.extended.parameters);
  const ParameterVector change = changes_in_sigma(diagnosis);
  double largest = 1.0;
  for (const double c : change)
    if (std::isfinite(c)) largest = std::max(largest, std::abs(c));
  Table table{{name("parameter"), text("meaning"), number("before"), number(both ? "after" : "value"), number("σ"),
               text("unit"), number("σ, rel."), number("change, σ"), half(0.0)}};
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    const auto row = Eigen::Index(k);
    const DisplayUnit unit = page_unit(parameter_unit(parameter_keys[k], context.recording.info.gyro_increment));
    const double sigma = diagnosis.extended.sigma[row];
    const Cell key = name(parameter_keys[k]), meaning = text(quantity_name(parameter_keys[k]));
    if (!parameter_is_free[k] || !(sigma > 0.0)) {
      const Cell what = parameter_is_free[k] ? number("not determined") : number("0", 0.0), none = number("-");
      table.row({key, meaning, what, what, none, text(""), none, none, half(0.0)}, Emphasis::dim);
      continue;
    }
    table.row({key, meaning, with_sigma(before[row] * unit.factor, sigma * unit.factor),
               with_sigma(after[row] * unit.factor, sigma * unit.factor), number(sigma * unit.factor, 2),
               text(unit.unit), number(handy_sigma(k, sigma, after)),
               number(signed_number(change[row], 1), change[row]), half(change[row] / largest)},
              both && std::abs(change[row]) > 3.0 ? Emphasis::hit : Emphasis::none);
  }
  if (!both) {
    table.drop(7, 2);
    table.drop(2);
  }
  document.add(std::move(table));
  document.soft(
      "a21, a31 and a32 are zero by definition: the accelerometers define the axes of the unit. The biases of the "
      "accelerometers are shown in µg; parameters.conf has them in g.");
  document.soft(both ? "σ is one standard deviation with the effects in the model. Bold: the missing effect had moved "
                       "the parameter by more than three of them."
                     : "σ is one standard deviation. No effect was added, so nothing changed.");
  if (diagnosis.extended.undetermined.empty()) return;
  document.text("Not determined by this recording (combinations, in units of plausible ranges):");
  Facts combinations{.rows = {}, .list = true};
  for (const Undetermined& u : diagnosis.extended.undetermined) combinations.rows.emplace_back("", combination_text(u));
  document.add(std::move(combinations));
}

void add_noise(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document) {
  const JointResult& r = diagnosis.extended;
  const NoiseModel& noise = r.noise;
  constexpr double micro_g = 1e-6 * standard_gravity_mps2;
  Table table{{text("sensor"), number("random walk used"), number("Allan: N"), number("Q"), number("B"), number("K")}};
  for (std::size_t k = 0; k < 6; ++k) {
    const bool gyro = k < 3;
    const auto axis = Eigen::Index(k % 3);
    const double walk = gyro ? radprs_per_degprh : mpsprs_per_ugprHz;
    const double used = (gyro ? noise.angle_random_walk : noise.velocity_random_walk)[axis] / walk;
    const double sigma =
        r.noise_fit
            ? (gyro ? r.noise_fit->sigma_angle_random_walk : r.noise_fit->sigma_velocity_random_walk)[axis] / walk
            : 0.0;
    const AllanFit& f = r.allan.axes[k].fit;
    std::vector<Cell> row = {text(std::string(gyro ? "gyro " : "accelerometer ") + body_names[k % 3]),
                             number(plus_minus(used, sigma, typo) + (gyro ? " °/√h" : " µg/√Hz"), used)};
    for (const std::size_t term : {1U, 0U, 2U, 3U}) {
      row.push_back(allan_cell(f, gyro, term));
      if (f.made) row.back().words += std::string(" ") + allan_unit(gyro, term).shown;
    }
    table.row(std::move(row));
  }
  document.add(std::move(table));
  document.soft(
      "Allan deviation: N random walk, Q quantisation, B bias instability, K rate random walk, estimated together; <: "
      "not visible in the dwells, with its 95 % upper limit.");
  std::string line =
      context.noise_given
          ? "The noise was given in the configuration, not measured. "
          : "The noise was measured on this recording (maximum likelihood, started from the Allan deviation). ";
  if (r.noise_fit && r.noise_fit->axes_differ) line += "The axes of a triad differ; each has its own value. ";
  document.text(line + fmt::format("Bias instability used: gyros {} °/h, accelerometers {} µg, correlation time {} s; "
                                   "one-pulse quantisation {} ″ and {} mm/s.",
                                   significant(noise.gyro_bias_instability_radps / radps_per_degph, 2, typo),
                                   significant(noise.accel_bias_instability_mps2 / micro_g, 2, typo),
                                   significant(noise.bias_correlation_s, 3),
                                   significant(noise.gyro_pulse_rad / rad_per_arcsec, 3, typo),
                                   significant(1e3 * noise.accel_pulse_mps, 3, typo)));
  std::vector<std::string> lags;
  for (const double a : r.whiteness.autocorrelation) lags.push_back(signed_number(a, 2));
  document.text(fmt::format("Whiteness: {} (mean square {}, 1 expected; autocorrelation at 1 to {} s: {}).",
                            r.whiteness.message.empty() ? "not tested" : r.whiteness.message, ratio(r.whiteness.level),
                            lags.size(), lags.empty() ? "-" : join(lags)));
}

void add_faults(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document) {
  constexpr std::size_t most = 40;
  const std::vector<Fault>& faults = diagnosis.base.faults;
  if (faults.empty())
    return document.text("None found: no lost sample, no glitch, no second that noise cannot explain.");
  Table table{{number("samples"), number("time, s"), wide("what"), wide("what was done")}};
  const std::int64_t start = context.recording.blocks.empty() ? 0 : context.recording.blocks.front().start_sample;
  for (std::size_t k = 0; k < std::min(most, faults.size()); ++k) {
    const Fault& f = faults[k];
    table.row({number(std::to_string(f.first_sample) +
                      (f.last_sample > f.first_sample ? " to " + std::to_string(f.last_sample) : "")),
               number(double(f.first_sample - start) * context.recording.info.sample_period_s, 5), wide(f.what),
               wide(f.action)});
  }
  table.most = 3;
  document.add(std::move(table), Scope::all);
  if (faults.size() > most) document.text(fmt::format("And {} more.", faults.size() - most));
}

// Most figures of the residual against what an effect depends on; unexplained: against everything.
constexpr std::size_t most_effect_figures = 4;

// Returns a list; each line is a label, up to its full stop, and words.
Facts list_of(std::string_view lines) {
  Facts facts{.list = true};
  while (!lines.empty()) {
    const std::string_view line = next_line(lines);
    const std::size_t label = line.find('.') + 1;
    facts.add(std::string(line.substr(0, label)), line.substr(label + 1));
  }
  return facts;
}

void add_limits(const Diagnosis& diagnosis, const DiagnosisContext& context, Document& document) {
  Facts aliases{.rows = {}, .list = true};
  for (const auto& [wanted, others] : diagnosis.aliases) {
    if (others.empty()) continue;
    const auto by = diagnosis.separate_by.find(wanted);
    aliases.rows.emplace_back(wanted, "could as well be " + join(others) + "." +
                                          (by != diagnosis.separate_by.end() && !by->second.empty()
                                               ? " Positions or rates that would separate them: " + by->second + "."
                                               : ""));
  }
  if (!aliases.rows.empty()) {
    document.subsection("Effects it cannot tell apart");
    document.add(std::move(aliases), Scope::all);
    if (!context.hand_turned)
      document.soft(
          "The sequence sequences/extended.seq has such positions and rates; turncal predict shows by how much they "
          "help.");
  }
  if (!diagnosis.gated_out.empty()) {
    document.subsection("Found but not confirmed");
    const char* why =
        context.hand_turned ? "." : ": fitted the recording better but not the held-out data, so not added.";
    document.add(Facts{{{"", join(diagnosis.gated_out, "; ") + why}}, true}, Scope::all);
  }
  document.subsection("Effects it cannot see");
  Table unseen{{name("effect"), wide("what would show it")}};
  for (const std::string& wanted : diagnosis.undetectable) {
    const EffectEntry* entry = find_effect(wanted);
    unseen.row({name(wanted), wide(entry != nullptr ? entry->seen_by : "")});
  }
  if (unseen.rows.empty())
    document.text(
        "Every effect of the catalogue would be seen if it were large enough; the smallest size of each is listed "
        "under “detectable”.");
  else
    document.add(std::move(unseen));
  std::vector<std::string> blind;
  for (const CandidateScore& c : diagnosis.candidates) {
    if (c.visible || c.column.entry == nullptr) continue;
    if (std::ranges::find(diagnosis.undetectable, c.column.entry->name) == diagnosis.undetectable.end())
      blind.push_back(key_text(c.column));
  }
  if (!blind.empty()) document.text("Single components it cannot see: " + join(blind) + ".");
  document.subsection(context.hand_turned ? "Never observable without a table" : "Never observable on such a table");
  Facts never{.rows = {}, .list = true};
  for (const std::string_view quantity : unobservable_quantities()) never.rows.emplace_back("", quantity);
  if (context.hand_turned) {
    never.rows.resize(1);
    never.rows.emplace_back("",
                            "headings, and with them everything that depends on the heading alone: the horizontal "
                            "earth rate, the earth's field");
  }
  document.add(std::move(never));
}

void add_statements(const Statements& statements, Document& document) {
  document.text("The probability that something is missing is " + words_of_probability(statements.anything) + ".");
  Table table{{text("sensor"), text("quantity"), text("goes with"), name("formula"), number("probability"), half(0.0)}};
  const auto some = [](const std::string& what) { return text(what.empty() ? "any" : what); };
  for (const Statement& s : statements.nodes)
    table.row({text(s.sensor), some(s.quantity), some(s.driver), name(s.formula.empty() ? "any, or none" : s.formula),
               number(words_of_probability(s.probability), s.probability), half(s.probability)},
              s.probability >= said_from ? Emphasis::hit : Emphasis::none);
  if (!table.rows.empty()) document.add(std::move(table));
}

void say_below_verdict(const std::string& words, Scope scope, Document& document) {
  const auto verdict = std::ranges::find_if(document.blocks, [](const Document::Block& block) {
    const auto* paragraph = std::get_if<Paragraph>(&block.content);
    return paragraph != nullptr && paragraph->style.starts_with("verdict");
  });
  if (verdict != document.blocks.end()) document.blocks.insert(verdict + 1, {Paragraph{words + ".", "lead"}, scope});
}
}  // namespace

void say_verification(const std::string& words, Document& document) {
  say_below_verdict("Verification (north seeking): " + words, Scope::page, document);
}
void say_settled(const std::string& words, Document& document) { say_below_verdict(words, Scope::all, document); }

Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  DiagnosisParts parts;
  parts.sentence = verdict_sentence(diagnosis);
  if (diagnosis.verdict == Verdict::unexplained || diagnosis.verdict == Verdict::noise_model)
    parts.statement = diagnosis.reason;
  parts.errors = error_rows(diagnosis, context);
  parts.time_title = "Residual velocity against time";
  parts.no_time = "There are no static seconds after a rotation to show.";
  if (!diagnosis.residuals.empty()) parts.time = time_figure(diagnosis);
  parts.residuals = dwell_residuals(diagnosis, context.recording);
  parts.nothing_shown = "No single dwell shows the residual.";
  parts.residual_intro = "The residual of each dwell against what it may depend on:";
  if (diagnosis.candidates.empty()) parts.not_scored = "No scores were computed.";
  parts.score_caption =
      "Scores with only the 24 parameters in the model. A strong effect raises those of similar effects; the table of "
      "probabilities below weighs them together.";
  parts.noise_line = noise_line(diagnosis.extended, context.noise_given);
  parts.noise.scope = Scope::page;
  add_noise(diagnosis, context, parts.noise);
  parts.reading = how_to_read;
  parts.further = {allan_figure(diagnosis.base.allan)};
  return diagnosis_document(diagnosis, context, std::move(parts));
}

Document begin_document(const Diagnosis& diagnosis, const DiagnosisContext& context, const std::string& sentence) {
  const std::string& unit = context.recording.info.unit_serial;
  Document document{"turncal diagnosis, unit " + unit, "Calibration diagnosis, unit " + unit};
  add_identity(context, document);
  document.add(Paragraph{sentence, "verdict " + std::string(to_string(diagnosis.verdict))}, Scope::page);
  document.add(verdict_facts(verdict_title(to_string(diagnosis.verdict)), diagnosis.trusted(), brief_reason(diagnosis)),
               Scope::brief);
  document.add(Facts{{{context.of_run ? "diagnosis" : "verdict", sentence}}}, Scope::terminal);
  return document;
}

Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context, DiagnosisParts parts) {
  const double threshold_z = family_threshold_z(diagnosis, score_false_alarm);
  Document document = begin_document(diagnosis, context, parts.sentence);
  if (!parts.statement.empty()) document.soft("Statement: " + parts.statement + ".");
  const bool both = has_after(diagnosis);
  document.add(Heading{2, "error", both ? "Error before and after" : "Error"}, Scope::page);
  add_errors(diagnosis, parts.errors, document);
  if (both) {
    document.add(Heading{3, "", "What was added"}, Scope::page);
    add_effects(diagnosis, context, document);
  }
  document.add(diagnosis_facts(diagnosis, parts.noise_line), Scope::terminal);

  document.scope = Scope::page;
  const auto show = [&](Figure figure, const std::string& without) {
    mark_steps(context.recording, figure);
    figure.panels.empty() ? document.text(without) : document.figure(figure);
  };
  document.section("time", parts.time_title);
  show(std::move(parts.time), parts.no_time);
  const std::vector<std::string>& names = diagnosis.effect_names;
  if (!names.empty()) document.section("effects", "Residual against what the effect depends on");
  for (std::size_t k = 0; k < std::min(names.size(), most_effect_figures); ++k) {
    Figure figure = effect_figure(diagnosis, parts.residuals, names[k], k);
    const std::string& caption = names[k].starts_with("gyro") ? parts.one_point : parts.one_point_accel;
    if (!caption.empty()) figure.caption = caption;
    document.subsection(names[k]);
    show(std::move(figure), parts.nothing_shown);
  }
  if (names.size() > most_effect_figures)
    document.text("Not drawn: " + join({names.begin() + most_effect_figures, names.end()}) + ".");
  if (diagnosis.verdict == Verdict::unexplained || diagnosis.verdict == Verdict::noise_model) {
    document.section("residual", "Where the residual lies");
    document.text("No effect is named for this residual. " + parts.residual_intro);
    std::vector<Figure> figures = unexplained_figures(parts.residuals);
    if (figures.empty()) document.text("There are no dwells after a rotation to show.");
    for (Figure& figure : figures) {
      if (!parts.one_point.empty()) figure.caption = "One point a rest and axis.";
      document.subsection(figure.id == "asAccel" ? "as an accelerometer error" : "as a gyro error");
      show(std::move(figure), "");
    }
  }
  document.section("scores", "Every candidate of the catalogue");
  if (parts.not_scored.empty()) {
    document.add(score_table(diagnosis, threshold_z));
    document.soft(parts.score_caption + " Bold: above the family-wise threshold, " + significant(threshold_z, 2) +
                  "; bars: the square root of |z|, the strongest component of each effect.");
  } else {
    document.text(parts.not_scored);
  }
  document.section("parameters", "The 24 parameters");
  add_parameters(diagnosis, context, document);
  document.section("allan", "Noise");
  document.blocks.insert(document.blocks.end(), parts.noise.blocks.begin(), parts.noise.blocks.end());
  for (Figure& figure : parts.further) {
    document.subsection("Allan deviation");
    show(std::move(figure), "No dwell is long enough for it.");
  }
  document.section("limits", "What this recording cannot tell");
  add_limits(diagnosis, context, document);
  document.section("faults", "Faults in the data");
  add_faults(diagnosis, context, document);
  document.section("selection", "How the effects were chosen");
  add_statements(diagnosis.statements, document);
  document.section("reading", "How to read this");
  document.add(list_of(parts.reading));
  document.soft("turncal " + std::string(software_version()) + ", " + context.time_utc);
  return document;
}

}  // namespace turncal
