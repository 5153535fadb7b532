#include "calib/fleet/unit_statistics.h"

#include <fmt/format.h>

#include "calib/joint/score_algebra.h"
#include "calib/joint/several_recordings.h"
#include "calib/statistics/numerics.h"

namespace turncal {

std::string column_key(const EffectColumn& column) {
  if (column.tau_s == 0.0) return column.key();
  return fmt::format("{} {} {:.15g}", column.key(), column.entry->variant, column.tau_s);
}

UnitStatistics unit_statistics(const CompressedRecording& recording, const JointResult& estimate) {
  std::vector<EffectColumn> candidates = catalogue_columns(recording.info), columns;
  std::erase_if(candidates, [](const EffectColumn& c) { return c.tau_s > 1920.0; });  // a slower one is a drift here
  for (const EstimatedEffect& effect : estimate.effects) columns.push_back(effect.column);
  const int first = parameter_count + int(columns.size());  // first candidate
  columns.insert(columns.end(), candidates.begin(), candidates.end());
  EffectModel model = make_effect_model(columns, {recording.info.latitude_deg}, estimate.reference_temperature_c);
  for (std::size_t k = 0; k < estimate.effects.size(); ++k) model.values[k] = estimate.effects[k].value;
  FilterSetup setup = estimate.setup;
  const CompressedRecording fewer = coarser(recording, coarseness_of_scores, setup);
  const FilterResult pass = run_filter(fewer, estimate.parameters, model, setup);

  UnitStatistics u;
  u.value = to_vector(estimate.parameters);
  u.sigma = estimate.sigma;
  u.level = estimate.normalised_rms;
  std::vector<int> base, added;
  for (int k = 0; k < parameter_count; ++k)
    if (estimate.determined[k] && parameter_is_free[k]) base.push_back(k);
  for (int k = parameter_count; k < first; ++k) base.push_back(k);
  for (int k = 0; k < int(candidates.size()); ++k) added.push_back(first + k);
  const Scores scores = eliminate(pass.information, pass.gradient, base, added);
  const Eigen::MatrixXd moved =
      -solve_symmetric(Eigen::MatrixXd(pass.information(base, base)), Eigen::MatrixXd(pass.information(base, added)));
  u.s = scores.s;
  u.Q = scores.Q.cast<float>();
  u.moves = Eigen::MatrixXf::Zero(parameter_count, scores.s.size());
  for (std::size_t row = 0; row < base.size() && base[row] < parameter_count; ++row)
    u.moves.row(base[row]) = moved.row(row).cast<float>();
  for (Eigen::Index k = 0; k < u.s.size(); ++k) {
    u.columns.push_back(column_key(candidates[k]));
    if (is_visible(scores, int(k))) continue;
    u.s[k] = 0.0;
    u.Q.row(k).setZero();
    u.Q.col(k).setZero();
    u.moves.col(k).setZero();
  }
  return u;
}

std::optional<UnitStatistics> unit_statistics(const std::vector<const CompressedRecording*>& recordings) {
  const JoinedRecordings joined = join_recordings(recordings);
  JointOptions options;
  options.effects = joined.turn_ons;
  options.begins = joined.begins;
  const JointResult estimate = joint_estimate(joined.data, options);
  if (!estimate.converged) return std::nullopt;
  return unit_statistics(joined.data, estimate);
}

}  // namespace turncal
