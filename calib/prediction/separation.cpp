#include "calib/prediction/separation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calib/joint/score_algebra.h"
#include "calib/model/limits.h"

namespace turncal {
namespace {

constexpr int biases = 6;

std::vector<int> counted(int from, std::size_t n) {
  std::vector<int> all(n);
  std::iota(all.begin(), all.end(), from);
  return all;
}

}  // namespace

Separation::Separation(const CompressedRecording& recording, const Diagnosis& diagnosis, const std::string& name,
                       bool same_run)
    : same_run_(same_run), recording_(recording), diagnosis_(diagnosis), names_{name} {
  if (const auto aliases = diagnosis.aliases.find(name); aliases != diagnosis.aliases.end())
    names_.insert(names_.end(), aliases->second.begin(), aliases->second.end());
  std::vector<double> values;
  for (const EstimatedEffect& effect : diagnosis.extended.effects) {
    if (effect.column.entry->name == name) continue;
    beside_.push_back(effect.column);
    values.push_back(effect.value);
  }
  beside_values_ = Eigen::Map<Eigen::VectorXd>(values.data(), values.size());

  JointOptions options;
  options.start = diagnosis.base.parameters;
  options.noise = diagnosis.extended.noise;
  options.faults_of = &diagnosis.base;
  options.effects = beside_;
  options.start_effects = beside_values_;
  std::vector<EffectColumn> all;
  for (const EffectColumn& column : catalogue_columns(recording.info))
    if (std::ranges::find(names_, column.entry->name) != names_.end()) all.push_back(column);
  options.candidates = all;
  const JointResult fit = joint_estimate(recording, options);
  const int first = parameter_count + int(beside_.size());
  const Scores scores =
      eliminate(fit.last.information, fit.last.gradient, fit.free, counted(first, options.candidates.size()));

  // For every member, the time constant and the component that explain the recording best.
  std::vector<int> kept = counted(0, first);
  for (const std::string& member : names_) {
    int best = -1;
    const auto z_square = [&](int k) { return scores.s[k] * scores.s[k] / scores.Q(k, k); };
    for (int k = 0; k < int(all.size()); ++k)
      if (all[k].entry->name == member && is_visible(scores, k) && (best < 0 || z_square(k) > z_square(best))) best = k;
    const EffectColumn* const strongest = best < 0 ? nullptr : &all[best];
    members_.emplace_back();
    strongest_.push_back(-1);
    values_.push_back(
        best < 0 ? 0.0 : std::abs(scores.s[best] / scores.Q(best, best)) - 1.0 / std::sqrt(scores.Q(best, best)));
    for (int k = 0; k < int(all.size()); ++k) {
      const EffectColumn& column = all[k];
      if (strongest == nullptr || column.entry != strongest->entry || column.tau_s != strongest->tau_s) continue;
      if (k == best) strongest_.back() = int(columns_.size());
      members_.back().push_back(int(columns_.size()));
      columns_.push_back(column);
      kept.push_back(first + k);
    }
  }
  information_ = fit.last.information(kept, kept);
  for (const Block& block : recording.blocks)
    if (std::isfinite(block.temperature_c)) last_temperature_c_ = block.temperature_c;
}

Eigen::MatrixXd Separation::information_of(const PlannedMotion& motion, double sample_period_s) const {
  RecordingInfo info = recording_.info;
  info.sample_period_s = sample_period_s;
  std::optional<TemperatureProfile> temperature;
  if (info.has_temperature) temperature = TemperatureProfile{.start_c = last_temperature_c_};
  const CompressedRecording planned = planned_recording(info, motion, diagnosis_.base.parameters, temperature);
  JointOptions options;
  options.start = diagnosis_.base.parameters;
  options.noise = diagnosis_.extended.noise;
  options.candidates = beside_;
  options.candidates.insert(options.candidates.end(), columns_.begin(), columns_.end());
  options.reference_temperature_c = diagnosis_.base.reference_temperature_c;
  options.look_for_faults = false;
  return joint_estimate(planned, options).last.information;
}

double chance_to_tell(double gain) {
  return 0.5 * std::erfc((SelectionLimits{}.bic_margin - gain) / std::sqrt(8.0 * std::max(gain, 1e-9)));
}

std::vector<AliasPair> Separation::pairs(const PlannedMotion* motion, double sample_period_s) const {
  std::vector<EffectColumn> all = beside_;
  all.insert(all.end(), columns_.begin(), columns_.end());
  const int first = parameter_count + int(beside_.size());
  const int own = parameter_count + int(all.size());  // behind it: columns of the second recording alone
  std::vector<int> place = counted(0, own);
  int size = own;
  for (int k = 0; k < biases && !same_run_; ++k) place[k] = size++;
  for (std::size_t k = 0; k < all.size(); ++k)
    if (all[k].entry->of_one_run) place[parameter_count + k] = size++;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size);
  information.topLeftCorner(own, own) = information_;
  if (motion != nullptr) {
    const Eigen::MatrixXd second = information_of(*motion, sample_period_s);
    if (second.rows() == own) information(place, place) += second;
  }

  std::vector<int> base = free_parameters(), candidates = counted(first, columns_.size());
  for (int k = parameter_count; k < first; ++k) base.push_back(k);
  for (int k = own; k < own + biases && !same_run_; ++k) base.push_back(k);
  std::vector<std::vector<int>> groups = members_;  // into the candidates
  for (std::size_t k = 0; k < all.size(); ++k) {
    const int there = place[parameter_count + k];
    if (!all[k].entry->of_one_run) continue;
    if (k < beside_.size()) {
      base.push_back(there);
      continue;
    }
    for (std::vector<int>& group : groups)
      if (std::ranges::find(group, int(k - beside_.size())) != group.end()) group.push_back(int(candidates.size()));
    candidates.push_back(there);
  }
  const Scores scores = eliminate(information, Eigen::VectorXd::Zero(size), base, candidates);
  std::vector<AliasPair> pairs;
  for (std::size_t i = 0; i < names_.size(); ++i) {
    for (std::size_t j = 0; j < names_.size(); ++j) {
      if (i == j || (i != 0 && j != 0) || strongest_[i] < 0 || strongest_[j] < 0) continue;
      AliasPair pair{names_[i], names_[j]};
      pair.correlation = multiple_correlation(scores, strongest_[i], groups[j]);
      pair.gain = std::pow(std::max(values_[i], 0.0), 2) * scores.Q(strongest_[i], strongest_[i]) *
                  (1.0 - std::pow(pair.correlation, 2));
      pairs.push_back(std::move(pair));
    }
  }
  return pairs;
}

}  // namespace turncal
