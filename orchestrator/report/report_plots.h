// Figures into gnuplot's language, one script for all of them, and the bar chart of the candidates' scores.
#pragma once

#include <string>
#include <vector>

#include "calib/diagnosis/diagnosis.h"
#include "orchestrator/report/gnuplot.h"
#include "orchestrator/report/report_figure.h"

namespace turncal {

// One row of the score chart.
struct ScoreBar {
  std::string name;
  std::string remark;              // in the column at the right
  double z = 0.0;                  // of the strongest component
  std::vector<double> components;  // |z| of all of them
  enum class Role { added, above, below, invisible } role = Role::below;
};
// By effect, strongest first; invisible ones last.
std::vector<ScoreBar> score_bars(const Diagnosis& diagnosis, double threshold_z);
// |z| that chance reaches in false_alarm of all recordings, over all visible candidates together.
double family_threshold_z(const Diagnosis& diagnosis, double false_alarm);

// A drawing: a Figure, or the score chart.
struct Drawing {
  std::string id;
  std::string label;
  std::string script;  // from `set terminal` on
  int width = 960;     // px; 960 is the whole width of the page
};
Drawing draw(const Figure& figure);
Drawing draw_scores(const std::vector<ScoreBar>& bars, double threshold_z);

// All of them by one gnuplot, embeddable, in order.
Result<std::vector<std::string>> render(const std::vector<Drawing>& drawings, const GnuplotOptions& options);

}  // namespace turncal
