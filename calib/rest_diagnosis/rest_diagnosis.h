// Finds the effect that a calibration with unknown angles leaves unexplained, adds it, and shows the error before and
// after.
//
// Forward selection, one component at a time, among all components of the catalogue that the recording can show:
//   1. At the present model all candidate columns are projected off the columns in the model (weights: rest_model.h).
//   For each,
//      the residual with it is known at once. Its statistic is the gain in the profile likelihood when every kind of
//      observation has a variance of its own (rest_selection.h), its p from an F distribution. The score of a whole
//      effect is s' Q^-1 s ~ chi^2(rank), Q the information left after the base is eliminated.
//   2. The best effect is declared when p of its best component or of its group is below alpha over the number of
//      tests (Bonferroni, family-wise); its further components follow by BIC. A time constant costs one parameter more.
//      When a triad is known to change with time, any other effect must pass with its slow changes of any shape taken
//      off.
//   3. The gate: an effect stays only when it lowers the error on rests and rotations left out in turn, and, where there
//      is one, on a second recording of the unit.
// An effect of time or temperature that was found on one triad is looked for on the other without paying for the whole
// catalogue again. A component that a later one makes superfluous is taken out (BIC), and at the end every one that is not clear; what it would do to the parameters is in
// their sigmas. What comes within `alias_margin`
// of the best and is explained by it is named as its alias; of what the data hardly tell apart (correlation above 0.9)
// the effect with the fewest components goes into the model.
//
//   4. Names stay only where nothing without a name explains the rests as well, where with them the kinds of observation they live in
//      come down to the white noise, and where no such family explains what is left (rest_name_check.h). Else the verdict is
//      unexplained, the names are candidates, and the base model is handed out with sigmas that hold what they would have moved.
// Effects that rests cannot show are named, not tested: those with no trace at rest or in gravity's direction after a
// rotation (size effect, delay), and those that need the heading (magnetic, earth rate). So are those that would have to
// be larger than any sensor has them to be caught (absurd_magnitude); what comes to such a value is struck out again.
// Where too little is left over after the base fit nothing is tested, since a residual of so few numbers fits any name:
// fewer than least_redundancy observations, parameters that are not determined themselves, or a fit that hangs on single
// rests (few distinct poses, however often they are taken), so that what is left out is predicted far worse than fitted.
// The triads are judged apart: gravity's norm is the accelerometers' alone. Where only it hangs on single rests, effects of the
// gyros are looked for, and none of the accelerometers. Units that are plainly wrong (rest_units.h) are not fitted at all.
//
// Verdict: not_tested when nothing was, or when the gyros' part is clean and the accelerometers were not tested.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/model/effects.h"
#include "calib/model/limits.h"
#include "calib/rests/rest_model.h"

namespace turncal {

struct RestDiagnosisOptions {
  double false_alarm = 0.01;  // family-wise, for the first component
  double alias_margin = 10.0;
  int max_components = 18;
  double gate_gain = 0.02;         // the left-out error must fall by this part of itself
  double unexplained_ratio = 3.0;  // residual over white noise above which "clean" is not said
  // A name is judged in the kinds of observation that hold this share of its columns and more; with it they must come below
  // unexplained_ratio, too.
  double lives_in = 0.25;
  double clear = rest_limits.clear;   // sigma, of a component
  double least_redundancy = 20.0;     // observations beyond the 21 parameters
  double most_leverage = 5.0;         // left-out error over fitted error, kind by kind
  const RestData* holdout = nullptr;  // a second recording of the unit, not used in the fit
};

struct RestCandidate {
  std::string effect;
  double tau_s = 0.0;  // best variant; 0: none
  int rank = 0;
  double score = 0.0;    // chi^2 of the group against the base model
  double p_value = 1.0;  // of the group or of the best component, times the number of tests
  std::string best_component;
  double best_statistic = 0.0;
  std::vector<std::string> components;
  std::vector<double> values;      // each would come to alone, effect units, component by component
  std::vector<double> sigmas;      // of them
  std::vector<double> detectable;  // 5 sigma; infinity: not visible
  std::string remark;              // why not tested, or why struck out
};

struct RestStage {  // one step of the selection
  EffectColumn column;
  double gain = 0.0;     // T
  double p_value = 1.0;  // of the component alone, times the number of tests
  bool accepted = false;
  std::string note;
};

// The error of a model on a second recording.
struct RestHoldout {
  RestErrors errors;            // plain
  double normalised_rms = 0.0;  // over the sigmas of the final model
  double chi_square = 0.0;
  int observations = 0;
};

struct RestEffect {
  EffectColumn column;
  double value = 0.0;
  double sigma = 0.0;
};

struct RestDiagnosis {
  Verdict verdict = Verdict::not_tested;
  RestFit base;
  RestFit final;                                                          // equal to base when nothing was added
  std::vector<RestCandidate> candidates;                                  // highest score first
  std::vector<RestEffect> effects;                                        // chosen, in the order found
  std::vector<std::pair<std::string, std::vector<std::string>>> aliases;  // of each chosen effect
  std::vector<RestStage> stages;
  std::vector<std::string> struck_out;  // declared, but the left-out error did not fall, or absurdly large: key: why
  std::string not_tested;               // why no effect was tested at all; empty: they were
  std::string accel_not_tested;         // why none of the accelerometers was; empty: they were, or nothing was
  std::string
      unexplained;  // why the data are not explained: what is left, or why the names do not stand; empty: they are
  std::vector<std::string> candidate_names;  // beside it: what was found
  bool trusted = true;                       // every parameter is within its sigma, as far as this recording can tell
  std::vector<std::string> remainder;        // what stays above the white noise, in words
  double error_before = 0.0;                 // rms of residuals over the final model's sigmas, fitted data
  double error_after = 0.0;
  double left_out_before = 0.0;  // the same, left out in turn
  double left_out_after = 0.0;
  RestHoldout holdout_before, holdout_after;  // of options.holdout; observations = 0 without one
};

// The observations of `data` at a fit and its effects (those of RestDiagnosis::effects; none for the base).
RestSystem rest_system_at(const RestData& data, const RestFit& fit, const std::vector<RestEffect>& effects,
                          double reference_temperature_c);
// What temperature effects are referred to: the mean of the recording, 0 without a thermometer.
double rest_reference_temperature_c(const RestData& data);

// Why a fit cannot be judged: nothing beyond it is left, or it hangs on single rests. Empty: it can.
std::string why_not_tested(const RestData& data, const RestFit& base, const RestDiagnosisOptions& options = {});

Result<RestDiagnosis> diagnose_rests(const RestData& data, const RestDiagnosisOptions& options = {});

}  // namespace turncal
