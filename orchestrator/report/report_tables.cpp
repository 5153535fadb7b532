#include "orchestrator/report/report_tables.h"

#include <algorithm>
#include <cmath>

#include "orchestrator/report/diagnosis_figures.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/report_dwells.h"
#include "orchestrator/report/report_format.h"
#include "orchestrator/report/score_chart.h"

namespace turncal {
namespace {

constexpr Alphabet typo = Alphabet::typographic;

// Cells are HTML already; the class says how they are set: "n" numbers, "name" keys, "w" text that may be broken, "" text.
struct Cell {
  std::string html;
  std::string kind;
};
Cell text(std::string_view plain) { return {html_escape(plain), ""}; }
Cell long_text(std::string_view plain) { return {html_escape(plain), "w"}; }
Cell name(std::string_view plain) { return {html_escape(plain), "name"}; }
Cell number(std::string_view plain) { return {html_escape(plain), "n"}; }
Cell number(double value, int digits = 3) { return number(significant(value, digits, typo)); }

class HtmlTable {
 public:
  explicit HtmlTable(const std::vector<Cell>& head) {
    html_ = "<table>\n<thead>" + row_html(head, "th", "") + "</thead>\n<tbody>\n";
  }
  void row(const std::vector<Cell>& cells, const std::string& kind = "") { html_ += row_html(cells, "td", kind); }
  std::string finish() const { return html_ + "</tbody>\n</table>\n"; }

 private:
  static std::string row_html(const std::vector<Cell>& cells, const std::string& tag, const std::string& kind) {
    std::string html = kind.empty() ? "<tr>" : "<tr class=\"" + kind + "\">";
    for (const Cell& cell : cells)
      html +=
          "<" + tag + (cell.kind.empty() ? "" : " class=\"" + cell.kind + "\"") + ">" + cell.html + "</" + tag + ">";
    return html + "</tr>\n";
  }
  std::string html_;
};

// A number and its percent sign stay on one line.
std::string unbroken_percent(std::string html) {
  for (std::size_t at = html.find(" %"); at != std::string::npos; at = html.find(" %", at))
    html.replace(at, 1, "&nbsp;");
  return html;
}

std::string paragraph(std::string_view plain, const char* kind = nullptr) {
  return (kind != nullptr ? "<p class=\"" + std::string(kind) + "\">" : std::string("<p>")) + html_escape(plain) +
         "</p>\n";
}
std::string item(const std::string& html) { return "<li>" + html + "</li>\n"; }
std::string heading(std::string_view plain) { return "<h3>" + html_escape(plain) + "</h3>\n"; }

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

constexpr const char* axis_names[] = {"x", "y", "z"};

std::string parameter_meaning(std::size_t k) {
  const std::string axis = axis_names[k % 3];
  if (k < 3) return "gyro " + axis + " bias";
  if (k < 6) return "accelerometer " + axis + " bias";
  const std::size_t i = (k - (k < 15 ? 6 : 15)) / 3;
  const std::string sensor = std::string(k < 15 ? "gyro " : "accelerometer ") + axis_names[i];
  return i == k % 3 ? sensor + " scale factor" : sensor + " towards " + axis;
}

struct ParameterUnit {
  double factor = 1.0;
  std::string unit;
};
ParameterUnit parameter_unit(std::size_t k, const RecordingInfo& info) {
  if (k < 3) return {1.0, "°/h"};
  if (k < 6) return {1e6, "µg"};
  if (k < 15 && info.gyro_increment == IncrementKind::pulses) return {1.0, "″/pulse"};
  return {1.0, ""};
}
// Sigma of scale factors in ppm and of installation errors in arc-seconds.
std::string handy_sigma(std::size_t k, double sigma, const ParameterVector& values) {
  if (k < 6) return "";
  const std::size_t i = (k - (k < 15 ? 6 : 15)) / 3;
  const double scale = values[static_cast<Eigen::Index>((k < 15 ? 6 : 15) + 4 * i)];
  return i == k % 3 ? significant(1e6 * sigma / scale, 2, typo) + " ppm"
                    : significant(sigma / scale / rad_per_arcsec, 2, typo) + " ″";
}

Cell bar(double value, double largest, bool left) {
  const bool here = left ? value < 0.0 : value > 0.0;
  const double width = here ? 70.0 * std::abs(value) / std::max(largest, 1e-9) : 0.0;
  const std::string kind = left ? "half left" : "half";
  if (width < 0.5) return {"", kind};
  return {"<span class=\"bar\" style=\"width:" + significant(width, 3) + "px\"></span>", kind};
}

std::string or_dash(double value, const std::string& unit) {
  return value > 0.0 ? significant(value, 2, typo) + " " + unit : "-";
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

}  // namespace

std::string html_identity(const DiagnosisContext& context) {
  const CompressedRecording& r = context.recording;
  std::string html = "<h1>Calibration diagnosis, unit " + html_escape(r.info.unit_serial) + "</h1>\n";
  double still_s = 0.0;
  double low = 1e300;
  double high = -1e300;
  for (const Block& block : r.blocks) {
    if (block.whole_second) still_s += block.duration_s;
    if (!std::isnan(block.temperature_c)) {
      low = std::min(low, static_cast<double>(block.temperature_c));
      high = std::max(high, static_cast<double>(block.temperature_c));
    }
  }
  std::string line = "Recording " + context.recording_path;
  if (!context.recording_hash.empty()) line += " (content " + context.recording_hash + ")";
  line += ": " + std::to_string(r.samples) + " samples, " +
          clock_time(static_cast<double>(r.samples) * r.info.sample_period_s) + " h, of which " + clock_time(still_s) +
          " at rest; latitude " + significant(r.info.latitude_deg, 6) + "°, gravity " +
          significant(r.info.gravity_mps2, 7) + " m/s²";
  if (low <= high) line += "; " + significant(low, 3) + " to " + significant(high, 3) + " °C";
  html += paragraph(line + ".", "soft");
  html += paragraph("Held-out data: " +
                        (!context.holdout_path.empty() ? context.holdout_path
                         : context.hand_turned         ? "rests and rotations of the same recording, left out in turn"
                                                       : "dwells of the same recording, left out in turn") +
                        ".",
                    "soft");
  if (r.info.simulated) html += "<p><b>Simulated data: these are not the parameters of a real unit.</b></p>\n";
  for (const std::string& note : context.notes) html += paragraph("Note: " + note + ".", "soft");
  return html;
}

std::string html_verdict(const Diagnosis& diagnosis, const std::string& sentence, const std::string& reason) {
  const std::size_t colon = sentence.find(':');
  return "<div class=\"verdict " + std::string(to_string(diagnosis.verdict)) + "\"><p><b>" +
         html_escape(sentence.substr(0, colon + 1)) + "</b>" +
         unbroken_percent(html_escape(sentence.substr(colon + 1))) + "</p></div>\n" +
         (reason.empty() ? "" : paragraph("Reason: " + reason + ".", "soft"));
}

std::string html_errors(const Diagnosis& diagnosis, const std::vector<ErrorRow>& rows) {
  const bool both = has_after(diagnosis);
  std::vector<Cell> head = {text(""), number(both ? "before" : "value")};
  if (both) {
    head.push_back(number("after"));
    head.push_back(number("change"));
  }
  head.insert(head.begin() + 1, text(""));
  HtmlTable table(head);
  for (const ErrorRow& row : rows) {
    const Cell unit = {"<span class=\"soft\">" +
                           html_escape(row.normalised && row.unit.empty() ? "1 is what the noise explains"
                                                                          : unit_text(row.unit, typo)) +
                           "</span>",
                       ""};
    std::vector<Cell> cells = {text(row.what), unit};
    const auto value = [&](double v) {
      return Cell{"<span class=\"big\">" + html_escape(error_text(row, v)) + "</span>", "n"};
    };
    cells.push_back(value(row.before));
    if (both) {
      cells.push_back(value(row.after));
      cells.push_back(number(percent_change(row.before, row.after)));
    }
    table.row(cells);
  }
  std::string html = table.finish();
  html += paragraph("Held-out source: " + (diagnosis.holdout_source.empty() ? "none" : diagnosis.holdout_source) +
                        ". Before: the 24 parameters alone" + (both ? "; after: with the effects added" : "") +
                        "; the noise is the same in both.",
                    "soft");
  if (diagnosis.verdict == Verdict::unexplained && diagnosis.extended.noise_fit)
    html += paragraph(
        "The noise was measured on the same data and may have taken up a part of the residual: a normalised residual "
        "near 1 "
        "does not clear it.",
        "soft");
  return html;
}

std::string html_added_effects(const Diagnosis& diagnosis) {
  HtmlTable table({text("effect"), text("component"), number("value"), number("σ"), text("unit"), number("z"),
                   text("added to the reading"), text("term")});
  for (const std::string& wanted : diagnosis.effect_names)
    for (const EstimatedEffect& e : diagnosis.extended.effects) {
      if (e.column.entry == nullptr || e.column.entry->name != wanted) continue;
      table.row({name(wanted), name(component_text(e.column)), number(value_with_sigma(e.value, e.sigma, typo)),
                 number(value_with_sigma(e.sigma, e.sigma, typo)), text(unit_text(e.column.entry->unit, typo)),
                 number(e.sigma > 0.0 ? std::abs(e.value) / e.sigma : 0.0), text(e.column.entry->formula),
                 long_text(e.column.entry->term)});
    }
  return table.finish();
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

std::string html_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  const bool both = has_after(diagnosis);
  const ParameterVector before = to_vector(diagnosis.base.parameters);
  const ParameterVector after = to_vector(diagnosis.extended.parameters);
  const ParameterVector change = changes_in_sigma(diagnosis);
  double largest = 1.0;
  for (const double c : change)
    if (std::isfinite(c)) largest = std::max(largest, std::abs(c));
  std::vector<Cell> head = {text("parameter"), text("")};
  if (both) head.push_back(number("before"));
  for (const Cell& cell : {number(both ? "after" : "value"), number("σ"), text("unit"), number("σ, rel.")})
    head.push_back(cell);
  if (both)
    for (const Cell& cell : {number("change, σ"), Cell{"", "half"}, Cell{"", "half"}}) head.push_back(cell);
  HtmlTable table(head);
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    const ParameterUnit unit = parameter_unit(k, context.recording.info);
    const double sigma = diagnosis.extended.sigma[row];
    std::vector<Cell> cells = {name(parameter_keys[k]), text(parameter_meaning(k))};
    if (!parameter_is_free[k] || !(sigma > 0.0)) {
      if (both) cells.push_back(number(parameter_is_free[k] ? "not determined" : "0"));
      for (const Cell& cell :
           {number(parameter_is_free[k] ? "not determined" : "0"), number("-"), text(""), number("-")})
        cells.push_back(cell);
      if (both)
        for (const Cell& cell : {number("-"), Cell{"", "half left"}, Cell{"", "half"}}) cells.push_back(cell);
      table.row(cells, "dim");
      continue;
    }
    if (both) cells.push_back(number(value_with_sigma(before[row] * unit.factor, sigma * unit.factor, typo)));
    cells.push_back(number(value_with_sigma(after[row] * unit.factor, sigma * unit.factor, typo)));
    cells.push_back(number(significant(sigma * unit.factor, 2, typo)));
    cells.push_back(text(unit.unit));
    cells.push_back(number(handy_sigma(k, sigma, after)));
    if (both) {
      cells.push_back(number(signed_number(change[row], 1)));
      cells.push_back(bar(change[row], largest, true));
      cells.push_back(bar(change[row], largest, false));
    }
    table.row(cells, both && std::abs(change[row]) > 3.0 ? "hit" : "");
  }
  std::string html = table.finish();
  html += paragraph(
      "a21, a31 and a32 are zero by definition: the accelerometers define the axes of the unit. The biases of the "
      "accelerometers are shown in µg; parameters.conf has them in g.",
      "soft");
  html += paragraph(both ? "σ is one standard deviation with the effects in the model. Bold: the missing effect had "
                           "moved the parameter "
                           "by more than three of them."
                         : "σ is one standard deviation. No effect was added, so nothing changed.",
                    "soft");
  if (!diagnosis.extended.undetermined.empty()) {
    html += paragraph("Not determined by this recording (combinations, in units of plausible ranges):");
    html += "<ul>\n";
    for (const Undetermined& u : diagnosis.extended.undetermined) html += item(html_escape(combination_text(u)));
    html += "</ul>\n";
  }
  return html;
}

std::string html_noise(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  const JointResult& r = diagnosis.extended;
  const NoiseModel& noise = r.noise;
  constexpr double micro_g = 1e-6 * standard_gravity_mps2;
  HtmlTable table({text("sensor"), number("random walk used"), text(""), number("Allan: N"), number("Q"), number("B"),
                   number("K")});
  for (std::size_t k = 0; k < 6; ++k) {
    const bool gyro = k < 3;
    const auto axis = static_cast<Eigen::Index>(k % 3);
    const double walk = gyro ? radprs_per_degprh : mpsprs_per_ugprHz;
    const double used = (gyro ? noise.angle_random_walk : noise.velocity_random_walk)[axis];
    const double sigma =
        r.noise_fit ? (gyro ? r.noise_fit->sigma_angle_random_walk : r.noise_fit->sigma_velocity_random_walk)[axis]
                    : 0.0;
    const AllanFit& f = r.allan.axes[k].fit;
    const double bias = gyro ? radps_per_degph : micro_g;
    const std::string walk_unit = gyro ? "°/√h" : "µg/√Hz";
    table.row({text(std::string(gyro ? "gyro " : "accelerometer ") + axis_names[k % 3]),
               number(value_with_sigma(used / walk, sigma / walk, typo)),
               text((sigma > 0.0 ? "± " + value_with_sigma(sigma / walk, sigma / walk, typo) + " " : "") + walk_unit),
               number(or_dash(f.random_walk / walk, walk_unit)),
               number(or_dash(f.quantisation / (gyro ? rad_per_arcsec : 1e-3), gyro ? "″" : "mm/s")),
               number(or_dash(f.bias_instability / bias, gyro ? "°/h" : "µg")),
               number(or_dash(f.rate_random_walk * 60.0 / bias, gyro ? "°/h/√h" : "µg/√h"))});
  }
  std::string html = table.finish();
  html += paragraph(
      "Allan fit: N random walk, Q quantisation, B bias instability, K rate random walk; - where the dwells show none.",
      "soft");
  std::string line = context.noise_given
                         ? "The noise was given in the configuration, not measured. "
                         : "The noise was measured on this recording (maximum likelihood, started from the Allan "
                           "deviation). ";
  if (r.noise_fit && r.noise_fit->axes_differ) line += "The axes of a triad differ and have values of their own. ";
  line += "Bias instability used: gyros " + significant(noise.gyro_bias_instability_radps / radps_per_degph, 2, typo) +
          " °/h, accelerometers " + significant(noise.accel_bias_instability_mps2 / micro_g, 2, typo) +
          " µg, correlation time " + significant(noise.bias_correlation_s, 3) + " s; one-pulse quantisation " +
          significant(noise.gyro_pulse_rad / rad_per_arcsec, 3, typo) + " ″ and " +
          significant(1e3 * noise.accel_pulse_mps, 3, typo) + " mm/s.";
  html += paragraph(line);
  std::vector<std::string> lags;
  for (const double a : r.whiteness.autocorrelation) lags.push_back(signed_number(a, 2));
  html += paragraph("Whiteness: " + (r.whiteness.message.empty() ? "not tested" : r.whiteness.message) +
                    " (mean square " + ratio(r.whiteness.level) + ", 1 expected; autocorrelation at 1 to " +
                    std::to_string(lags.size()) + " s: " + (lags.empty() ? "-" : join(lags)) + ").");
  return html;
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

std::string html_faults(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  constexpr std::size_t most = 40;
  const std::vector<Fault>& faults = diagnosis.base.faults;
  if (faults.empty()) return paragraph("None found: no lost sample, no glitch, no second that noise cannot explain.");
  HtmlTable table({number("samples"), number("time, s"), text("what"), text("what was done")});
  const std::int64_t start = context.recording.blocks.empty() ? 0 : context.recording.blocks.front().start_sample;
  for (std::size_t k = 0; k < std::min(most, faults.size()); ++k) {
    const Fault& f = faults[k];
    table.row(
        {number(std::to_string(f.first_sample) +
                (f.last_sample > f.first_sample ? " to " + std::to_string(f.last_sample) : "")),
         number(significant(static_cast<double>(f.first_sample - start) * context.recording.info.sample_period_s, 5)),
         long_text(f.what), long_text(f.action)});
  }
  return table.finish() +
         (faults.size() > most ? paragraph("And " + std::to_string(faults.size() - most) + " more.") : std::string());
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
