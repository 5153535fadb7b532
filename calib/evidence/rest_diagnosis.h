// Diagnosis of hand-turned data: the steps and verdicts of diagnosis.h, on the observations of rests and turns.
//
// Effects that rests cannot show are listed, not scored: those without a trace at rest or in gravity's direction after a turn (size effect,
// delay), those that need the heading (magnetic, north component of the Earth's rate), and those that would have to be larger than in any
// sensor (absurd_magnitude). With too little redundancy nothing is scored, since so few residuals fit any name: fewer than least_redundancy
// observations beyond the parameters, parameters that are not determined, or a fit that depends on individual rests, so that left-out
// observations are predicted far worse than fitted ones (few distinct poses, however often taken). Gravity's norm depends on the
// accelerometers alone: where only the norm depends on individual rests, gyro effects are scored and accelerometer effects are not. Units
// that are plainly wrong (rest_units.h) are not fitted at all. If a kind of observation stays above most_over_white, nothing is trusted.
//
// The evidence (evidence.h) comes from the observations of rests and turns (rest_system.h). Cells are the first second of a rest, its
// middle and its last second, and the parts of the turn before it. The derivatives of the observations by a reading in a cell are a column
// of the rest model's own Jacobian; the coordinates are the observations over their sigmas. An independent value in every rest is the floor
// of a kind (rest_model.h), not a term. A missing effect raises the floors it touches, so models are scored with the floors of the 21
// parameters alone, and with those that the most probable model leaves.
//
// Verdict: not_tested if nothing was scored, or if the gyros' part is clean and the accelerometers were not tested.
#pragma once

#include <string>

#include "calib/evidence/diagnosis.h"
#include "calib/rests/rest_model.h"

namespace turncal {

struct RestDiagnosis {
  // Of a fit of rests, a JointResult holds the fields that both kinds share. Held-out errors are those of all observations, normalised.
  Diagnosis diagnosis;
  RestFit base;
  RestFit final;                 // equal to base when nothing was added, except parameters and sigmas
  std::string not_tested;        // why nothing was scored; empty: it was
  std::string accel_not_tested;  // the same of the accelerometers alone; empty: they were, or nothing was
  bool second_recording = false;
  RestErrors held_out_before, held_out_after;  // on the second recording; without one: cross-validated
};

// Returns a fit of rests with these effects as a JointResult.
JointResult as_joint(const RestFit& fit, const std::vector<EstimatedEffect>& effects, const RestData& data);

RestSystem rest_system_at(const RestData& data, const JointResult& model, bool with_columns = false);

// Returns why a fit cannot be tested: it has too little redundancy, or it depends on individual rests. Empty: it can.
std::string why_not_tested(const RestData& data, const RestFit& base);

// `holdout`: a second recording of the unit, not used in the fit; null: none.
Result<RestDiagnosis> diagnose_rests(const RestData& data, const RestData* holdout = nullptr);

}  // namespace turncal
