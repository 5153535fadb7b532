#include "orchestrator/report/report.h"

#include <algorithm>

#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/figures/residual_figures.h"
#include "orchestrator/figures/score_chart.h"
#include "orchestrator/station/version.h"

namespace turncal {
namespace {

// Figures of the residual against what an effect depends on; unexplained: against everything.
constexpr std::size_t most_effect_figures = 4;

Facts how_to_read() {
  return {
      {{"Residual velocity.",
        "The unit stands on the table. Navigating its calibrated data must give velocity zero; what it gives instead "
        "is the error that "
        "matters in use."},
       {"Normalised residual.",
        "The same, second by second, divided by what the sensors' noise explains. 1 is perfect; noise alone gives 1."},
       {"Score.",
        "Each effect of the catalogue is offered to the data beside the 24 parameters. z is the value it would get, in "
        "standard "
        "deviations. The threshold holds for all of them together: chance alone crosses it in one of 200 recordings."},
       {"Probability.",
        "All that may be missing is weighed together, effects of the catalogue and terms without a name. A line's "
        "probability is that of every model that holds it; from 0.95 on it is said."},
       {"Held-out data.",
        "Data that was not used in the fit. An effect that a second recording speaks against is not added."},
       {"Detectable.", "Five standard deviations: what this recording would have found."}},
      true};
}

}  // namespace

void say_verification(const std::string& words, Document& document) {
  const auto verdict = std::find_if(document.blocks.begin(), document.blocks.end(), [](const Document::Block& block) {
    const auto* paragraph = std::get_if<Paragraph>(&block.content);
    return paragraph != nullptr && paragraph->style.starts_with("verdict");
  });
  if (verdict != document.blocks.end())
    document.blocks.insert(verdict + 1,
                           {Paragraph{"Verification (north seeking): " + words + ".", "lead"}, Scope::page});
}

Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  DiagnosisParts parts;
  parts.sentence = verdict_sentence(diagnosis);
  parts.reason = diagnosis.verdict == Verdict::extended ? "" : diagnosis.reason;
  parts.errors = error_rows(diagnosis, context);
  parts.time_title = "Residual velocity against time";
  parts.no_time = "There are no static seconds after a rotation to show.";
  if (!diagnosis.residuals.empty()) parts.time = time_figure(diagnosis);
  parts.residuals = dwell_residuals(diagnosis, context.recording);
  parts.nothing_shown = "No dwell of this recording shows it by itself.";
  parts.residual_intro = "What it depends on, dwell by dwell, is for the reader to judge:";
  if (diagnosis.candidates.empty()) parts.not_scored = "No scores were computed.";
  parts.score_caption =
      "Scores beside the 24 parameters alone. A strong effect lifts the scores of those that resemble it; the table of "
      "probabilities below weighs them together.";
  parts.noise_line = noise_line(diagnosis.extended, context.noise_given);
  parts.noise.scope = parts.selection.scope = Scope::page;
  add_noise(diagnosis, context, parts.noise);
  add_limits(diagnosis, context, parts.limits);
  add_statements(diagnosis.statements, parts.selection);
  parts.reading = how_to_read();
  parts.further = {allan_figure(diagnosis.base.allan)};
  return diagnosis_document(diagnosis, context, std::move(parts));
}

Document diagnosis_document(const Diagnosis& diagnosis, const DiagnosisContext& context, DiagnosisParts parts) {
  const double threshold_z = family_threshold_z(diagnosis, context.false_alarm);
  const std::string& unit = context.recording.info.unit_serial;
  Document document{"turncal diagnosis, unit " + unit, "Calibration diagnosis, unit " + unit};
  add_identity(context, document);
  document.add(Paragraph{parts.sentence, "verdict " + std::string(to_string(diagnosis.verdict))}, Scope::page);
  document.add(Facts{{{context.of_run ? "diagnosis" : "verdict", parts.sentence}}}, Scope::terminal);
  if (!parts.reason.empty()) document.soft("Reason: " + parts.reason + ".");
  const bool both = has_after(diagnosis);
  document.add(Heading{2, "error", both ? "Error before and after" : "Error"}, Scope::page);
  add_errors(diagnosis, parts.errors, document);
  if (both) {
    document.add(Heading{3, "", "What was added"}, Scope::page);
    add_effects(diagnosis, context, document);
  }
  document.add(diagnosis_facts(diagnosis, context, parts.noise_line), Scope::terminal);

  document.scope = Scope::page;
  const auto show = [&](Figure figure, const std::string& without) {
    mark_steps(context.recording, figure);
    figure.panels.empty() ? document.text(without) : document.figure(figure);
  };
  const auto add = [&document](const Document& part) {
    document.blocks.insert(document.blocks.end(), part.blocks.begin(), part.blocks.end());
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
  const bool scored = parts.not_scored.empty();
  if (scored) {
    Drawing scores = draw_scores(score_bars(diagnosis, threshold_z), threshold_z);
    scores.caption = parts.score_caption;
    document.add(std::move(scores));
    document.add(score_table(diagnosis, threshold_z));
  } else {
    document.text(parts.not_scored);
  }
  document.section("parameters", "The 24 parameters");
  add_parameters(diagnosis, context, document);
  document.section("allan", "Noise");
  add(parts.noise);
  for (Figure& figure : parts.further) {
    document.subsection("Allan deviation");
    show(std::move(figure), "No dwell is long enough for it.");
  }
  document.section("limits", "What this recording cannot tell");
  add(parts.limits);
  document.section("faults", "Faults in the data");
  add_faults(diagnosis, context, document);
  document.section("selection", "How the effects were chosen");
  add(parts.selection);
  document.section("reading", "How to read this");
  document.add(std::move(parts.reading));
  if (scored) {
    document.section("components", "Appendix: every component");
    document.add(component_table(diagnosis, threshold_z));
  }
  document.soft("turncal " + std::string(software_version()) + ", " + context.time_utc);
  return document;
}

}  // namespace turncal
