#include "calib/rest_diagnosis/rest_candidates.h"

#include <algorithm>
#include <cmath>

#include "calib/model/attitude.h"

namespace turncal {

namespace {

// Whether an effect's regressors change when the unit is turned about the vertical: then they need the heading.
bool needs_heading(const EffectEntry& entry, const Site& site) {
  const int count = static_cast<int>(entry.components.size());
  BlockState s;
  s.f_b = {3.0, 8.0, 4.0};
  s.w_b = {0.3, -0.2, 0.5};
  s.w_dot_b = {0.1, 0.2, -0.3};
  s.duration_s = 0.2;
  s.time_s = 100.0;
  s.since_rotation_s = 3.0;
  s.temperature_c = 5.0;
  const double tau = entry.taus_s.empty() ? 0.0 : entry.taus_s.front();
  Eigen::Matrix3Xd gyro[2], accel[2];
  for (int k = 0; k < 2; ++k) {
    s.C_nb = attitude_from_angles(k * 1.5, 0.4, 0.7);
    gyro[k].setZero(3, count);
    accel[k].setZero(3, count);
    entry.write(s, site, tau, gyro[k], accel[k]);
  }
  return (gyro[0] - gyro[1]).norm() + (accel[0] - accel[1]).norm() > 1e-9 * (gyro[0].norm() + accel[0].norm());
}

}  // namespace

void find_testable(RestDiagnosisModel& m, RestDiagnosis& d) {
  std::set<std::string_view> headed;
  for (const EffectEntry& entry : effect_catalogue())
    if (needs_heading(entry, m.site)) headed.insert(entry.name);
  for (const EffectColumn& column : catalogue_columns(m.data.recording->info))
    if (!headed.contains(column.entry->name)) m.testable.push_back(column);
  for (const EffectEntry& entry : effect_catalogue()) {
    RestCandidate candidate;
    candidate.effect = entry.name;
    for (const std::string_view component : entry.components) candidate.components.emplace_back(component);
    if (headed.contains(entry.name))
      candidate.remark = "needs the heading";
    else if (entry.needs_temperature && !m.data.recording->info.has_temperature)
      candidate.remark = "no temperature recorded";
    d.candidates.push_back(std::move(candidate));
  }
}

void fill_candidates(const RestDiagnosisModel& m, const RestScores& scores, RestDiagnosis& d) {
  int tests = 0;
  for (int k = 0; k < static_cast<int>(m.testable.size()); ++k) tests += scores.of(k).visible ? 1 : 0;
  for (RestCandidate& candidate : d.candidates) {
    if (!candidate.remark.empty()) continue;
    const EffectEntry& entry = *find_effect(candidate.effect);
    const std::vector<double> taus = entry.taus_s.empty() ? std::vector<double>{0.0} : entry.taus_s;
    double best_group = -1.0;
    for (const double tau : taus) {
      const std::vector<int> group = m.members(entry, tau);
      const RestScores::Group test = scores.group(group);
      if (test.rank == 0 || test.chi_square <= best_group) continue;
      best_group = test.chi_square;
      candidate.tau_s = tau;
      candidate.rank = test.rank;
      candidate.score = test.chi_square;
      candidate.p_value = test.p_value;
      candidate.best_statistic = -1.0;
      candidate.detectable.clear();
      candidate.values.clear();
      candidate.sigmas.clear();
      for (const int k : group) {
        const ColumnScore& score = scores.of(k);
        const bool absurd = 5.0 * score.sigma > absurd_magnitude(entry, m.duration_s);
        candidate.detectable.push_back(score.visible && !absurd ? 5.0 * score.sigma : INFINITY);
        candidate.values.push_back(score.value);
        candidate.sigmas.push_back(score.sigma);
        if (absurd) continue;
        if (score.visible && score.statistic > candidate.best_statistic) {
          candidate.best_statistic = score.statistic;
          candidate.best_component =
              entry.components[static_cast<std::size_t>(m.testable[static_cast<std::size_t>(k)].component)];
          candidate.p_value = std::min(candidate.p_value, score.p_value);
        }
      }
    }
    candidate.p_value = std::min(1.0, candidate.p_value * tests);
    if (candidate.rank == 0)
      candidate.remark = "leaves no trace in rests and in gravity's direction after rotations";
    else if (candidate.best_component.empty())
      candidate.remark = "would have to be larger than any sensor has it to be caught";
  }
}

void strike_invisible(RestDiagnosisModel& m, const RestScores& scores) {
  std::vector<EffectColumn> kept;
  for (std::size_t k = 0; k < m.testable.size(); ++k) {
    const ColumnScore& score = scores.of(static_cast<int>(k));
    if (score.visible && 5.0 * score.sigma <= absurd_magnitude(*m.testable[k].entry, m.duration_s))
      kept.push_back(m.testable[k]);
  }
  m.testable = std::move(kept);
}

}  // namespace turncal
