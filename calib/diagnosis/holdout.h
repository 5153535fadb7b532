// The error of a model on data that was not used to fit it: the gate of the diagnosis.
//
// With a holdout recording: its own start is levelled and its first heading estimated by the filter, the parameters and
// effects are taken as they are; the error is the normalised innovation of every static second there.
// Without one: the dwells of the recording are left out in turn (four folds, every fourth dwell), the model is fitted to the
// rest, and the error is the normalised prediction of the seconds left out.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/diagnosis/diagnosis.h"

namespace turncal {

EffectModel effect_model_of(const JointResult& result, double latitude_deg);

class HoldoutGate {
 public:
  // Fits a model with some static seconds left out, starting from another fit.
  using Refit =
      std::function<JointResult(const std::vector<EffectColumn>&, const JointResult& from, const std::vector<char>&)>;
  HoldoutGate(const CompressedRecording& recording, const CompressedRecording* holdout, Refit refit);
  std::string source() const { return holdout_ ? "second recording" : "dwells left out in turn"; }
  // With the noise of the result, or with a given one so that two models are measured with the same rule.
  HoldoutError error(const JointResult& result) const { return error(result, result.noise); }
  HoldoutError error(const JointResult& result, const NoiseModel& noise) const;

 private:
  const CompressedRecording& recording_;
  const CompressedRecording* holdout_;
  Refit refit_;
  std::vector<std::vector<char>> folds_;  // marks of blocks left out
};

}  // namespace turncal
