// Samples that a recording lost, or marked as bad, between two that it has; and how that is said.
//
// n of them are filled in with the mean of their two neighbours, and err by n q / sqrt(12) of counting in pulses q, and by n N sqrt(dt / 2)
// of random walk N. With a pulse of 0.93" two are off by 0.54", in 300 s of alignment 0.008 deg of heading, a quarter of what 0.002
// deg/sqrt(h) leaves; it grows with n, and 5 s would be degrees. Nothing is aligned or navigated over more than two.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace turncal {

inline constexpr std::int64_t most_filled_samples = 2;

struct SampleGap {
  std::int64_t first = 0;      // counter of the first that is lost
  std::int64_t samples = 0;    // how many
  std::int64_t in_motion = 0;  // of them where the unit turned
  bool is_short() const { return samples <= most_filled_samples; }
};

// The first in [begin, end) that nothing goes over; null: none.
inline const SampleGap* long_gap_in(const std::vector<SampleGap>& gaps, std::int64_t begin, std::int64_t end) {
  for (const SampleGap& gap : gaps)
    if (!gap.is_short() && gap.first < end && gap.first + gap.samples > begin) return &gap;
  return nullptr;
}

inline std::string gap_words(const SampleGap& gap) {
  return std::to_string(gap.samples) + " samples lost from sample " + std::to_string(gap.first) + " on";
}

}  // namespace turncal
