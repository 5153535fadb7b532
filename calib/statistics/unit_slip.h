// Units that are plainly wrong: a factor larger than any sensor's scale error, by which two units differ. Also gyros connected to
// other axes: the rate that carries one direction of gravity into the next is that of another axis, or its reverse.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/statistics/compression.h"

namespace turncal {

// One turn of a table about one axis: the commanded angle, and the sum of the gyros beyond their reading in the rest before.
struct TableTurn {
  std::size_t first = 0, end = 0;  // blocks
  double commanded_rad = 0.0;      // above zero
  Eigen::Vector3d felt =
      Eigen::Vector3d::Zero();  // by the nominal scale; the axis is fixed in the unit, so the sums add up
  double felt_rad() const { return felt.norm(); }
};
// Returns the turns about one axis by 20 deg and more, in order.
std::vector<TableTurn> table_turns(const CompressedRecording& recording);
// Returns the measured over the commanded angle, of the median turn; NaN with fewer than three.
double felt_of_commanded(const CompressedRecording& recording);

struct UnitSlip {
  double factor;      // reading over true value
  const char* words;  // "as if they were in deg/s, not rad/s"
};
std::span<const UnitSlip> accel_slips();
std::span<const UnitSlip> gyro_slips();
inline constexpr double slip_nearness = 0.12;   // of the factor: raw sensors are off by less
inline constexpr double roughest_scale = 0.28;  // a rough sensor's scale factor is off by a quarter, no more
inline constexpr double roughest_motion = 0.5;  // of the factor of gyro_map()
// Returns the slip with a factor near `ratio`; null: none.
const UnitSlip* slip_near(std::span<const UnitSlip> slips, double ratio);

// `ratio`: gravity at rest over that of the site, by the nominal scale. Empty: it may be a scale factor error.
std::string wrong_gravity(double ratio, const RecordingInfo& info);
// The same for the median second at rest; of a unit that never rests, for the median block.
std::string wrong_accelerometers(const CompressedRecording& recording);

// Checks a recording with table angles: gravity at rest, of the median second, and, in physical units, the sum of the
// gyros in the table's turns, of the median turn. One sentence; empty: nothing is plainly wrong.
std::string wrong_table_units(const CompressedRecording& recording);

// The rate is factor * axes * reading.
struct GyroMap {
  Eigen::Matrix3d axes;  // signed_axes()
  double factor;
};
// The sums of consecutive rows.
struct MotionSums {
  double duration_s = 0.0;
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero(), accel = Eigen::Vector3d::Zero();
};
// Returns how the gyros are connected, whatever their unit, from gravity's direction u in the body frame: while the unit accelerates
// little, du/dt = -w x u. The change of u over a tenth of a second, or two or four, is regressed on the sums of the gyros for each of the
// 48 ways to connect them; another way must leave less than half the residual of the gyros' own. None: the unit turns too little.
std::optional<GyroMap> gyro_map(std::size_t rows, const std::function<MotionSums(std::size_t)>& row);

// `n`: rate = n * reading, over the nominal scale. Says which gyro reads which axis, if not its own; empty: each its own.
std::string wrong_axes(const Eigen::Matrix3d& n);
// The same for a recording with table angles, by its turns.
std::string wrong_table_axes(const CompressedRecording& recording, const Eigen::Matrix3d& mounting);

}  // namespace turncal
