// Close the loop: find what the model lacks, name it where the data carry a name, add it, report the error before and after.
//
// 1. Noise and the 21 parameters are fitted (joint_estimate.h).
// 2. Every term that may be missing is weighed beside it, and the models of them are averaged (posterior.h).
// 3. Where names carry what is missing they are added, noise and parameters are fitted again, and everything is weighed again about that fit.
// 4. Verdict: `clean` where the probability that something is missing is below 0.95; `extended` where effects of the catalogue, or a class of
//    them that the recording cannot tell apart, carry it; else `unexplained`, and what is known is said as far as 95 % carry it.
//    `noise_model` where the innovations are not those of the noise: then nothing is claimed.
// 5. Parameters and sigmas are those of the average over models: a sigma holds what may be missing in proportion to its probability.
// 6. Held-out data are used for nothing but the error before and after, and to speak against a name.
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
  // Of the same single recording with the same `estimate`, where it has been fitted already: the base model is not fitted again.
  const JointResult* base = nullptr;
  std::vector<const CompressedRecording*> holdouts = {};
  double false_alarm = 0.005;  // family-wise, of the scores as they are shown
};

struct CandidateScore {  // of one component, beside the base model
  EffectColumn column;
  double value = 0.0;  // what it would come to if added alone
  double sigma = 0.0;
  double z = 0.0;           // value / sigma
  double detectable = 0.0;  // 5 sigma
  bool visible = true;      // false: this recording cannot see it
};

// One static second, for plots: what remains, and what it may depend on.
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
  // Of extended, by key, where it is another by more than its sigma: what a parameter is over the whole recording, for a unit that loads no
  // effects. Beside its effects it is what is left where they are zero: a bias without force beside K2, a scale factor that has settled.
  std::map<int, double> without_effects;
  Eigen::MatrixXd fitted_covariance;                        // of extended, before its sigmas were widened
  std::vector<std::string> effect_names;                    // added, strongest first
  std::map<std::string, std::vector<std::string>> aliases;  // of each added effect
  std::map<std::string, std::string> separate_by;           // what would tell the class apart
  std::vector<CandidateScore> candidates;                   // at the base model, best variant of each
  std::vector<std::string> undetectable;
  std::vector<std::string> gated_out;            // found, and held-out data speak against it
  std::string why_not_trusted = "not run";       // empty: what is missing is known, nothing speaks against the model
  Statements statements;                         // what is missing, with probabilities
  Omnibus omnibus;                               // of the final model
  std::string latitude;                          // that the gyros feel, where it is another (felt_latitude.h)
  std::string unexplained_pattern;               // what the unexplained residual looks like
  double error_before = 0.0, error_after = 0.0;  // rms normalised residual, both with the noise of the final model
  HoldoutError holdout_before, holdout_after;
  std::string holdout_source;  // HoldoutGate::source()
  // So many times as noisy at rest as the fitted recording is the noisiest holdout, and judged by its own noise; 1: by the fit's.
  double holdout_own_noise = 1.0;
  OfEachRecording each;  // of several recordings: what base and extended hold is common to them
  std::vector<ResidualPoint> residuals;

  bool trusted() const { return why_not_trusted.empty(); }
  // The base model has none of the effects that were found.
  std::string why_base_not_trusted() const {
    return verdict == Verdict::extended && trusted() ? reason : why_not_trusted;
  }
  void distrust(const std::string& why) {  // beside what is said already; empty: nothing
    if (!why.empty()) why_not_trusted += (trusted() ? "" : "; ") + why;
  }
};

// For both kinds of recordings (rest_diagnosis.h).
// Those that carry what is missing, with their time constants; empty: none do.
std::vector<EffectColumn> named_columns(const Evidence& evidence);
// Verdict, reason and pattern by what is said; `by_name`: names carry it.
void judge_by(const Statements& statements, bool by_name, Diagnosis& d);
// What was found: it is unexplained, and the base model is handed out.
void withdraw(const std::string& reason, Diagnosis& d);
// The scores of all effects beside the base model, by which d.candidates and d.undetectable are filled.
void list_candidates(const Evidence& of_base, double duration_s, Diagnosis& d);
// Of d.extended: the names of its effects, and what else each may be.
void list_names(const Evidence& evidence, Diagnosis& d);

// What a diagnosis leaves to a few formulas: the strongest effect that has others in its place, or, where no name carries what is said, the
// formulas of that branch, the most probable one first. None where it is clean, one name alone, or a test finds what no term explains.
struct Doubt {
  std::string name;
  std::vector<std::string> others;
};
std::optional<Doubt> doubt_of(const Diagnosis& diagnosis);
std::string words_of(const Doubt& doubt);  // "accel_second_order or accel_third_order"

// Of one unit: of one recording, or of several joined ones.
Diagnosis diagnose(const JoinedRecordings& recordings, const DiagnosisOptions& options = {});
Diagnosis diagnose(const CompressedRecording& recording, const DiagnosisOptions& options = {});

}  // namespace turncal
