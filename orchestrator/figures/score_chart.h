// The bar chart of the candidates' scores against their common threshold.
#pragma once

#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "orchestrator/figures/drawing.h"

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

Drawing draw_scores(const std::vector<ScoreBar>& bars, double threshold_z);

}  // namespace turncal
