// Does the model explain the data? An omnibus of lack-of-fit tests (lack_of_fit_tests.h): none of them asks for a particular effect, all
// have a known distribution where the model is right, since the model's parameters are eliminated. It fires when any of them has a
// probability below its share of `LackOfFitLimits::family_wise`.
#pragma once

#include <vector>

#include "calib/diagnosis/diagnosis.h"

namespace turncal {

// Of the estimate `fit` (its noise, parameters and effects) on `recording`.
LackOfFit test_lack_of_fit(const CompressedRecording& recording, const JointResult& fit,
                           const std::vector<const CompressedRecording*>& holdouts, const LackOfFitLimits& limits);

// One filter pass at a finished fit, with what tests on its pieces of rest need. Seconds in the middle of a dwell go together
// (coarser_recording.h): pieces are 25 s and longer.
struct FitPass {
  CompressedRecording recording;  // of which the steps are
  FilterResult filter;            // with steps
  std::vector<int> columns;       // of the free parameters and the effects in it
};
FitPass run_fit_pass(const CompressedRecording& recording, const JointResult& fit, const FilterSetup& setup);

}  // namespace turncal
