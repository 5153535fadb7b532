// A recording in fewer blocks, for passes that need not look at every second.
//
// Blocks merge exactly (merge() of compression.h), so what is lost is only where in a longer interval something happened.
// At rest the noise of the mean velocity over t seconds is that of the velocity random walk until about 20 s, from where the
// angle random walk outweighs it: seconds in the middle of a dwell say little one by one. Those beside a turn tell the
// velocity at its ends and stay as they are: the interval that begins s seconds after a turn, or ends s before the next,
// is at most max(1, s) long. In turns the formulas of block_motion.h hold up to about 0.1 rad a block; where they are steady the blocks
// are long as they come (compression.h), so what is merged here is what a turn does while it begins and ends.
//
// Nothing is merged across the border of a segment, a gap, a Break or a change of FilterSetup::unobserved.
#pragma once

#include "calib/joint/joint_filter.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct Coarseness {
  double rest_s = 8.0;    // longest interval at rest
  double turn_rad = 0.0;  // blocks of a turn together turn the unit by this much; 0: they stay as they are
};

// For scores of hundreds of columns, and of pieces of rest: seconds in the middle of a dwell go together. What is nominated is fitted on
// every second.
inline constexpr Coarseness coarseness_of_scores = {8.0, 0.0};

// `setup`: its breaks and unobserved blocks become those of the coarser recording.
CompressedRecording coarser(const CompressedRecording& recording, const Coarseness& coarseness, FilterSetup& setup);

}  // namespace turncal
