// Does the last dwell of a recording, or the turn before it, disagree with all the others? Of one that was repeated in its pose the last
// take is looked at, and the others of that pose are not what it is compared with.
//
// The noise of a fit does not answer that: one rest with a bias of its own makes the fitted bias instability large, and then nothing is
// out of place. Here the noise is white, as the fit has it, and what the other rests scatter more than it is taken for theirs all:
//   chi2 of the last / max(1, chi2 of the others / their degrees)
// for a bias within the rest and for a jump at the turn before it, the parameters of the fit eliminated (piece_system.h).
// An effect that every rest shows is so no reason; nor is bias instability that they all have.
#pragma once

#include "calib/joint/joint_estimate.h"

namespace turncal {

// Of a rest that is compared with all the others, in runs of some hundred of them: one clean run in ten thousand has such a one.
struct LastRestLimits {
  double probability = 1e-6;
  int fewest = 8;  // turns before it
};
inline constexpr LastRestLimits last_rest_limits;

// With fewer turns than LastRestLimits::fewest there is nothing to compare with, and the answer is no.
bool last_rest_disagrees(const CompressedRecording& recording, const JointResult& fit);

}  // namespace turncal
