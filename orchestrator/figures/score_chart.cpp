#include "orchestrator/figures/diagnosis_figures.h"

#include <algorithm>
#include <cmath>

#include "calib/model/effects.h"
#include "calib/statistics/distributions.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/figures/report_format.h"

namespace turncal {

double family_threshold_z(const Diagnosis& diagnosis, double false_alarm) {
  const auto visible = std::ranges::count_if(diagnosis.candidates, [](const CandidateScore& c) { return c.visible; });
  return std::sqrt(chi_square_1_limit(false_alarm / static_cast<double>(std::max<std::ptrdiff_t>(visible, 1))));
}

std::vector<ScoreBar> score_bars(const Diagnosis& diagnosis, double threshold_z) {
  std::vector<ScoreBar> bars;
  for (const EffectEntry& entry : effect_catalogue()) {
    ScoreBar bar;
    bar.name = entry.name;
    bool listed = false;
    bool visible = false;
    std::string strongest;
    for (const CandidateScore& c : diagnosis.candidates) {
      if (c.column.entry == nullptr || c.column.entry->name != entry.name) continue;
      listed = true;
      if (!c.visible || !std::isfinite(c.z)) continue;
      visible = true;
      bar.components.push_back(std::abs(c.z));
      if (std::abs(c.z) < bar.z && !strongest.empty()) continue;
      bar.z = std::abs(c.z);
      strongest = component_name(c.column);
    }
    const bool added = std::ranges::find(diagnosis.effect_names, entry.name) != diagnosis.effect_names.end();
    using Role = ScoreBar::Role;
    bar.role = !visible ? Role::invisible : added ? Role::added : bar.z > threshold_z ? Role::above : Role::below;
    bar.remark = visible                   ? significant(bar.z, bar.z < 10.0 ? 2 : 3) + "  (" + strongest + ")"
                 : listed                  ? "cannot be seen in this recording"
                 : entry.needs_temperature ? "needs a recorded temperature"
                                           : "not tested";
    bars.push_back(std::move(bar));
  }
  std::ranges::stable_sort(bars, [](const ScoreBar& a, const ScoreBar& b) {
    const bool a_seen = a.role != ScoreBar::Role::invisible;
    const bool b_seen = b.role != ScoreBar::Role::invisible;
    return a_seen != b_seen ? a_seen : a.z > b.z;
  });
  return bars;
}

Drawing draw_scores(const std::vector<ScoreBar>& bars, double threshold_z) {
  // The axis is the square root of |z|: small scores stay apart and large ones on the page.
  Drawing drawing{"scores", "Score of every effect of the catalogue against the threshold", {}, 960};
  drawing.legend = {{"#0072B2", "■", "added to the model"},
                    {"#B87A00", "■", "above the threshold, not added"},
                    {"#808080", "■", "below the threshold"}};
  std::string& script = drawing.script;
  const int rows = static_cast<int>(bars.size());
  script = gnuplot_terminal(960, 24 * rows + 80);
  double largest = 2.0 * threshold_z;
  for (const ScoreBar& bar : bars) largest = std::max(largest, bar.z);
  script += "set lmargin 30\nset rmargin 26\nset tmargin 2.2\nset bmargin 3.4\nunset grid\nset border 1\n";
  script += "set yrange [" + std::to_string(rows) + ":-1]\n";
  script += "set xrange [0:" + significant(std::sqrt(largest) * 1.04, 6) + "]\n";
  script += "set xlabel 'score |z| of the strongest component (square-root scale); dots: the other components'\n";
  script += "set xtics (";
  bool first = true;
  for (const double tick :
       {0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 1e4, 2e4, 5e4}) {
    if (tick > largest) break;
    // ticks that would crowd the left end of a long axis are left out
    if (tick > 0.0 && tick < largest / 150.0) continue;
    script += (first ? "" : ", ") + gnuplot_text(format_number(tick)) + " " + significant(std::sqrt(tick), 7);
    first = false;
  }
  script += ")\nset ytics scale 0 (";
  for (int k = 0; k < rows; ++k)
    script += (k > 0 ? ", " : "") + gnuplot_text(bars[static_cast<std::size_t>(k)].name) + " " + std::to_string(k);
  script += ")\n";
  const std::string x = significant(std::sqrt(threshold_z), 7);
  script += "set arrow 1 from " + x + ",-0.8 to " + x + "," + significant(rows - 0.4, 6) +
            " nohead front dt 2 lw 1.5 lc rgb '" + drawing_ink + "'\n";
  script += "set label 1 " + gnuplot_text("family-wise threshold " + significant(threshold_z, 2)) + " at " + x +
            ",-1.25 center textcolor rgb '" + drawing_ink + "'\n";
  const auto colour = [](ScoreBar::Role role) {
    return role == ScoreBar::Role::added ? 0x0072B2 : role == ScoreBar::Role::above ? 0xB87A00 : 0x808080;
  };
  script += "$bars << EOD\n";
  for (int k = 0; k < rows; ++k) {
    const ScoreBar& bar = bars[static_cast<std::size_t>(k)];
    const double right = std::sqrt(bar.z);
    script += significant(0.5 * right, 7) + " " + std::to_string(k) + " 0 " + significant(right, 7) + " " +
              significant(k - 0.36, 6) + " " + significant(k + 0.36, 6) + " " + std::to_string(colour(bar.role)) + "\n";
  }
  script += "EOD\n";
  for (int k = 0; k < rows; ++k) {
    const ScoreBar& bar = bars[static_cast<std::size_t>(k)];
    script += "set label " + std::to_string(k + 2) + " " + gnuplot_text(bar.remark) + " at graph 1.03, first " +
              std::to_string(k) + " left textcolor rgb '" + drawing_ink + "'\n";
  }
  script += "$dots << EOD\n";
  bool any = false;
  for (int k = 0; k < rows; ++k)
    for (const double z : bars[static_cast<std::size_t>(k)].components)
      if (z < bars[static_cast<std::size_t>(k)].z) {
        script += significant(std::sqrt(z), 7) + " " + std::to_string(k) + "\n";
        any = true;
      }
  script += "EOD\nset style fill solid 1.0 noborder\n";
  script += "plot $bars using 1:2:3:4:5:6:7 with boxxyerror lc rgb variable notitle";
  if (any) script += ", $dots using 1:2 with points pt 7 ps 0.3 lc rgb '" + std::string(drawing_ink) + "' notitle";
  script += "\n";
  return drawing;
}

}  // namespace turncal
