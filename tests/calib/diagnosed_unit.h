// For tests: a unit of the rig recorded over the fourteen steps and a holdout, and what is said of its diagnosis.
#pragma once

#include "calib/evidence/diagnosis.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {

// What is said of it, in a line.
inline std::string told(const Diagnosis& d) {
  std::string text = std::string(to_string(d.verdict)) + ": " + d.reason;
  for (const std::string& name : d.effect_names) text += ", " + name;
  return text;
}

struct Made {
  CompressedRecording recording, holdout;
  Parameters truth;
};

inline Made make(RigConfig config, const std::function<void(RigConfig&)>& before_holdout = {}) {
  static const Sequence second = must_read_sequence("holdout.seq");
  RigRecording first = record_on_rig(fourteen_steps(), config);
  config.noise_seed = config.noise_seed.value_or(config.seed) + 1000000;
  for (std::size_t k = 0; k < 24; ++k) config.truth[k] = to_vector(first.truth)[int(k)];
  if (before_holdout) before_holdout(config);
  return {std::move(first.recording), record_on_rig(second, config).recording, first.truth};
}

inline RigConfig unit(std::uint64_t seed) {
  RigConfig config = default_rig_config();
  config.seed = seed;
  config.noise_seed = 40 + seed;
  return config;
}

inline Diagnosis diagnose_with_holdout(const Made& made, DiagnosisOptions options = {}) {
  options.holdouts = {&made.holdout};
  return diagnose(made.recording, options);
}

inline double worst_sigmas(const Diagnosis& d, const Parameters& truth) {
  const ParameterVector error = to_vector(d.extended.parameters) - to_vector(truth);
  double worst = 0.0;
  for (int k = 0; k < parameter_count; ++k)
    if (d.extended.sigma[k] > 0.0) worst = std::max(worst, std::abs(error[k]) / d.extended.sigma[k]);
  return worst;
}

// Found, or not told from what was found.
inline bool in_class(const Diagnosis& d, const std::string& name) {
  const auto has = [&](const std::vector<std::string>& names) { return std::ranges::find(names, name) != names.end(); };
  return has(d.effect_names) || std::ranges::any_of(d.aliases, [&](const auto& alias) { return has(alias.second); });
}

}  // namespace turncal
