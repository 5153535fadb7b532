// One filter pass at a finished fit, with what the tests on its pieces of rest need. Seconds in the middle of a dwell go together
// (coarser_recording.h): pieces are 25 s and longer.
#pragma once

#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

struct FitPass {
  CompressedRecording recording;  // of which the steps are
  FilterResult filter;            // with steps
  std::vector<int> columns;       // of the free parameters and the effects in it
};
FitPass run_fit_pass(const CompressedRecording& recording, const JointResult& fit, const FilterSetup& setup);

}  // namespace turncal
