#include "orchestrator/report/report.h"

#include <algorithm>
#include <vector>

#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/report_data.h"
#include "orchestrator/report/report_dwells.h"
#include "orchestrator/report/report_format.h"
#include "orchestrator/report/report_page.h"
#include "orchestrator/report/report_plots.h"
#include "orchestrator/report/report_tables.h"
#include "orchestrator/report/report_views.h"
#include "orchestrator/station/version.h"

namespace turncal {
namespace {

void how_to_read(Page& page) {
  page.section("reading", "How to read this");
  page.raw(
      "<ul class=\"soft\">\n"
      "<li><b>Residual velocity.</b> The unit stands on the table. Navigating its calibrated data must give velocity "
      "zero; what it "
      "gives instead is the error that matters in use.</li>\n"
      "<li><b>Normalised residual.</b> The same, second by second, divided by what the sensors' noise explains. 1 is "
      "perfect; "
      "noise alone gives 1.</li>\n"
      "<li><b>Score.</b> Each effect of the catalogue is offered to the data beside the 24 parameters. z is the value "
      "it would get, "
      "in standard deviations. The threshold holds for all of them together: chance alone crosses it in the stated "
      "share of "
      "recordings.</li>\n"
      "<li><b>Held-out data.</b> Data that was not used in the fit. An effect that does not lower the error there is "
      "not added.</li>\n"
      "<li><b>Detectable.</b> Five standard deviations: what this recording would have found.</li>\n"
      "</ul>\n");
}

}  // namespace

Report make_report(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  constexpr std::size_t most_effect_figures = 4;
  const double threshold_z = family_threshold_z(diagnosis, context.false_alarm);
  const std::vector<DwellResidual> dwells = dwell_residuals(diagnosis, context.recording);
  const bool nameless = diagnosis.verdict == Verdict::unexplained || diagnosis.verdict == Verdict::noise_model;

  Plots plots;
  const auto add = [&plots, &context](Figure figure) {
    mark_steps(context.recording, figure);
    return plots.add(std::move(figure));
  };
  const Figure time = diagnosis.residuals.empty() ? Figure{} : add(time_figure(diagnosis));
  std::vector<Figure> effects;
  for (std::size_t k = 0; k < std::min(diagnosis.effect_names.size(), most_effect_figures); ++k)
    effects.push_back(add(effect_figure(diagnosis, dwells, diagnosis.effect_names[k], k)));
  std::vector<Figure> unexplained;
  if (nameless)
    for (Figure& figure : unexplained_figures(dwells)) unexplained.push_back(add(std::move(figure)));
  const std::vector<ScoreBar> bars = score_bars(diagnosis, threshold_z);
  if (!diagnosis.candidates.empty()) plots.drawings.push_back(draw_scores(bars, threshold_z));
  const Figure allan = add(allan_figure(diagnosis.base.allan));
  plots.render_all(context.gnuplot);

  Page page("turncal diagnosis, unit " + context.recording.info.unit_serial);
  page.raw(html_identity(context));
  page.raw(html_verdict(diagnosis, context));

  page.section("error", has_after(diagnosis) ? "Error before and after" : "Error");
  page.raw(html_errors(diagnosis));
  if (has_after(diagnosis)) {
    page.subsection("What was added");
    page.raw(html_added_effects(diagnosis));
  }

  page.section("time", "Residual velocity against time");
  if (time.panels.empty())
    page.text("There are no static seconds after a rotation to show.");
  else
    page.raw(plots.html(time));

  if (!effects.empty()) {
    page.section("effects", "Residual against what the effect depends on");
    for (std::size_t k = 0; k < effects.size(); ++k) {
      page.subsection(diagnosis.effect_names[k]);
      if (effects[k].panels.empty())
        page.text("No dwell of this recording shows it by itself.");
      else
        page.raw(plots.html(effects[k]));
    }
    if (diagnosis.effect_names.size() > effects.size())
      page.text("Not drawn: " +
                join({diagnosis.effect_names.begin() + static_cast<std::ptrdiff_t>(effects.size()),
                      diagnosis.effect_names.end()}) +
                ".");
  }
  if (nameless) {
    page.section("residual", "Where the residual lies");
    page.text("No effect is named for this residual. What it depends on, dwell by dwell, is for the reader to judge:");
    if (unexplained.empty()) page.text("There are no dwells after a rotation to show.");
    for (const Figure& figure : unexplained) {
      page.subsection(figure.id == "asAccel" ? "as an accelerometer error" : "as a gyro error");
      page.raw(plots.html(figure));
    }
  }

  page.section("scores", "Every candidate of the catalogue");
  if (diagnosis.candidates.empty()) {
    page.text("No scores were computed.");
  } else {
    page.raw(plots.html(
        "scores", score_legend(),
        "Scores beside the 24 parameters alone. A strong effect lifts the scores of those that resemble it; the "
        "selection below takes them one at a time."));
    page.raw(html_scores(diagnosis, threshold_z));
  }

  page.section("parameters", "The 24 parameters");
  page.raw(html_parameters(diagnosis, context));

  page.section("allan", "Noise");
  page.raw(html_noise(diagnosis, context));
  page.subsection("Allan deviation");
  if (allan.panels.empty())
    page.text("No dwell is long enough for it.");
  else
    page.raw(plots.html(allan));

  page.section("limits", "What this recording cannot tell");
  page.raw(html_limits(diagnosis, context));

  page.section("faults", "Faults in the data");
  page.raw(html_faults(diagnosis, context));

  page.section("selection", "How the effects were chosen");
  page.raw(html_selection(diagnosis));

  how_to_read(page);
  if (!diagnosis.candidates.empty()) {
    page.section("components", "Appendix: every component");
    page.raw(html_components(diagnosis, threshold_z));
  }
  page.raw("<p class=\"soft\">turncal " + html_escape(software_version()) + ", " + html_escape(context.time_utc) +
           "</p>\n");
  return {page.finish(), plots.problem};
}

}  // namespace turncal
