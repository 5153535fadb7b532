#include "calib/rests/rest_data.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace turncal {
namespace {

using Eigen::Vector3d;

RestMean mean_of(const CompressedRecording& recording, std::size_t first, std::size_t end) {
  RestMean mean;
  mean.first_block = first;
  mean.end_block = end;
  for (std::size_t k = first; k < end; ++k) {
    mean.gyro += recording.blocks[k].gyro;
    mean.accel += recording.blocks[k].accel;
    mean.duration_s += recording.blocks[k].samples * recording.info.sample_period_s;
  }
  if (mean.duration_s > 0.0) {
    mean.gyro /= mean.duration_s;
    mean.accel /= mean.duration_s;
  }
  return mean;
}

Rest make_rest(const CompressedRecording& recording, std::size_t first, std::size_t end, double edge_s) {
  Rest rest;
  rest.whole = mean_of(recording, first, end);
  const double edge = std::min(edge_s, rest.whole.duration_s / 3.0);
  const double period = recording.info.sample_period_s;
  std::size_t after = first;
  for (double length = 0.0; after < end && length + 1e-9 < edge; ++after)
    length += recording.blocks[after].samples * period;
  std::size_t before = end;
  for (double length = 0.0; before > first && length + 1e-9 < edge; --before)
    length += recording.blocks[before - 1].samples * period;
  rest.first_edge = mean_of(recording, first, after);
  rest.last_edge = mean_of(recording, before, end);
  rest.start_s =
      static_cast<double>(recording.blocks[first].start_sample - recording.blocks.front().start_sample) * period;
  // Between the middles of the edges: the whole less half of each.
  const RestMean& a = rest.first_edge;
  const RestMean& b = rest.last_edge;
  rest.between_s = rest.whole.duration_s - 0.5 * (a.duration_s + b.duration_s);
  rest.gyro_between =
      (rest.whole.gyro * rest.whole.duration_s - 0.5 * (a.gyro * a.duration_s + b.gyro * b.duration_s)) /
      rest.between_s;
  return rest;
}

std::string fault_in(const CompressedRecording& recording, std::size_t first, std::size_t end) {
  if (first >= end) return "no sample between the two rests";
  const std::int64_t from = recording.blocks[first].start_sample;
  const Block& last = recording.blocks[end - 1];
  const std::int64_t to = last.start_sample + last.samples + last.missing;
  for (const DataEvent& event : recording.events)
    if (event.sample >= from && event.sample < to && event.kind != DataEvent::Kind::duplicate)
      return std::string(to_string(event.kind)) + " of " + std::to_string(event.count) + " sample" +
             (event.count == 1 ? "" : "s") + " at sample " + std::to_string(event.sample);
  return {};
}

// Half the mean square of differences of neighbouring blocks in rests, as a white density; the median keeps out knocks.
void measure_noise(RestData& data) {
  const CompressedRecording& recording = *data.recording;
  std::vector<double> squares[6];
  for (const Rest& rest : data.rests)
    for (std::size_t k = rest.whole.first_block; k + 1 < rest.whole.end_block; ++k) {
      const Block& a = recording.blocks[k];
      const Block& b = recording.blocks[k + 1];
      if (a.samples != b.samples || a.missing != 0 || b.missing != 0) continue;
      for (int axis = 0; axis < 3; ++axis) {
        squares[axis].push_back(std::pow(a.gyro[axis] - b.gyro[axis], 2) / (2.0 * a.duration_s));
        squares[3 + axis].push_back(std::pow(a.accel[axis] - b.accel[axis], 2) / (2.0 * a.duration_s));
      }
    }
  if (squares[0].size() < 10) return;
  constexpr double median_of_chi_square = 0.454936;
  for (int channel = 0; channel < 6; ++channel) {
    const auto middle = squares[channel].begin() + static_cast<std::ptrdiff_t>(squares[channel].size() / 2);
    std::nth_element(squares[channel].begin(), middle, squares[channel].end());
    (channel < 3 ? data.gyro_white : data.accel_white)[channel % 3] = std::sqrt(*middle / median_of_chi_square);
  }
}

}  // namespace

CompressionOptions rest_compression_options() {
  CompressionOptions options;
  options.static_block_s = 0.25;
  options.block_angle_rad = 0.04;  // third-order coning is 1e-7 rad a block at this size, far below any noise here
  options.glitch_counts_min = std::numeric_limits<double>::infinity();  // a hand jerks: what it does is no glitch
  options.leaves_out_turning = false;                                   // rests were chosen to be still
  return options;
}

RestData make_rest_data(const CompressedRecording& recording, double edge_s) {
  RestData data;
  data.recording = &recording;
  const auto still = [&](std::size_t k) {
    return recording.segments[static_cast<std::size_t>(recording.blocks[k].segment)].kind != SegmentKind::rotate;
  };
  std::size_t last_end = 0;
  for (std::size_t k = 0; k < recording.blocks.size();) {
    if (!still(k)) {
      ++k;
      continue;
    }
    std::size_t end = k;
    while (end < recording.blocks.size() && still(end)) ++end;
    if (!data.rests.empty()) {
      RestLeg leg;
      leg.from = data.rests.size() - 1;
      leg.first_block = last_end;
      leg.end_block = k;
      for (std::size_t b = last_end; b < k; ++b) {
        leg.duration_s += recording.blocks[b].duration_s;
        leg.turn_increments += recording.blocks[b].gyro.norm();
      }
      leg.fault = fault_in(recording, last_end, k);
      data.legs.push_back(std::move(leg));
    }
    data.rests.push_back(make_rest(recording, k, end, edge_s));
    last_end = end;
    k = end;
  }
  measure_noise(data);
  return data;
}

}  // namespace turncal
