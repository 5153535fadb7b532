// The report of a diagnosis: one self-contained HTML file (inline vector plots and style, no scripts, nothing from outside),
// read from the top: verdict, error before and after, residuals, scores, parameters, noise, limits, faults, selection.
// docs/report.md explains every section.
//
// Plots are drawn by gnuplot (gnuplot.h); when it cannot draw, the report says so in their place and is complete otherwise.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "calib/diagnosis/diagnosis.h"
#include "orchestrator/figures/diagnosis_context.h"
#include "orchestrator/figures/report_dwells.h"
#include "orchestrator/figures/report_figure.h"
#include "orchestrator/report/diagnosis_text.h"

namespace turncal {

// Where a run that verifies its result says how that ended.
inline constexpr std::string_view verification_place = "<div id=\"verification\"></div>\n";
void say_verification(const std::string& words, std::string& html);

struct Report {
  std::string html;
  std::string plot_problem;  // one line when there are no plots, else empty
};
Report make_report(const Diagnosis& diagnosis, const DiagnosisContext& context);

// What a report of a table's recording and one of hand-turned data say differently (rest_report.h). Texts are plain, `_html` is HTML.
struct ReportParts {
  std::string sentence, reason;  // the verdict
  std::vector<ErrorRow> errors;
  std::string time_title, no_time;
  Figure time;
  std::vector<DwellResidual> residuals;  // one a dwell or rest
  std::string one_point;  // caption of the effects' figures: of gyros, of accelerometers; empty: their own
  std::string one_point_accel;
  std::string nothing_shown;  // instead of an effect's figure
  std::string residual_intro;
  std::string not_scored;  // why there are no scores; empty: there are
  std::string score_caption;
  std::string noise_html, limits_html, selection_html, reading_html;
  std::vector<Figure> further;  // after the noise
};
Report make_report(const Diagnosis& diagnosis, const DiagnosisContext& context, ReportParts parts);

}  // namespace turncal
