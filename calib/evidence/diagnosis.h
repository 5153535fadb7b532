// The diagnosis finds what the model lacks, names it where the data support a name, adds it, and reports the error before and after.
//
// 1. Noise and the 21 parameters are fitted (joint_estimate.h).
// 2. Every term that may be missing is scored beside them, and the models with such terms are averaged (posterior.h).
// 3. Where named effects account for what is missing, they are added, noise and parameters are fitted again, and all is scored about that fit.
// 4. Verdict: `clean` where the probability that something is missing is below 0.95; `extended` where effects of the catalogue, or a class of them
//    that the recording cannot separate, account for it; else `unexplained`, with what is known to 95 %. `noise_model` where the innovations
//    contradict the noise model: then nothing is claimed.
// 5. Parameters and sigmas are averages over the models: a sigma includes what may be missing, in proportion to its probability.
// 6. Held-out recordings count in the odds of the models, not in the values (evidence.h). Their error is reported, and can refute the model.
//
// Pure mathematics on compressed recordings. What no recording can show is listed in effects.h, unobservable_quantities().
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/evidence/omnibus.h"
#include "calib/evidence/statement.h"
#include "calib/joint/several_recordings.h"
#include "calib/model/limits.h"

namespace turncal {

struct Evidence;

enum class Verdict { clean, extended, unexplained, noise_model, not_tested };
const char* to_string(Verdict verdict);

struct DiagnosisOptions {
  JointOptions estimate;  // start, fixed noise, ... (effects and candidates are set here)
  // The fit of the base model, if this single recording was already fitted with the same `estimate`; it is not repeated.
  const JointResult* base = nullptr;
  std::vector<const CompressedRecording*> holdouts = {};
};
inline constexpr double score_false_alarm = 0.005;  // family-wise, of the scores as they are shown

struct CandidateScore {  // score of one component beside the base model
  EffectColumn column;
  double value = 0.0;  // its estimate if it alone were added
  double sigma = 0.0;
  double z = 0.0;           // value / sigma
  double detectable = 0.0;  // 5 sigma
  bool visible = true;      // false: not observable in this recording
};

// The residual of one static second and what it may depend on, for plots.
struct ResidualPoint {
  std::size_t block = 0;
  int segment = 0;
  double time_s = 0.0;
  Eigen::Vector3d normalised_before, normalised_after;
  Eigen::Vector3d velocity_before_mps, velocity_after_mps;  // navigated freely since the last rotation began, n frame
  Eigen::Vector3d f_b_mps2;
  double temperature_c = 0.0;
  double since_rotation_s = 0.0;
};

struct HoldoutError {
  double normalised_rms = 0.0;
  double velocity_rms_mps = 0.0;  // plain velocity error, see ResidualPoint
  double chi_square = 0.0;
  std::int64_t observations = 0;
  std::vector<Eigen::Vector3d> normalised = {};  // innovations, for the difference of two models; NaN: not counted
};

struct Diagnosis {
  Verdict verdict = Verdict::unexplained;
  std::string reason = "not run";
  JointResult base;      // before
  JointResult extended;  // after: base with the effects (a copy of base when there are none)
  // Parameters of `extended`, by column, whose value over the whole recording differs by more than their sigma: the values for a unit that
  // loads no effects. `extended` holds the values at zero effect: the bias at zero force beside K2, the scale factor once settled.
  std::map<int, double> without_effects;
  Eigen::MatrixXd fitted_covariance;                        // of `extended` as fitted, before the average over models
  std::vector<std::string> effect_names;                    // added, strongest first
  std::map<std::string, std::vector<std::string>> aliases;  // other formulas for each added effect
  std::map<std::string, std::string> separate_by;           // motions that would separate these formulas
  std::vector<CandidateScore> candidates;                   // at the base model, best variant of each
  std::vector<std::string> undetectable;
  std::vector<std::string> gated_out;       // found, then contradicted by held-out data
  std::string why_not_trusted = "not run";  // empty: the model is trusted
  Statements statements;                    // what is missing, with probabilities
  Omnibus omnibus;                          // of the final model
  std::string latitude;                     // the estimated one, if it contradicts the stated one (felt_latitude.h)
  std::string unexplained_pattern;          // what the unexplained residual looks like
  double error_before = 0.0, error_after = 0.0;  // rms normalised residual, both with the noise of the final model
  HoldoutError holdout_before, holdout_after;
  std::string holdout_source;  // HoldoutGate::source()
  // Noise at rest of the noisiest holdout, over that of the fitted recording; such a holdout is judged by its own noise. 1: by the fit's.
  double holdout_own_noise = 1.0;
  OfEachRecording each;  // of several recordings: what each has for itself; base and extended hold what is common
  std::vector<ResidualPoint> residuals;

  bool trusted() const { return why_not_trusted.empty(); }
  // Why the base model is not trusted: it lacks the effects that were found.
  std::string why_base_not_trusted() const {
    return verdict == Verdict::extended && trusted() ? reason : why_not_trusted;
  }
  void distrust(const std::string& why) {  // appends a reason; an empty one changes nothing
    if (!why.empty()) why_not_trusted += (trusted() ? "" : "; ") + why;
  }
};

// Shared with hand-turned data (rest_diagnosis.h).
// Returns the effects to be fitted, with their time constants: those said, or those that account for what is missing; empty: none.
std::vector<EffectColumn> named_columns(const Evidence& evidence);
// Sets verdict, reason and pattern from the statements; `by_name`: named effects account for what is missing.
void judge_by(const Statements& statements, bool by_name, Diagnosis& d);
// Withdraws what was found: the verdict is unexplained, and the base model is handed out.
void withdraw(const std::string& reason, Diagnosis& d);
// Fills d.candidates and d.undetectable from the scores of all effects beside the base model.
void list_candidates(const Evidence& of_base, double duration_s, Diagnosis& d);
// Lists the effects of d.extended and what else each may be.
void list_names(const Evidence& evidence, Diagnosis& d);

// The formulas between which a diagnosis does not decide: the strongest effect with its aliases, or, for an unexplained branch,
// its formulas, most probable first. None if the verdict is clean, one name stands alone, or an omnibus test failed.
struct Doubt {
  std::string name;
  std::vector<std::string> others;
};
std::optional<Doubt> doubt_of(const Diagnosis& diagnosis);
std::string words_of(const Doubt& doubt);  // "accel_second_order or accel_third_order"

// Diagnoses one unit from one recording, or from several joined ones.
Diagnosis diagnose(const JoinedRecordings& recordings, const DiagnosisOptions& options = {});
Diagnosis diagnose(const CompressedRecording& recording, const DiagnosisOptions& options = {});

}  // namespace turncal
