#include "orchestrator/report/rest_report.h"

#include "imu_io/base/format_number.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/report/report_tables.h"
#include "orchestrator/report/rest_as_diagnosis.h"

namespace turncal {
namespace {

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

constexpr const char* how_to_read_rests =
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
    "</ul>\n";

}  // namespace

Report make_rest_report(const RestDiagnosis& r, const RestData& data, const Diagnosis& d,
                        const DiagnosisContext& context) {
  DiagnosisWords words = rest_words(r, data, d, Alphabet::typographic);
  ReportParts parts;
  parts.sentence = std::move(words.sentence);
  parts.errors = std::move(words.errors);
  parts.time_title = "Residuals against time";
  parts.time = rest_time_figure(r, data);
  parts.residuals = rest_residuals(r, data);
  parts.one_point =
      "One point a rest: what the gyro reads too much there, or the tilt that the rotation before it left.";
  parts.one_point_accel =
      "One point a rest in which the axis carries more than half of gravity: the error of the norm, laid on it.";
  parts.nothing_shown = "No rest shows it by itself.";
  parts.residual_intro = "What it depends on, rest by rest, is for the reader to judge:";
  if (!r.not_tested.empty()) parts.not_scored = "No effect was looked for: " + r.not_tested + ".";
  parts.score_caption = "Scores beside the 21 parameters alone.";
  parts.noise_html = "<p>" + html_escape(words.noise + ".") + "</p>\n";
  parts.limits_html = html_limits(d, context) + html_remarks(r);
  parts.selection_html = html_stages(r);
  parts.reading_html = how_to_read_rests;
  return make_report(d, context, std::move(parts));
}

DiagnosisFiles rest_diagnosis_files(const RestDiagnosis& r, const RestData& data, const Diagnosis& d,
                                    const DiagnosisContext& context) {
  std::string conf = format_diagnosis(d);
  if (!r.base.converged) return {{}, conf, std::nullopt};  // not fitted: nothing to report but why
  ParameterFile file;
  describe_recording(context.recording.info, file);
  describe_rest_fit(r.final, r.effects, data, file);
  complete_parameters(d, context, file);
  for (const ErrorRow& row : rest_words(r, data, d, Alphabet::plain).errors)
    if (!row.normalised)
      conf += "# " + row.what + ": " + format_number(row.before) + " before, " + format_number(row.after) + " after, " +
              row.unit + "\n";
  DiagnosisFiles files{make_rest_report(r, data, d, context), conf, std::nullopt};
  if (d.verdict != Verdict::not_tested) files.parameters = std::move(file);
  return files;
}

}  // namespace turncal
