// Does the model explain the data? An omnibus of lack-of-fit tests on the pieces of rest (segment_scores.h): none of them asks for
// a particular effect, all have a known distribution where the model is right, since the model's parameters are eliminated.
//
//   turn        the jump of attitude and velocity at each turn against the noise at rest (chi2, 6 a turn): the worst turn, and all
//   rest        a bias within each piece of rest (chi2, 6 a piece): the worst piece, and all; so replicated positions are tested
//               against each other, too
//   orientation biases that go with the direction of gravity (polynomials to the third order) and of north
//   time        biases, accelerometer and gyro scale factors that go with time (cosines over the run)
//   after turns biases in the first seconds of each dwell, plain and with the specific force
//   temperature biases that go with the temperature and its square
//   angle, scatter, walk, temperature   the families without a name (nameless_families.h): biases and scale factors with the angles of
//               the table, from turn to turn, wandering, with temperature
//   innovations their correlation from second to second
//   recordings  of several fitted together: parameters of their own for each
//   holdout     rest and turns of the holdout, with the fit's covariance as a prior and biases of its own; its level
// The omnibus fires when any of them has a probability below its share of `LackOfFitLimits::family_wise`.
// Limits beyond the plain chi2 ones, and what they were calibrated on: LackOfFitLimits.
#pragma once

#include <string>
#include <vector>

#include "calib/diagnosis/diagnosis.h"

namespace turncal {

// Of the estimate `fit` (its noise, parameters and effects) on `recording`.
LackOfFit test_lack_of_fit(const CompressedRecording& recording, const JointResult& fit,
                           const std::vector<const CompressedRecording*>& holdouts, const LackOfFitLimits& limits);

}  // namespace turncal
