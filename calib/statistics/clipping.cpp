#include "calib/statistics/clipping.h"

#include <fmt/format.h>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "calib/model/limits.h"
#include "calib/model/parameters.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
namespace {

constexpr double same = 1e-9;  // relative: rounding of a constant times an interval

// Seven bits of the mantissa: bins of 1/128 of the value.
std::size_t bin_of(double magnitude) { return std::bit_cast<std::uint32_t>(float(magnitude)) >> 16; }

}  // namespace

ClippingFinder::ClippingFinder() {
  step_.fill(std::numeric_limits<double>::infinity());
  for (auto& axis : sides_)
    for (Side& side : axis) side.histogram.assign(std::size_t{1} << 15, 0);
}

void ClippingFinder::close(Side& side) {
  if (side.current.count >= clipping_limits.shortest_run) side.runs.push_back(side.current);
  side.current.count = 0;
}

void ClippingFinder::add(const ImuSample& sample) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double x = sample.gyro[axis];
    const double magnitude = std::abs(x);
    Side& side = sides_[axis][x < 0.0 ? 1 : 0];
    close(sides_[axis][x < 0.0 ? 0 : 1]);
    ++side.histogram[bin_of(magnitude)];
    if (magnitude > side.extreme * (1.0 + same)) {
      side.extreme = magnitude;
      side.runs.clear();
      side.current = {DataEvent::Kind::invalid, sample.counter, 1, int(axis), x};
    } else if (magnitude >= side.extreme * (1.0 - same) && magnitude > 0.0) {
      if (side.current.count == 0) side.current = {DataEvent::Kind::invalid, sample.counter, 0, int(axis), x};
      ++side.current.count;
    } else {
      close(side);
    }
    if ((sample.flags & gyro_clipped_flag(int(axis))) != 0) {
      const bool goes_on = !flagged_.empty() && flagged_.back().axis == int(axis) &&
                           flagged_.back().sample + flagged_.back().count == sample.counter;
      if (!goes_on) flagged_.push_back({DataEvent::Kind::invalid, sample.counter, 0, int(axis), x});
      ++flagged_.back().count;
    }
    const double change = std::abs(x - last_[axis]);
    if (any_ && change > same * magnitude) step_[axis] = std::min(step_[axis], change);
    last_[axis] = x;
  }
  any_ = true;
}

std::vector<DataEvent> ClippingFinder::finish() {
  std::vector<DataEvent> result = flagged_;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (Side& side : sides_[axis]) {
      close(side);
      std::int64_t at = 0, end = 0;
      std::size_t flickers = 0;
      for (const DataEvent& run : side.runs) {
        if (at > 0 && run.sample - end < clipping_limits.shortest_run) ++flickers;
        at += run.count;
        end = run.sample + run.count;
      }
      if (2 * flickers > side.runs.size() || at < clipping_limits.fewest ||
          !(side.extreme > clipping_limits.least_steps * step_[axis]))
        continue;
      const std::size_t top = bin_of(side.extreme);
      const double band = double(side.histogram[top]) + double(side.histogram[top - 1]);
      if (double(at) < clipping_limits.of_band * band) continue;
      result.insert(result.end(), side.runs.begin(), side.runs.end());
    }
  std::ranges::sort(result, [](const DataEvent& a, const DataEvent& b) { return a.sample < b.sample; });
  return result;
}

void ClippingFinder::note(std::vector<DataEvent>& events) {
  const std::vector<DataEvent> found = finish();
  events.insert(events.end(), found.begin(), found.end());
}

namespace {

// Returns increments per sample; 0 beside a gap.
double mean(const Block& b, int axis) { return b.samples > 0 && b.missing == 0 ? b.gyro[axis] / b.samples : 0.0; }

// Returns the highest value of one turn if the axis repeats it, in increments per sample, with its sign; else 0.
double repeated(const CompressedRecording& recording, const TableTurn& turn, int axis) {
  double extreme = 0.0;
  for (std::size_t k = turn.first; k < turn.end; ++k)
    if (const double x = mean(recording.blocks[k], axis); std::abs(x) > std::abs(extreme)) extreme = x;
  const bool counted = recording.info.gyro_increment == IncrementKind::pulses;
  if (extreme == 0.0 || (counted && std::abs(extreme - std::round(extreme)) > same * std::abs(extreme))) return 0.0;
  std::int64_t longest = 0, run = 0, near = 0;
  int blocks = 0;  // of the run: a single one repeats nothing
  for (std::size_t k = turn.first; k < turn.end; ++k) {
    const double x = mean(recording.blocks[k], axis);
    if (x / extreme > 1.0 - clipping_limits.short_by) near += recording.blocks[k].samples;
    const bool goes_on = std::abs(x - extreme) <= same * std::abs(extreme);
    run = goes_on ? run + recording.blocks[k].samples : 0;
    blocks = goes_on ? blocks + 1 : 0;
    if (blocks > 1) longest = std::max(longest, run);
  }
  const bool most = double(longest) >= clipping_limits.of_band * double(near);
  return longest >= clipping_limits.fewest && most ? extreme : 0.0;
}

}  // namespace

std::vector<DataEvent> clipped_turns(const CompressedRecording& recording) {
  struct Suspect {
    double end;  // of the range
    int axis;
    double felt;
  };
  const std::vector<Block>& blocks = recording.blocks;
  const auto turns = [&](std::size_t k) { return recording.rotates(blocks[k]); };
  std::array<std::array<double, 2>, 3> fastest{};  // by axis and sense
  const auto fastest_as = [&](int axis, double x) -> double& { return fastest[axis][x < 0.0 ? 1 : 0]; };
  for (std::size_t k = 0; k < blocks.size(); ++k)
    for (int axis = 0; axis < 3 && turns(k); ++axis) {
      const double x = mean(blocks[k], axis);
      fastest_as(axis, x) = std::max(fastest_as(axis, x), std::abs(x));
    }
  std::vector<Suspect> suspects;
  double whole = 0.0;  // largest sum of a turn without repetition: the scale factor may be far from nominal
  for (const TableTurn& turn : table_turns(recording)) {
    const double felt = turn.felt_rad() / turn.commanded_rad;
    const std::size_t before = suspects.size();
    for (int axis = 0; axis < 3; ++axis) {
      const double extreme = repeated(recording, turn, axis), end = std::abs(extreme);
      if (end > 0.0 && end >= (1.0 - same) * fastest_as(axis, extreme))  // nothing is beyond the end of a range
        suspects.push_back({end, axis, felt});
    }
    if (suspects.size() == before) whole = std::max(whole, felt);
  }
  if (whole == 0.0) whole = 1.0;
  std::erase_if(suspects, [&](const Suspect& s) { return s.felt >= (1.0 - clipping_limits.short_by) * whole; });
  // A gyro that has clipped once clips whenever it reads as much, even in a turn that is hardly short or about several axes.
  std::vector<DataEvent> events;
  for (int axis = 0; axis < 3; ++axis) {
    int segment = -1;
    for (std::size_t k = 0; k < blocks.size(); ++k) {
      const bool clipped = turns(k) && std::ranges::any_of(suspects, [&](const Suspect& s) {
                             return s.axis == axis && std::abs(std::abs(mean(blocks[k], axis)) - s.end) <= same * s.end;
                           });
      if (!clipped) continue;
      if (blocks[k].segment != segment)
        events.push_back({DataEvent::Kind::invalid, blocks[k].start_sample, 0, axis, std::abs(mean(blocks[k], axis))});
      segment = blocks[k].segment;
      events.back().count = blocks[k].start_sample + blocks[k].samples - events.back().sample;
    }
  }
  std::ranges::sort(events, [](const DataEvent& a, const DataEvent& b) { return a.sample < b.sample; });
  return events;
}

std::string clipped_text(const RecordingInfo& info, int axis, double increment) {
  return fmt::format("gyro {} clipped at {:.4g} deg/s", "xyz"[axis],
                     nominal_gyro_rad(info) * std::abs(increment) / (info.sample_period_s * rad_per_deg));
}

}  // namespace turncal
