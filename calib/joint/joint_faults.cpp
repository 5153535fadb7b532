#include "calib/joint/joint_faults.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace turncal {
namespace {

std::string format(const char* pattern, double value) {
  char text[160];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

std::size_t block_of(const CompressedRecording& recording, std::int64_t sample) {
  const auto after = std::upper_bound(recording.blocks.begin(), recording.blocks.end(), sample,
                                      [](std::int64_t s, const Block& b) { return s < b.start_sample; });
  return after == recording.blocks.begin() ? 0 : static_cast<std::size_t>(after - recording.blocks.begin()) - 1;
}

void add_break(std::vector<Break>& breaks, const Break& cut) {
  const auto place = std::lower_bound(breaks.begin(), breaks.end(), cut.block,
                                      [](const Break& b, std::size_t block) { return b.block < block; });
  breaks.insert(place, cut);
}

constexpr double chi_square_3_one_in_1e9 = 44.8;

}  // namespace

std::vector<Fault> faults_from_events(const CompressedRecording& recording, std::vector<Break>& breaks) {
  std::vector<Fault> faults;
  for (const DataEvent& event : recording.events) {
    Fault fault;
    fault.first_sample = event.sample;
    fault.last_sample = event.sample + std::max<std::int64_t>(event.count, 1) - 1;
    fault.block = block_of(recording, event.sample);
    const bool rotating = recording.segments[recording.blocks[fault.block].segment].kind == SegmentKind::rotate;
    Break cut;
    cut.block = fault.block;
    if (event.kind == DataEvent::Kind::duplicate) {
      fault.what = "sample counted twice by the unit";
      fault.action = "the second copy dropped";
      faults.push_back(fault);
      continue;
    }
    if (event.kind == DataEvent::Kind::gap) {
      fault.what = format("gap of %.0f sample(s) in the unit's counter", static_cast<double>(event.count));
      // At rest nothing turned meanwhile but the earth; the block that follows the gap carries it.
      if (!rotating && event.count < 2000)
        cut.tilt_sigma_rad = cut.heading_sigma_rad = 1e-6 * static_cast<double>(event.count);
    } else if (event.kind == DataEvent::Kind::invalid) {
      fault.what = "sample marked invalid by the unit";
    } else {
      const bool gyro = event.kind == DataEvent::Kind::gyro_glitch;
      fault.what = std::string(gyro ? "gyro" : "accelerometer") + " glitch on axis " + "xyz"[event.axis] +
                   format(", %.0f counts off its neighbours", event.size);
      if (!gyro) cut.tilt_sigma_rad = cut.heading_sigma_rad = 0.0;
    }
    fault.action =
        rotating ? "leg set aside: attitude and velocity found again after it" : "velocity started again after it";
    if (!faults.empty() && faults.back().block == fault.block && faults.back().what == fault.what) {
      faults.back().last_sample = fault.last_sample;
      continue;
    }
    add_break(breaks, cut);
    // What a second's mean velocity says depends on when in it the glitch was: nothing learned from that second is kept.
    if (!rotating && event.kind != DataEvent::Kind::gap && fault.block + 1 < recording.blocks.size()) {
      ++cut.block;
      add_break(breaks, cut);
    }
    faults.push_back(fault);
  }
  return faults;
}

bool cut_worst_fault(const CompressedRecording& recording, const std::vector<Innovation>& innovations,
                     std::vector<Fault>& faults, std::vector<Break>& breaks) {
  // What the first seconds after a rotation usually show.
  std::vector<double> after_rotation;
  for (const Innovation& i : innovations)
    if (i.block > 0 && !recording.blocks[i.block - 1].whole_second)
      after_rotation.push_back(i.normalised.squaredNorm());
  double usual = 0.0;
  if (after_rotation.size() >= 10) {
    const auto rank = after_rotation.begin() + static_cast<std::ptrdiff_t>(after_rotation.size() * 9 / 10);
    std::nth_element(after_rotation.begin(), rank, after_rotation.end());
    usual = *rank;
  }
  const double limit = std::max(chi_square_3_one_in_1e9, 10.0 * usual);
  const Innovation* worst = nullptr;
  for (const Innovation& i : innovations)
    if (i.normalised.squaredNorm() > limit && (!worst || i.normalised.squaredNorm() > worst->normalised.squaredNorm()))
      worst = &i;
  if (!worst) return false;

  // The fault lies between the last observed second before it and this one.
  std::size_t first = worst->block;
  while (first > 0 && !recording.blocks[first - 1].whole_second) --first;
  const bool in_rotation = first != worst->block;
  Break cut;
  cut.block = first;
  for (const Break& b : breaks)
    if (b.block == cut.block && b.tilt_sigma_rad >= 0.02) return false;  // cut already: it is not a matter of the chain
  Fault fault;
  fault.block = first;
  fault.first_sample = recording.blocks[first].start_sample;
  fault.last_sample = recording.blocks[worst->block].start_sample + recording.blocks[worst->block].samples - 1;
  const double step = worst->velocity_mps.y();
  const double of_one_sample = recording.info.gravity_mps2 * recording.info.sample_period_s;
  const double ratio = step / of_one_sample;
  if (in_rotation && std::abs(std::abs(ratio) - std::round(std::abs(ratio))) < 0.1 && std::abs(ratio) > 0.9 &&
      std::abs(ratio) < 20.0)
    fault.what = format(ratio < 0.0 ? "%.0f sample(s) of gravity missing (velocity step down)"
                                    : "%.0f sample(s) of gravity too many (velocity step up)",
                        std::abs(std::round(ratio)));
  else
    fault.what = format("velocity step of %.3g m/s that no noise explains", worst->velocity_mps.norm());
  fault.action =
      in_rotation ? "leg set aside: attitude and velocity found again after it" : "velocity started again after it";
  faults.push_back(fault);
  add_break(breaks, cut);
  return true;
}

}  // namespace turncal
