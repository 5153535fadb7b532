// The error of a model on data that was not used to fit it: the gate of the diagnosis.
//
// A holdout recording: its own start is levelled and its first heading estimated by the filter; its six biases are its own (a
// unit switched off and on again has others), as are effects of the time since its beginning; the other parameters and effects
// are taken as they are. The error is the normalised innovation of every static second there.
// Of several fitted recordings each is left out in turn, and is a holdout for the fit of the others.
// Else the dwells of the recording are left out in turn (four folds, every fourth dwell), the model is fitted to the
// rest, and the error is the normalised prediction of the seconds left out.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"

namespace turncal {

// The plain velocity error is taken where it speaks of the model and not yet of the angle random walk, which turns into
// metres a second after minutes: in the first seconds of each dwell.
inline constexpr std::size_t velocity_seconds = 20;

// `more`: columns after them, at zero.
EffectModel effect_model_of(const JointResult& result, double latitude_deg, const std::vector<EffectColumn>& more = {});

// Random walk at rest of the gyros and of the accelerometers, in that of the fitted recording, where it is larger than the level of a
// holdout may be (GateLimits); else 1.
Eigen::Vector2d own_noise_of(const CompressedRecording& holdout, const JointResult& fit);

// `result` on a holdout: with its own biases, its own values of what goes with the time of one run, and its own `setup`: start, headings,
// faults, and its own noise where it has more than `noise`. A unit switched on again may have other biases by hundreds of deg/h, so
// biases and headings are found together, to where they move no more.
JointResult model_on_holdout(const CompressedRecording& holdout, const JointResult& result, const NoiseModel& noise);

// The normalised error on a holdout that neither noise nor the sigmas of the result explain: its parameters and effects give way by what their
// covariance, of result.free, allows.
double error_beyond_sigmas(const CompressedRecording& holdout, const JointResult& result, const NoiseModel& noise);

// What a model gains on held-out data over another, both with the same noise. With d the difference of their normalised innovations
// the gain is |d|^2 in the mean where the richer model is right and -|d|^2 where the other is, with standard error 2 |d|.
struct HoldoutGain {
  double gain = 0.0;
  double standard_error = 0.0;
  double expected = 0.0;
  // The error rises, and not by chance. (Of an effect that is there the gain is |d|^2 (2 v / v_fitted - 1): a value that is not well
  // known gains less than |d|^2, but no less than nothing.)
  bool contradicted(double standard_errors) const {
    return gain < 0.0 && gain < expected - standard_errors * standard_error;
  }
};
HoldoutGain holdout_gain(const HoldoutError& without, const HoldoutError& with);

class HoldoutGate {
 public:
  // A fit again from itself, with some static seconds left out.
  using Refit = std::function<JointResult(const JointResult& from, const std::vector<char>& unobserved)>;
  static HoldoutGate holdouts(const std::vector<const CompressedRecording*>& recordings);
  static HoldoutGate recordings_in_turn(const JoinedRecordings& recordings, Refit refit);
  static HoldoutGate dwells_in_turn(const CompressedRecording& recording, Refit refit);
  // "second recording", "3 other recordings", "cross-validation over recordings", "cross-validation over dwells"
  const std::string& source() const { return source_; }
  // With a noise that is given, so that two models are measured with the same rule.
  HoldoutError error(const JointResult& result, const NoiseModel& noise) const;

 private:
  struct Part {
    const CompressedRecording* recording;
    std::vector<char> left_out;  // marks of blocks left out of the fit; empty: it has no part in it
    int number = -1;             // of a recording left out of several
  };
  HoldoutGate(std::string source, Refit refit = {}) : source_(std::move(source)), refit_(std::move(refit)) {}

  std::string source_;
  std::vector<Part> parts_;
  Refit refit_;
};

}  // namespace turncal
