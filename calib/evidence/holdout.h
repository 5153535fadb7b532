// The error of a model on data that was not used to fit it: the gate of the diagnosis.
//
// On a holdout recording the start is levelled and the first heading estimated by the filter. Its six biases are its
// own, since a unit switched off and on again has others; so are effects of the time since its beginning. All other
// parameters and effects are those of the model. The error is the normalised innovation of every static second. Without
// a holdout, several fitted recordings are left out in turn, each a holdout for the fit of the others. A single
// recording is cross-validated over its dwells (four folds, every fourth dwell): the error is the normalised prediction
// of the seconds left out.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"

namespace turncal {

// The velocity error is taken over the first seconds of each dwell: later the angle random walk, which grows to metres
// a second within minutes, hides the model error.
inline constexpr std::size_t velocity_seconds = 20;

// Returns the effects of `result` at their values; `more`: further columns, at zero.
EffectModel effect_model_of(const JointResult& result, double latitude_deg, const std::vector<EffectColumn>& more = {});

// Returns the noise at rest of the gyros and of the accelerometers over that of the fitted recording, if the ratio
// exceeds the highest error of a holdout (GateLimits); else 1.
Eigen::Vector2d own_noise_of(const CompressedRecording& holdout, const JointResult& fit);

// Returns `result` adapted to a holdout: its own biases, effects of one run and `setup` (start, headings, faults), and
// its own noise where that exceeds `noise`. Biases of a unit switched on again may differ by hundreds of deg/h, so
// biases and headings are iterated together until they settle.
JointResult model_on_holdout(const CompressedRecording& holdout, const JointResult& result, const NoiseModel& noise);

// Returns the normalised error on a holdout that neither noise nor the sigmas of the result explain: its parameters and
// effects may move within their covariance (rows: result.free).
double error_beyond_sigmas(const CompressedRecording& holdout, const JointResult& result, const NoiseModel& noise);

// The gain of one model over another on held-out data, both with the same noise. With d the difference of their normalised
// innovations, the expected gain is |d|^2 if the richer model is right and -|d|^2 if the other is, with standard error 2 |d|.
struct HoldoutGain {
  double gain = 0.0;
  double standard_error = 0.0;
  double expected = 0.0;
  // The error rises by more than chance allows. (A real effect gains |d|^2 (2 v / v_fitted - 1): one with a poorly
  // known value gains less than |d|^2, but not less than zero.)
  bool contradicted(double standard_errors) const {
    return gain < 0.0 && gain < expected - standard_errors * standard_error;
  }
};
HoldoutGain holdout_gain(const HoldoutError& without, const HoldoutError& with);

class HoldoutGate {
 public:
  // Refits `from` with some static seconds left out.
  using Refit = std::function<JointResult(const JointResult& from, const std::vector<char>& unobserved)>;
  static HoldoutGate holdouts(const std::vector<const CompressedRecording*>& recordings);
  static HoldoutGate recordings_in_turn(const JoinedRecordings& recordings, Refit refit);
  static HoldoutGate dwells_in_turn(const CompressedRecording& recording, Refit refit);
  // "second recording", "3 other recordings", "cross-validation over recordings", "cross-validation over dwells"
  const std::string& source() const { return source_; }
  // Returns the error under a given noise, so that two models are measured by the same rule.
  HoldoutError error(const JointResult& result, const NoiseModel& noise) const;

 private:
  struct Part {
    const CompressedRecording* recording;
    std::vector<char> left_out;  // marks of blocks left out of the fit; empty: none of it was fitted
    int number = -1;             // which of several recordings is left out
  };
  HoldoutGate(std::string source, Refit refit = {}) : source_(std::move(source)), refit_(std::move(refit)) {}

  std::string source_;
  std::vector<Part> parts_;
  Refit refit_;
};

}  // namespace turncal
