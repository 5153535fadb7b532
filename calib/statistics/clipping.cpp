#include "calib/statistics/clipping.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include "calib/model/limits.h"
#include "calib/model/parameters.h"
#include "calib/statistics/table_turns.h"

namespace turncal {
namespace {

constexpr double same = 1e-9;  // relative: rounding of a constant times an interval

// Seven bits of the mantissa: bins of 1/128 of the value.
std::size_t bin_of(double magnitude) { return std::bit_cast<std::uint32_t>(static_cast<float>(magnitude)) >> 16; }

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
      side.current = {static_cast<int>(axis), sample.counter, 1, x};
    } else if (magnitude >= side.extreme * (1.0 - same) && magnitude > 0.0) {
      if (side.current.count == 0) side.current = {static_cast<int>(axis), sample.counter, 0, x};
      ++side.current.count;
    } else {
      close(side);
    }
    if ((sample.flags & gyro_clipped_flag(static_cast<int>(axis))) != 0) {
      const bool goes_on = !flagged_.empty() && flagged_.back().axis == static_cast<int>(axis) &&
                           flagged_.back().sample + flagged_.back().count == sample.counter;
      if (!goes_on) flagged_.push_back({static_cast<int>(axis), sample.counter, 0, x});
      ++flagged_.back().count;
    }
    const double change = std::abs(x - last_[axis]);
    if (any_ && change > same * magnitude) step_[axis] = std::min(step_[axis], change);
    last_[axis] = x;
  }
  any_ = true;
}

std::vector<ClippedRun> ClippingFinder::finish() {
  std::vector<ClippedRun> result = flagged_;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (Side& side : sides_[axis]) {
      close(side);
      std::int64_t at = 0;
      for (const ClippedRun& run : side.runs) at += run.count;
      if (at < clipping_limits.fewest || !(side.extreme > clipping_limits.least_steps * step_[axis])) continue;
      const std::size_t top = bin_of(side.extreme);
      const double band = static_cast<double>(side.histogram[top]) + static_cast<double>(side.histogram[top - 1]);
      if (static_cast<double>(at) < clipping_limits.of_band * band) continue;
      result.insert(result.end(), side.runs.begin(), side.runs.end());
    }
  std::sort(result.begin(), result.end(), [](const ClippedRun& a, const ClippedRun& b) { return a.sample < b.sample; });
  return result;
}

void ClippingFinder::note(std::vector<DataEvent>& events) {
  for (const ClippedRun& run : finish())
    events.push_back({DataEvent::Kind::invalid, run.sample, run.count, run.axis, run.value});
}

namespace {

// In one turn, by its blocks; count 0: the axis does not repeat its highest value.
ClippedRun repeated(const CompressedRecording& recording, const TableTurn& turn, int axis) {
  const auto mean = [&](std::size_t k) {
    const Block& b = recording.blocks[k];
    return b.samples > 0 && b.missing == 0 ? b.gyro[axis] / b.samples : 0.0;
  };
  double extreme = 0.0;
  for (std::size_t k = turn.first; k < turn.end; ++k)
    if (std::abs(mean(k)) > std::abs(extreme)) extreme = mean(k);
  const bool counted = recording.info.gyro_increment == IncrementKind::pulses;
  if (extreme == 0.0 || (counted && std::abs(extreme - std::round(extreme)) > same * std::abs(extreme))) return {};
  ClippedRun longest, run;
  std::int64_t near = 0;
  for (std::size_t k = turn.first; k < turn.end; ++k) {
    const std::int64_t samples = recording.blocks[k].samples;
    if (mean(k) / extreme > 1.0 - clipping_limits.short_by) near += samples;
    if (std::abs(mean(k) - extreme) > same * std::abs(extreme)) {
      run.count = 0;
      continue;
    }
    if (run.count == 0) run = {axis, recording.blocks[k].start_sample, 0, extreme};
    run.count += samples;
    if (run.count > longest.count) longest = run;
  }
  const bool most = static_cast<double>(longest.count) >= clipping_limits.of_band * static_cast<double>(near);
  return longest.count >= clipping_limits.fewest && most ? longest : ClippedRun{};
}

}  // namespace

std::vector<DataEvent> clipped_turns(const CompressedRecording& recording) {
  struct Suspect {
    ClippedRun run;
    double felt;
  };
  std::vector<Suspect> suspects;
  double whole = 0.0;  // what a turn that does not repeat itself adds up to: the scale factor may be far from nominal
  for (const TableTurn& turn : table_turns(recording)) {
    const double felt = turn.felt_rad / turn.commanded_rad;
    const std::size_t before = suspects.size();
    for (int axis = 0; axis < 3; ++axis)
      if (const ClippedRun run = repeated(recording, turn, axis); run.count > 0) suspects.push_back({run, felt});
    if (suspects.size() == before) whole = std::max(whole, felt);
  }
  if (whole == 0.0) whole = 1.0;
  std::vector<DataEvent> events;
  for (const Suspect& s : suspects)
    if (s.felt < (1.0 - clipping_limits.short_by) * whole)
      events.push_back({DataEvent::Kind::invalid, s.run.sample, s.run.count, s.run.axis, s.run.value});
  return events;
}

std::string clipped_text(const RecordingInfo& info, int axis, double increment) {
  char text[64];
  std::snprintf(text, sizeof text, "gyro %c clipped at %.4g deg/s", "xyz"[axis],
                nominal_gyro_rad(info) * std::abs(increment) / (info.sample_period_s * rad_per_deg));
  return text;
}

}  // namespace turncal
