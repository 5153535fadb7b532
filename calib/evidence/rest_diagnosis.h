// Diagnosis of hand-turned data: the course and the verdicts of diagnosis.h, on the observations of rests and turns.
//
// Effects that rests cannot show are listed, not weighed: those with no trace at rest or in gravity's direction after a turn (size effect,
// delay), those that need the heading (magnetic, earth rate), and those that no sensor has as large as they would have to be (absurd_magnitude).
// Where too little is left over after the base fit nothing is weighed, since a residual of so few numbers fits any name: fewer than
// least_redundancy observations, parameters that are not determined, or a fit that depends on individual rests (few distinct poses,
// however often they are taken), so that what is left out is predicted far worse than fitted. Gravity's norm is the accelerometers' alone: where
// only it depends on individual rests, effects of the gyros are weighed, and none of the accelerometers. Units that are plainly
// wrong (rest_units.h) are not fitted at all. Where a kind of observation stays above most_over_white, nothing is trusted.
//
// What a fit leaves to be explained (evidence.h) comes from the observations of rests and turns (rest_system.h). Cells are the first second
// of a rest, its middle and its last second, and parts of the turn before it. A unit of a reading in a cell changes the observations by a
// column of the rest model's own Jacobian; coordinates are the observations over their sigmas. What is another value in every rest is the
// floor of a kind (rest_model.h) and no term. A missing effect raises the floors it touches, so models are weighed with those of the 21
// parameters alone, and with those that the most probable model leaves.
//
// Verdict: not_tested when nothing was, or when the gyros' part is clean and the accelerometers were not tested.
#pragma once

#include <string>

#include "calib/evidence/diagnosis.h"
#include "calib/rests/rest_model.h"

namespace turncal {

struct RestDiagnosis {
  // A JointResult has of a fit of rests what both have. Errors on held-out data are those of all observations, normalised.
  Diagnosis diagnosis;
  RestFit base;
  RestFit final;                 // equal to base when nothing was added, but for parameters and sigmas
  std::string not_tested;        // why nothing was weighed; empty: it was
  std::string accel_not_tested;  // why nothing of the accelerometers was; empty: it was, or nothing was
  bool second_recording = false;
  RestErrors held_out_before, held_out_after;  // on the second recording; without one left out in turn
};

// A fit of rests with these effects.
JointResult as_joint(const RestFit& fit, const std::vector<EstimatedEffect>& effects, const RestData& data);

RestSystem rest_system_at(const RestData& data, const JointResult& model, bool with_columns = false);

// Why a fit cannot be judged: nothing beyond it is left, or it depends on individual rests. Empty: it can.
std::string why_not_tested(const RestData& data, const RestFit& base);

// `holdout`: a second recording of the unit, not used in the fit; null: none.
Result<RestDiagnosis> diagnose_rests(const RestData& data, const RestData* holdout = nullptr);

}  // namespace turncal
