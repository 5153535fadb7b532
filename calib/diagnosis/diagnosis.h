// Close the loop: find the residual, trace it to an effect the model lacks, add it, report the error before and after.
//
// 1. Fit noise and base model (joint_estimate.h) with every catalogue component as a candidate column of the last pass.
// 2. Score each candidate after the base is eliminated (score_algebra.h): z = s / sqrt(Q). Nominate the best; accept it when
//    the likelihood, with parameters and noise fitted again, gains more than a family-wise threshold over all candidates
//    (Bonferroni, 0.5 % a stage). Likelihood and not the score alone, because a missing effect first hides in the fitted noise.
//    Effects with a free time constant pay for it (BIC, ln n). Repeat until nothing is accepted: forward selection.
//    Where bias instability matters, the gain must also hold beside a slower one (flicker noise wanders on every scale).
// 3. Beside the catalogue stand patterns without a physical name (unexplained.h: bias steps, periodic ones, table angle,
//    approach direction). Where such a pattern explains the residual better (one with angle or direction: by more than 10),
//    no name is given: unexplained.
// 4. Gate: an effect stays only if it lowers the error of data that was not used to fit it by more than the standard error of
//    that gain: holdout recordings (each with biases of its own), of several fitted recordings each left out in turn, else, or where these
//    cannot decide, dwells left out in turn. Where the chosen member of an alias class does not, the others of the class are tried: held-out data
//    decide between names that the fitted data cannot tell apart.
// 5. Names against what has none (name_check.h): an effect must be better than every family of nameless_families.h.
// 6. Aliases: effects within 10 of the best when it was chosen, or whose columns explain the chosen one's to more than 0.97.
// 7. The lack-of-fit tests (lack_of_fit.h) on what has come out. Where they fire, or where an effect was found and not confirmed, the
//    verdict is unexplained: names become candidates, sigmas are widened by what the residual may have moved, trusted is false.
//    In a trusted model every sigma includes the spread over the alias class, and what came near to being claimed.
//
// Pure mathematics on compressed recordings. Sources: Cox and Hinkley, Theoretical Statistics (score tests); Schwarz (1978)
// BIC; de Jong (1991) for the columns. What no recording can show is listed in effects.h, unobservable_quantities().
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/joint/several_recordings.h"
#include "calib/model/limits.h"

namespace turncal {

enum class Verdict { clean, extended, unexplained, noise_model, not_tested };
const char* to_string(Verdict verdict);

struct DiagnosisOptions {
  JointOptions estimate;  // start, fixed noise, ... (effects and candidates are set here)
  // Of the same single recording with the same `estimate`, where it has been fitted already: the base model is not fitted again.
  const JointResult* base = nullptr;
  std::vector<const CompressedRecording*> holdouts = {};
  double false_alarm = 0.005;  // family-wise, a stage
  int max_components = 12;
  DiagnosisLimits limits;
};

struct CandidateScore {  // of one component, beside the base model
  EffectColumn column;
  double value = 0.0;  // what it would come to if added alone
  double sigma = 0.0;
  double z = 0.0;           // value / sigma
  double detectable = 0.0;  // 5 sigma
  bool visible = true;      // false: this recording cannot see it
};

struct GroupScore {  // of one effect with all its components (best time constant)
  std::string name;
  double chi_square = 0.0;  // s' Q^-1 s on the visible directions
  int rank = 0;
  int components = 0;
  double p_value = 1.0;  // single test
};

struct SelectionStage {
  EffectColumn chosen;
  double z = 0.0;     // score when nominated
  double gain = 0.0;  // 2 (log L after - before), noise fitted in both
  double threshold = 0.0;
  bool accepted = false;
  std::string note;
  std::vector<std::pair<std::string, double>> rivals;  // other effects' best z^2 at this stage, within 10 of the chosen
  std::vector<EffectColumn> rival_columns;             // the components that made them so
  std::vector<EffectColumn> alias_columns;             // the best component of each effect of the alias class
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

// One test of lack of fit, see lack_of_fit.h.
struct LackOfFitTest {
  std::string family;  // "turn, worst"
  std::string what;    // "jump at the turn that ends at 1234 s (step 4)"
  double chi_square = 0.0;
  double degrees = 0.0;
  double tries = 1.0;      // of which this is the worst
  double inflation = 1.0;  // LackOfFitLimits
  double log10_p = 0.0;    // of chi_square / inflation, times tries
  Eigen::VectorXd shift;   // what explaining it away does to the free parameters and effects (empty: not known)
};
struct LackOfFit {
  bool passed = true;
  std::vector<LackOfFitTest> tests;
  LackOfFitTest worst;
  double log10_limit = 0.0;
  // Of the innovations on body axes, seconds in which pulses beat set aside: the largest correlation over 1 to 5 s, and the mean square;
  // negative: too few to say. And the part that was set aside.
  double innovation_correlation = -1.0, innovation_level = -1.0, beating_part = 0.0;
  std::vector<Eigen::VectorXd>
      unseen;  // what no test shows may move the free parameters and effects by (nameless_families.h)
};

// A name against what has none, see name_check.h.
struct NameCheck {
  std::string name;
  double gain = 0.0;   // 2 ln L with the effect
  std::string family;  // the best one
  double family_gain = 0.0;
};

struct Diagnosis {
  Verdict verdict = Verdict::unexplained;
  std::string reason = "not run";
  JointResult base;                       // before
  JointResult extended;                   // after: base with the effects (a copy of base when there are none)
  Eigen::MatrixXd fitted_covariance;      // of extended, before its sigmas were widened
  std::vector<std::string> effect_names;  // added, strongest first
  std::map<std::string, std::vector<std::string>> aliases;  // of each added effect
  std::map<std::string, std::string> separate_by;           // what would tell the class apart
  std::vector<CandidateScore> candidates;                   // at the base model, best variant of each
  std::vector<GroupScore> groups;
  std::vector<std::string> undetectable;
  std::vector<SelectionStage> stages;
  std::vector<std::string> gated_out;  // found but not confirmed on held-out data
  std::vector<NameCheck> name_checks;
  std::vector<std::string> rivalled;             // confirmed, but a family without a name explains the data as well
  std::vector<std::string> candidate_names;      // beside `unexplained`: what was found, but does not explain the data
  bool trusted = false;                          // every parameter is within its sigma, as far as the tests can tell
  std::vector<std::string> moved;                // parameters that the unexplained may have moved by more than a sigma
  LackOfFit lack_of_fit;                         // of the final model
  std::string unexplained_pattern;               // what the unexplained residual looks like
  double error_before = 0.0, error_after = 0.0;  // rms normalised residual, both with the noise of the final model
  HoldoutError holdout_before, holdout_after;
  std::string holdout_source;  // HoldoutGate::source()
  // So many times as noisy at rest as the fitted recording is the noisiest holdout, and judged by its own noise; 1: by the fit's.
  double holdout_own_noise = 1.0;
  OfEachRecording each;  // of several recordings: what base and extended hold is common to them
  std::vector<ResidualPoint> residuals;
};

// Of one unit: of one recording, or of several joined ones.
Diagnosis diagnose(const JoinedRecordings& recordings, const DiagnosisOptions& options = {});
Diagnosis diagnose(const CompressedRecording& recording, const DiagnosisOptions& options = {});

}  // namespace turncal
