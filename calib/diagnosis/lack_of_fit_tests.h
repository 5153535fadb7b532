// The tests of the omnibus, by what they look at. Each judges what it finds and adds it.
#pragma once

#include <string>

#include "calib/diagnosis/lack_of_fit.h"
#include "calib/diagnosis/segment_scores.h"

namespace turncal {

void add_test(LackOfFitTest test, LackOfFit& result);

// piece_tests.cpp, what each piece of rest and each turn says against the model (segment_scores.h)
//   turn        the jump of attitude and velocity at each turn against the noise at rest (chi2, 6 a turn): the worst turn, and all
//   rest        a bias within each piece of rest (chi2, 6 a piece): the worst piece, and all; so replicated positions are tested
//               against each other, too
// `where`: before the names of the tests.
void test_pieces(const SegmentScores& scores, const CompressedRecording& recording, const std::string& where,
                 const LackOfFitLimits& limits, LackOfFit& result);
//   orientation biases that go with the direction of gravity (polynomials to the third order) and of north
//   time        biases, accelerometer and gyro scale factors that go with time (cosines over the run)
//   after turns biases in the first seconds of each dwell, plain and with the specific force
//   temperature biases that go with the temperature and its square
void test_contrasts(const SegmentScores& scores, const LackOfFitLimits& limits, LackOfFit& result);
//   angle, scatter, walk, temperature, rate   the families without a name (nameless_families.h)
void test_families(const SegmentScores& scores, LackOfFit& result);

// agreement_tests.cpp, do recordings speak of the same unit? Those fitted together, as in several_recordings.h; `ranges`: of the fit's
// parameters and effects. And a holdout with the fit as a prior: its turns and rests, its parameters, its level; `of_fit`: the fit's pass.
void test_recordings(const FitPass& pass, const Eigen::VectorXd& ranges, LackOfFit& result);
void test_holdout(const CompressedRecording& holdout, const std::string& name, const JointResult& fit,
                  const NoiseModel& noise, const FitPass& of_fit, const LackOfFitLimits& limits, LackOfFit& result);

}  // namespace turncal
