// The report of a diagnosis: one self-contained HTML file (inline vector plots and style, no scripts, nothing from outside),
// read from the top: verdict, error before and after, residuals, scores, parameters, noise, limits, faults, selection.
// docs/report.md explains every section.
//
// Plots are drawn by gnuplot (gnuplot.h); when it cannot draw, the report says so in their place and is complete otherwise.
#pragma once

#include <string>

#include "calib/diagnosis/diagnosis.h"
#include "orchestrator/report/diagnosis_context.h"

namespace turncal {

struct Report {
  std::string html;
  std::string plot_problem;  // one line when there are no plots, else empty
};
Report make_report(const Diagnosis& diagnosis, const DiagnosisContext& context);

}  // namespace turncal
