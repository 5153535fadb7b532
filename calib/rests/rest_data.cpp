#include "calib/rests/rest_data.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <span>

#include <fmt/format.h>

#include "calib/model/limits.h"
#include "calib/model/parameters.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/numerics.h"
#include "calib/statistics/segmentation.h"
#include "calib/types/value_text.h"

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
  rest.start_s = double(recording.blocks[first].start_sample - recording.blocks.front().start_sample) * period;
  // Between the middles of the edges: the whole rest less half of each edge.
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
  const auto in_leg = [&](const DataEvent& event) {
    return event.sample < to && event.sample + std::max<std::int64_t>(event.count, 1) > from;
  };
  for (const DataEvent& event : recording.events)
    if (event.kind == DataEvent::Kind::invalid && event.axis >= 0 && in_leg(event))
      return fmt::format("{} for {} from sample {}", clipped_text(recording.info, event.axis, event.size),
                         counted(event.count, "sample"), event.sample);
  for (const DataEvent& event : recording.events)
    if (!event.filled && event.kind != DataEvent::Kind::duplicate && event.kind != DataEvent::Kind::temperature &&
        event.sample >= from && event.sample < to)
      return fmt::format("{} of {} at sample {}", to_string(event.kind), counted(event.count, "sample"), event.sample);
  return {};
}

struct Run {  // blocks
  std::size_t first = 0;
  std::size_t end = 0;
};

// Returns the white variance per second and channel: half the mean square difference of neighbouring blocks, by the
// median, which ignores knocks. Zero with fewer than `least` differences.
SixChannels white_variance(const CompressedRecording& recording, std::span<const Run> runs, std::size_t least) {
  std::vector<double> squares[6];
  for (const Run& run : runs)
    for (std::size_t k = run.first; k + 1 < run.end; ++k) {
      const Block& a = recording.blocks[k];
      const Block& b = recording.blocks[k + 1];
      if (a.samples != b.samples || a.missing != 0 || b.missing != 0) continue;
      for (int axis = 0; axis < 3; ++axis) {
        squares[axis].push_back(std::pow(a.gyro[axis] - b.gyro[axis], 2) / (2.0 * a.duration_s));
        squares[3 + axis].push_back(std::pow(a.accel[axis] - b.accel[axis], 2) / (2.0 * a.duration_s));
      }
    }
  SixChannels variance = SixChannels::Zero();
  if (squares[0].size() < least) return variance;
  constexpr double median_of_chi_square = 0.454936;
  for (int channel = 0; channel < 6; ++channel) variance[channel] = median(squares[channel]) / median_of_chi_square;
  return variance;
}

// Remarks on rests: for each remark the beginnings of the rests, with a figure.
using RestRemarks = std::map<std::string, std::vector<std::string>>;

// Cuts `run` to its still part; false: it is no rest. `white`: of all rests.
bool verify(const CompressedRecording& recording, const SixChannels& white, Run& run, RestRemarks& remarks) {
  const auto seconds = [&](std::size_t block) {
    return double(recording.blocks[block].start_sample - recording.blocks.front().start_sample) *
           recording.info.sample_period_s;
  };
  const auto say = [&](const char* what, double number) {
    remarks[what].push_back(fmt::format("at {:.1f} s ({:.3g})", seconds(run.first), number));
  };
  const SixChannels own = white_variance(recording, {&run, 1}, 3);
  const double tremor = std::max(own.head<3>().sum() / std::max(white.head<3>().sum(), 1e-300),
                                 own.tail<3>().sum() / std::max(white.tail<3>().sum(), 1e-300));
  if ((white > 0.0).all() && tremor > segmentation_limits.most_tremor) {
    say("set aside because the unit moves there (variance over that of the other rests)", tremor);
    return false;
  }
  std::vector<SixChannels> means;
  for (std::size_t k = run.first; k < run.end; ++k) {
    const Block& block = recording.blocks[k];
    means.emplace_back();
    means.back() << block.gyro.array() / block.duration_s, block.accel.array() / block.duration_s;
  }
  const StillPart part = longest_still(means, (white / recording.blocks[run.first].duration_s).sqrt());
  if (part.end - part.first == means.size()) return true;
  const Run cut{run.first + part.first, run.first + part.end};
  if (part.end - part.first < rest_limits.fewest_still) {
    say("set aside because the unit moves there (seconds that are still)",
        part.end > part.first ? seconds(cut.end - 1) - seconds(cut.first) : 0.0);
    return false;
  }
  say("cut to where the unit stands still (seconds cut)",
      seconds(run.end - 1) - seconds(run.first) - seconds(cut.end - 1) + seconds(cut.first));
  run = cut;
  return true;
}

}  // namespace

CompressionOptions rest_compression_options() {
  CompressionOptions options;
  options.static_block_s = 0.25;
  options.block_angle_rad = 0.04;  // third-order coning is 1e-7 rad a block at this size, far below any noise here
  options.glitch.counts_min = std::numeric_limits<double>::infinity();  // a jerk by hand is no glitch
  options.leaves_out_turning = false;                                   // the rests were chosen to be still
  return options;
}

RestData make_rest_data(const CompressedRecording& recording, double edge_s) {
  RestData data;
  data.recording = &recording;
  std::vector<Run> runs;
  for (std::size_t k = 0; k < recording.blocks.size(); ++k) {
    if (recording.rotates(recording.blocks[k])) continue;
    if (runs.empty() || runs.back().end != k) runs.push_back({k, k});
    runs.back().end = k + 1;
  }
  const SixChannels white = white_variance(recording, runs, 10);
  RestRemarks remarks;
  std::erase_if(runs, [&](Run& run) { return !verify(recording, white, run, remarks); });
  for (const auto& [what, rests] : remarks) {
    const std::ptrdiff_t all = std::ssize(rests), told = std::min<std::ptrdiff_t>(all, 8);
    data.notes.push_back(fmt::format("{} {}: {}{}", counted(all, "rest"), what,
                                     fmt::join(rests.begin(), rests.begin() + told, ", "),
                                     told < all ? fmt::format(", and {} more", all - told) : ""));
  }
  for (const Run& run : runs) {
    if (!data.rests.empty()) {
      RestLeg leg;
      leg.from = data.rests.size() - 1;
      leg.first_block = data.rests.back().whole.end_block;
      leg.end_block = run.first;
      for (std::size_t b = leg.first_block; b < leg.end_block; ++b) leg.duration_s += recording.blocks[b].duration_s;
      leg.fault = fault_in(recording, leg.first_block, leg.end_block);
      data.legs.push_back(std::move(leg));
    }
    data.rests.push_back(make_rest(recording, run.first, run.end, edge_s));
  }
  const SixChannels density = white_variance(recording, runs, 10).sqrt();
  data.gyro_white = density.head<3>();
  data.accel_white = density.tail<3>();
  return data;
}

}  // namespace turncal
