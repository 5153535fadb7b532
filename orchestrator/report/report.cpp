#include "orchestrator/report/report.h"

#include <algorithm>
#include <vector>

#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/figures/drawing.h"
#include "orchestrator/figures/report_dwells.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/figures/residual_figures.h"
#include "orchestrator/figures/score_chart.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/report_page.h"
#include "orchestrator/report/report_tables.h"
#include "orchestrator/station/version.h"

namespace turncal {

extern const std::string_view report_reading_html;  // reading.html

namespace {

// Figures of the residual against what an effect depends on; unexplained: against everything.
constexpr std::size_t most_effect_figures = 4;

}  // namespace

void say_verification(const std::string& words, std::string& html) {
  if (const std::size_t at = html.find(verification_place); at != std::string::npos)
    html.replace(at, verification_place.size(),
                 "<p><b>Verification (north seeking):</b> " + html_escape(words) + ".</p>\n");
}

Report make_report(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  ReportParts parts;
  parts.sentence = verdict_sentence(diagnosis, context, Alphabet::typographic);
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
      "Scores beside the 24 parameters alone. A strong effect lifts the scores of those that resemble it; the "
      "selection below takes them one at a time.";
  parts.noise_html = html_noise(diagnosis, context);
  parts.limits_html = html_limits(diagnosis, context);
  parts.selection_html = html_selection(diagnosis);
  parts.reading_html = report_reading_html;
  parts.further = {allan_figure(diagnosis.base.allan)};
  return make_report(diagnosis, context, std::move(parts));
}

Report make_report(const Diagnosis& diagnosis, const DiagnosisContext& context, ReportParts parts) {
  const double threshold_z = family_threshold_z(diagnosis, context.false_alarm);
  Plots plots;
  const auto add = [&plots, &context](Figure figure) {
    mark_steps(context.recording, figure);
    return plots.add(std::move(figure));
  };
  const Figure time = add(std::move(parts.time));
  std::vector<Figure> effects;
  for (std::size_t k = 0; k < std::min(diagnosis.effect_names.size(), most_effect_figures); ++k) {
    const std::string& name = diagnosis.effect_names[k];
    Figure figure = effect_figure(diagnosis, parts.residuals, name, k);
    const std::string& caption = name.starts_with("gyro") ? parts.one_point : parts.one_point_accel;
    if (!caption.empty()) figure.caption = caption;
    effects.push_back(add(std::move(figure)));
  }
  std::vector<Figure> unexplained;
  const bool nameless = diagnosis.verdict == Verdict::unexplained || diagnosis.verdict == Verdict::noise_model;
  if (nameless)
    for (Figure& figure : unexplained_figures(parts.residuals)) {
      if (!parts.one_point.empty()) figure.caption = "One point a rest and axis.";
      unexplained.push_back(add(std::move(figure)));
    }
  const bool scored = parts.not_scored.empty();
  if (scored) plots.drawings.push_back(draw_scores(score_bars(diagnosis, threshold_z), threshold_z));
  for (Figure& figure : parts.further) figure = add(std::move(figure));
  plots.render_all(context.gnuplot);

  Page page("turncal diagnosis, unit " + context.recording.info.unit_serial);
  const auto show = [&](const Figure& figure, const std::string& without) {
    if (figure.panels.empty())
      page.text(without);
    else
      page.raw(plots.html(figure));
  };
  page.raw(html_identity(context));
  page.raw(html_verdict(diagnosis, parts.sentence, parts.reason));
  page.raw(std::string(verification_place));
  page.section("error", has_after(diagnosis) ? "Error before and after" : "Error");
  page.raw(html_errors(diagnosis, parts.errors));
  if (has_after(diagnosis)) {
    page.subsection("What was added");
    page.raw(html_added_effects(diagnosis, context));
  }
  page.section("time", parts.time_title);
  show(time, parts.no_time);
  if (!effects.empty()) page.section("effects", "Residual against what the effect depends on");
  for (std::size_t k = 0; k < effects.size(); ++k) {
    page.subsection(diagnosis.effect_names[k]);
    show(effects[k], parts.nothing_shown);
  }
  if (diagnosis.effect_names.size() > effects.size())
    page.text("Not drawn: " +
              join({diagnosis.effect_names.begin() + static_cast<std::ptrdiff_t>(effects.size()),
                    diagnosis.effect_names.end()}) +
              ".");
  if (nameless) {
    page.section("residual", "Where the residual lies");
    page.text("No effect is named for this residual. " + parts.residual_intro);
    if (unexplained.empty()) page.text("There are no dwells after a rotation to show.");
    for (const Figure& figure : unexplained) {
      page.subsection(figure.id == "asAccel" ? "as an accelerometer error" : "as a gyro error");
      page.raw(plots.html(figure));
    }
  }
  page.section("scores", "Every candidate of the catalogue");
  if (scored) {
    page.raw(plots.html("scores", score_legend(), parts.score_caption));
    page.raw(html_scores(diagnosis, threshold_z));
  } else {
    page.text(parts.not_scored);
  }
  page.section("parameters", "The 24 parameters");
  page.raw(html_parameters(diagnosis, context));
  page.section("allan", "Noise");
  page.raw(parts.noise_html);
  for (const Figure& figure : parts.further) {
    page.subsection("Allan deviation");
    show(figure, "No dwell is long enough for it.");
  }
  page.section("limits", "What this recording cannot tell");
  page.raw(parts.limits_html);
  page.section("faults", "Faults in the data");
  page.raw(html_faults(diagnosis, context));
  page.section("selection", "How the effects were chosen");
  page.raw(parts.selection_html);
  page.section("reading", "How to read this");
  page.raw(parts.reading_html);
  if (scored) {
    page.section("components", "Appendix: every component");
    page.raw(html_components(diagnosis, threshold_z));
  }
  page.raw("<p class=\"soft\">turncal " + html_escape(software_version()) + ", " + html_escape(context.time_utc) +
           "</p>\n");
  return {page.finish(), plots.problem};
}

}  // namespace turncal
