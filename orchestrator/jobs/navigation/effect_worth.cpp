#include "orchestrator/jobs/navigation/effect_worth.h"

#include <algorithm>
#include <cmath>

#include "calib/statistics/linear_algebra.h"
#include "orchestrator/jobs/navigation/navigation_job.h"
#include "orchestrator/report/diagnosis_file.h"

namespace turncal {
namespace {

ParameterFile file_of(const ModelWithout& model, const JointResult& extended, ParameterFile file) {
  file.parameters = model.parameters;
  for (std::size_t k = 0; k < extended.effects.size(); ++k) {
    const EffectColumn& column = extended.effects[k].column;
    if (column.entry == nullptr) continue;
    for (EffectValue& value : file.effects)
      if (value.name == column.entry->name &&
          value.component == column.entry->components[static_cast<std::size_t>(column.component)])
        value.value = model.effects[k];
  }
  return file;
}

// Rms over the branches, of the distance between two tracks of the same time.
double rate_between(const NavigatedFile& one, const NavigatedFile& other) {
  std::vector<double> rates;
  for (std::size_t k = 0; k < one.branches.size(); ++k) {
    const std::vector<TrackPoint>&a = one.branches[k].navigation.track, &b = other.branches[k].navigation.track;
    RadialErrorRate rate;
    for (std::size_t i = 0; i < a.size(); ++i) rate.add(a[i].time_s, (a[i].moved_m - b[i].moved_m).norm());
    rates.push_back(rate.nm_per_h());
  }
  return drift_over_runs(rates).rms_nm_per_h;
}

}  // namespace

ModelWithout model_without(const JointResult& extended, const Eigen::MatrixXd& P, const std::string& name) {
  ModelWithout model{to_vector(extended.parameters), {}};
  std::vector<Eigen::Index> rows;  // of the covariance, that are held
  for (const EstimatedEffect& effect : extended.effects) model.effects.push_back(effect.value);
  for (std::size_t i = 0; i < extended.free.size(); ++i) {
    const int key = extended.free[i] - parameter_count;
    if (key < 0) continue;
    const EffectEntry* entry = extended.effects[static_cast<std::size_t>(key)].column.entry;
    if (entry != nullptr && entry->name == name) rows.push_back(static_cast<Eigen::Index>(i));
  }
  const auto held = static_cast<Eigen::Index>(rows.size());
  Eigen::VectorXd values(held);
  for (Eigen::Index k = 0; k < held; ++k)
    values[k] =
        model.effects[static_cast<std::size_t>(extended.free[static_cast<std::size_t>(rows[k])] - parameter_count)];
  const Eigen::VectorXd change = P(Eigen::all, rows) * solve_symmetric(P(rows, rows), values);
  for (std::size_t i = 0; i < extended.free.size(); ++i) {
    const int key = extended.free[i];
    const double by = change[static_cast<Eigen::Index>(i)];
    if (key < parameter_count)
      model.parameters[key] -= by;
    else
      model.effects[static_cast<std::size_t>(key - parameter_count)] -= by;
  }
  for (const Eigen::Index row : rows)  // to the bit
    model.effects[static_cast<std::size_t>(extended.free[static_cast<std::size_t>(row)] - parameter_count)] = 0.0;
  return model;
}

Result<NavigationWorth> worth_of_effects(const Diagnosis& diagnosis, const DiagnosisContext& context,
                                         const std::string& recording, std::optional<double> to_s) {
  const ParameterFile after = diagnosis_parameters(diagnosis, context);
  ParameterFile before = after;
  before.parameters = to_vector(diagnosis.base.parameters);
  before.effects.clear();
  std::vector<ParameterFile> models = {after, std::move(before)};
  for (const std::string& effect : diagnosis.effect_names)
    models.push_back(
        file_of(model_without(diagnosis.extended, diagnosis.fitted_covariance, effect), diagnosis.extended, after));

  std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(recording));
  std::vector<CalibratedIntervals> files;
  for (ParameterFile& model : models) {
    CalibratedIntervals file = TRY(calibrated_intervals(std::move(model), recording, *source));
    files.push_back(std::move(file));
  }
  NavigationRequest request;
  request.recording = recording;
  request.to_s = to_s;
  const NavigationReport report = TRY(navigate_recording(request, *source, std::move(files)));
  const NavigatedFile& with_all = report.files[0];
  NavigationWorth worth;
  worth.branches = with_all.branches.size();
  worth.free_s = with_all.branches.front().navigation.free_s;
  worth.before = report.files[1].drift.rms_nm_per_h;
  worth.after = with_all.drift.rms_nm_per_h;
  worth.noise = with_all.expected ? with_all.expected->rms_nm_per_h : 0.0;
  for (std::size_t k = 0; k < diagnosis.effect_names.size(); ++k)
    worth.effects.emplace_back(diagnosis.effect_names[k], rate_between(with_all, report.files[k + 2]));
  return worth;
}

}  // namespace turncal
