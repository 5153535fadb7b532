#include "calib/statistics/table_turns.h"

#include <array>
#include <cmath>
#include <limits>

#include "calib/model/parameters.h"
#include "calib/statistics/distributions.h"

namespace turncal {

namespace {

// Of the rest that ends before block `end`, increments a second: biases of degrees in the time of a turn, and the earth's rate.
Eigen::Vector3d rate_at_rest(const std::vector<Block>& blocks, std::size_t end) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double t = 0.0;
  for (std::size_t k = end; k > 0 && blocks[k - 1].segment == blocks[end - 1].segment; --k) {
    if (!blocks[k - 1].whole_second) continue;
    sum += blocks[k - 1].gyro;
    t += blocks[k - 1].duration_s;
  }
  return t > 0.0 ? (sum / t).eval() : sum;
}

}  // namespace

std::vector<TableTurn> table_turns(const CompressedRecording& recording) {
  constexpr double least_turn_deg = 20.0;
  const double gyro_rad = nominal_gyro_rad(recording.info);
  const std::vector<Block>& blocks = recording.blocks;
  std::vector<TableTurn> turns;
  for (std::size_t first = 0, end = 0; first < blocks.size(); first = end) {
    const auto segment = static_cast<std::size_t>(blocks[first].segment);
    Eigen::Vector3d felt = Eigen::Vector3d::Zero();
    double felt_s = 0.0;
    for (end = first; end < blocks.size() && static_cast<std::size_t>(blocks[end].segment) == segment; ++end) {
      felt += blocks[end].gyro;
      felt_s += blocks[end].duration_s;
    }
    felt -= felt_s * rate_at_rest(blocks, first);
    if (segment == 0 || recording.segments[segment].kind != SegmentKind::rotate) continue;
    const Segment &from = recording.segments[segment - 1], &to = recording.segments[segment];
    const std::array<double, 3> by = {std::abs(to.heading_deg - from.heading_deg),
                                      std::abs(to.pitch_deg - from.pitch_deg), std::abs(to.roll_deg - from.roll_deg)};
    const double sum = by[0] + by[1] + by[2];
    const bool one_axis = by[0] == sum || by[1] == sum || by[2] == sum;
    if (one_axis && sum >= least_turn_deg) turns.push_back({first, end, sum * rad_per_deg, gyro_rad * felt});
  }
  return turns;
}

double felt_of_commanded(const CompressedRecording& recording) {
  std::vector<double> ratios;
  for (const TableTurn& turn : table_turns(recording)) ratios.push_back(turn.felt_rad() / turn.commanded_rad);
  return ratios.size() < 3 ? std::numeric_limits<double>::quiet_NaN() : median(ratios);
}

}  // namespace turncal
