// The turns of a table, one axis at a time: what was commanded, and what the gyros add up to beyond what they read in the rest before.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "calib/statistics/compression.h"

namespace turncal {

struct TableTurn {
  std::size_t first = 0, end = 0;  // blocks
  double commanded_rad = 0.0;      // above zero
  Eigen::Vector3d felt =
      Eigen::Vector3d::Zero();  // by the nominal scale; the axis stands still in the unit, so the sums add up
  double felt_rad() const { return felt.norm(); }
};
// Of one axis by 20 deg and more, in the order in which they came.
std::vector<TableTurn> table_turns(const CompressedRecording& recording);
// What is felt over what was commanded, the median turn; NaN with fewer than three.
double felt_of_commanded(const CompressedRecording& recording);

}  // namespace turncal
