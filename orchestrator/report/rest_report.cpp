#include "orchestrator/report/rest_report.h"

#include "imu_io/base/format_number.h"
#include "orchestrator/report/report_data.h"
#include "orchestrator/report/report_format.h"
#include "orchestrator/report/report_page.h"
#include "orchestrator/report/report_tables.h"
#include "orchestrator/report/report_views.h"
#include "orchestrator/report/rest_view.h"
#include "orchestrator/station/version.h"

namespace turncal {
namespace {

constexpr std::size_t most_effect_figures = 4;

std::string html_stages(const RestDiagnosis& r) {
  if (r.stages.empty()) return "<p>No candidate was strong enough to be tried.</p>\n";
  std::string html =
      "<table>\n<thead><tr><th class=\"n\">stage</th><th>tried</th><th class=\"n\">gain T</th><th class=\"n\">p, all "
      "tests</th>"
      "<th>result</th></tr></thead>\n<tbody>\n";
  for (std::size_t k = 0; k < r.stages.size(); ++k) {
    const RestStage& s = r.stages[k];
    html += std::string("<tr") + (s.accepted ? "" : " class=\"dim\"") + "><td class=\"n\">" + std::to_string(k + 1) +
            "</td><td class=\"name\">" + html_escape(s.column.key()) + "</td><td class=\"n\">" +
            significant(s.gain, 3) + "</td><td class=\"n\">" + significant(s.p_value, 2, Alphabet::typographic) +
            "</td><td class=\"w\">" + html_escape(s.note) + "</td></tr>\n";
  }
  return html +
         "</tbody>\n</table>\n<p class=\"soft\">T: gain in twice the log likelihood when each kind of observation has "
         "a "
         "variance of its own. An effect's first component must be below 1 % over all tests, alone or as a group; "
         "further "
         "components follow by BIC.</p>\n";
}

std::string html_remarks(const RestDiagnosis& r) {
  std::string html;
  for (const RestCandidate& c : r.candidates)
    if (!c.remark.empty()) html += "<li><b>" + html_escape(c.effect) + "</b>: " + html_escape(c.remark) + "</li>\n";
  return html.empty() ? "" : "<ul>\n" + html + "</ul>\n";
}

void how_to_read(Page& page) {
  page.section("reading", "How to read this");
  page.raw(
      "<ul class=\"soft\">\n"
      "<li><b>Direction.</b> The gyros carry gravity from one rest to the next; where it arrives is compared with what "
      "the "
      "accelerometers see there.</li>\n"
      "<li><b>Norm.</b> Whatever the pose, the accelerometers must show the gravity of the site.</li>\n"
      "<li><b>Gyros at rest.</b> They must show the earth's rate and nothing else; what the unit creeps is taken "
      "off.</li>\n"
      "<li><b>Left out in turn.</b> Each rest and each rotation is predicted from all others.</li>\n"
      "<li><b>Normalised.</b> Divided by what the final model expects of that kind of observation: white noise, and a "
      "floor that "
      "was measured.</li>\n"
      "<li><b>Score.</b> Each effect of the catalogue beside the 21 parameters alone; z is the value it would get, in "
      "standard "
      "deviations. A missing effect widens the standard deviations of its kind, so scores are smaller than they will "
      "be.</li>\n"
      "</ul>\n");
}

}  // namespace

Report make_rest_report(const RestDiagnosis& r, const RestData& data, const Diagnosis& d,
                        const DiagnosisContext& context) {
  const DiagnosisWords words = rest_words(r, data, d, Alphabet::typographic);
  const double threshold_z = family_threshold_z(d, context.false_alarm);
  const std::vector<DwellResidual> residuals = rest_residuals(r, data);

  Plots plots;
  const Figure time = plots.add(rest_time_figure(r, data));
  std::vector<Figure> effects;
  for (std::size_t k = 0; k < std::min(d.effect_names.size(), most_effect_figures); ++k) {
    Figure figure = effect_figure(d, residuals, d.effect_names[k], k);
    figure.caption =
        d.effect_names[k].starts_with("gyro")
            ? "One point a rest: what the gyro reads too much there, or the tilt that the rotation before it left."
            : "One point a rest in which the axis carries more than half of gravity: the error of the norm, laid on "
              "it.";
    effects.push_back(plots.add(std::move(figure)));
  }
  std::vector<Figure> unexplained;
  if (d.verdict == Verdict::unexplained)
    for (Figure& figure : unexplained_figures(residuals)) {
      figure.caption = "One point a rest and axis.";
      unexplained.push_back(plots.add(std::move(figure)));
    }
  const bool scored = r.not_tested.empty();
  if (scored) plots.drawings.push_back(draw_scores(score_bars(d, threshold_z), threshold_z));
  plots.render_all(context.gnuplot);

  Page page("turncal diagnosis, unit " + context.recording.info.unit_serial);
  page.raw(html_identity(context));
  page.raw(html_verdict(d, words.sentence, ""));
  page.section("error", has_after(d) ? "Error before and after" : "Error");
  page.raw(html_errors(d, words.errors));
  if (has_after(d)) {
    page.subsection("What was added");
    page.raw(html_added_effects(d));
  }
  page.section("time", "Residuals against time");
  page.raw(plots.html(time));
  if (!effects.empty()) page.section("effects", "Residual against what the effect depends on");
  for (std::size_t k = 0; k < effects.size(); ++k) {
    page.subsection(d.effect_names[k]);
    if (effects[k].panels.empty())
      page.text("No rest shows it by itself.");
    else
      page.raw(plots.html(effects[k]));
  }
  if (!unexplained.empty()) {
    page.section("residual", "Where the residual lies");
    page.text("No effect is named for this residual. What it depends on, rest by rest, is for the reader to judge:");
    for (const Figure& figure : unexplained) {
      page.subsection(figure.id == "asAccel" ? "as an accelerometer error" : "as a gyro error");
      page.raw(plots.html(figure));
    }
  }
  page.section("scores", "Every candidate of the catalogue");
  if (scored) {
    page.raw(plots.html("scores", score_legend(), "Scores beside the 21 parameters alone."));
    page.raw(html_scores(d, threshold_z));
  } else {
    page.text("No effect was looked for: " + r.not_tested + ".");
  }
  page.section("parameters", "The 24 parameters");
  page.raw(html_parameters(d, context));
  page.section("noise", "Noise");
  page.text(words.noise + ".");
  page.section("limits", "What this recording cannot tell");
  page.raw(html_limits(d, context));
  page.raw(html_remarks(r));
  page.section("faults", "Faults in the data");
  page.raw(html_faults(d, context));
  page.section("selection", "How the effects were chosen");
  page.raw(html_stages(r));
  how_to_read(page);
  if (scored) {
    page.section("components", "Appendix: every component");
    page.raw(html_components(d, threshold_z));
  }
  page.raw("<p class=\"soft\">turncal " + html_escape(software_version()) + ", " + html_escape(context.time_utc) +
           "</p>\n");
  return {page.finish(), plots.problem};
}

Result<WrittenDiagnosis> write_rest_diagnosis(const std::string& folder, const RestDiagnosis& r, const RestData& data,
                                              const Diagnosis& d, const DiagnosisContext& context) {
  std::string conf = format_diagnosis(d);
  conf += std::string("quality.trusted = ") + (r.trusted ? "true" : "false") + "\n";
  if (!r.base.converged)  // not fitted: nothing to report but why
    return write_diagnosis_files(folder, {}, conf, {});
  ParameterFile file;
  describe_recording(context.recording.info, file);
  describe_rest_fit(r.final, r.effects, data, file);
  file.add_further("quality.trusted", std::string(r.trusted ? "true" : "false"));
  complete_parameters(d, context, file);
  const Result<std::string> parameters = d.verdict == Verdict::not_tested ? std::string() : format_parameter_file(file);
  if (!parameters) return parameters.error();
  for (const ErrorRow& row : rest_words(r, data, d, Alphabet::plain).errors)
    if (!row.normalised)
      conf += "# " + row.what + ": " + format_number(row.before) + " before, " + format_number(row.after) + " after, " +
              row.unit + "\n";
  return write_diagnosis_files(folder, make_rest_report(r, data, d, context), conf, *parameters);
}

}  // namespace turncal
