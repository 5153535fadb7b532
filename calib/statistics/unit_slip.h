// Units that are plainly wrong: a factor that no sensor's scale is off by, and that two units differ by. And gyros that are connected
// otherwise: what carries one direction of gravity into the next is not their rate but that of another axis, or the reverse.
#pragma once

#include <functional>
#include <optional>
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
inline constexpr double roughest_motion = 0.5;  // of the factor of gyro_map()
// Empty: none is near.
const UnitSlip* slip_near(std::span<const UnitSlip> slips, double ratio);

// Of gravity at rest over that of the site, by the nominal scale. Empty: it may be the scale factor's error.
std::string wrong_gravity(double ratio, const RecordingInfo& info);
// The same by the median second at rest; of a unit that never rests by the median block.
std::string wrong_accelerometers(const CompressedRecording& recording);

// Of a recording with table angles: gravity at rest, by the median second, and, in physical units, what the gyros
// add up to in the table's turns, by the median turn. One sentence; empty: nothing is plainly wrong.
std::string wrong_table_units(const CompressedRecording& recording);

// The rate is factor * axes * reading.
struct GyroMap {
  Eigen::Matrix3d axes;  // signed_axes()
  double factor;
};
// Of rows that lie behind each other: what they add up to.
struct MotionSums {
  double duration_s = 0.0;
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero(), accel = Eigen::Vector3d::Zero();
};
// What gravity's direction u in the body frame says of the gyros, whatever their unit: while the unit accelerates little, du/dt = -w x u. From
// a tenth of a second to the next, or two or four, the change of u is regressed on what the gyros add up to, for each of the 48 ways to connect
// them; others than the gyros' own have to leave less than half of what these do. Empty: the unit turns too little.
std::optional<GyroMap> gyro_map(std::size_t rows, const std::function<MotionSums(std::size_t)>& row);

// Of rate = n * reading, n over the nominal scale: which gyro reads which axis, where that is not its own; empty: each its own.
std::string wrong_axes(const Eigen::Matrix3d& n);
// The same of a recording with table angles, by its turns.
std::string wrong_table_axes(const CompressedRecording& recording, const Eigen::Matrix3d& mounting);

}  // namespace turncal
