// Units that are plainly wrong: a factor that no sensor's scale is off by, and that two units differ by. And gyros that are connected
// otherwise: what carries one direction of gravity into the next is not their rate but that of another axis, or the reverse.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/statistics/compression.h"

namespace turncal {

// The turns of a table, one axis at a time: what was commanded, and what the gyros add up to beyond what they read in the rest before.
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

struct UnitSlip {
  double factor;      // what is read over what is true
  const char* words;  // "as if they were in deg/s, not rad/s"
};
std::span<const UnitSlip> accel_slips();
std::span<const UnitSlip> gyro_slips();
inline constexpr double slip_nearness = 0.12;   // of the factor: raw sensors are off by less
inline constexpr double roughest_scale = 0.28;  // a rough sensor's scale factor is off by a quarter, no more
// Empty: none is near.
const UnitSlip* slip_near(std::span<const UnitSlip> slips, double ratio);

// Of gravity at rest over that of the site, by the nominal scale. Empty: it may be the scale factor's error.
std::string wrong_gravity(double ratio, const RecordingInfo& info);

// Of a recording with table angles: gravity at rest, by the median second, and, in physical units, what the gyros
// add up to in the table's turns, by the median turn. One sentence; empty: nothing is plainly wrong.
std::string wrong_table_units(const CompressedRecording& recording);

// Of rate = n * reading, n over the nominal scale: which gyro reads which axis, where that is not its own; empty: each its own.
std::string wrong_axes(const Eigen::Matrix3d& n);
// The same of a recording with table angles, by its turns.
std::string wrong_table_axes(const CompressedRecording& recording, const Eigen::Matrix3d& mounting);

}  // namespace turncal
