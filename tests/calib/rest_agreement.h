#pragma once

#include <algorithm>
#include <cstdint>

#include "calib/types/recording_types.h"

namespace turncal {

// How far two lists of segments agree on what is at rest.
struct Agreement {
  int rests_a = 0;
  int rests_b = 0;
  int matched = 0;        // rests of a that overlap one of b
  double common_s = 0.0;  // at rest in both
  double only_a_s = 0.0;
  double only_b_s = 0.0;
};

inline Agreement compare_rests(const Segments& a, const Segments& b, double sample_period_s) {
  Agreement result;
  double total_a = 0.0;
  double total_b = 0.0;
  for (const Segment& y : b)
    if (y.kind != SegmentKind::rotate) {
      ++result.rests_b;
      total_b += double(y.end_sample - y.start_sample) * sample_period_s;
    }
  for (const Segment& x : a) {
    if (x.kind == SegmentKind::rotate) continue;
    ++result.rests_a;
    total_a += double(x.end_sample - x.start_sample) * sample_period_s;
    double common = 0.0;
    for (const Segment& y : b)
      if (y.kind != SegmentKind::rotate)
        common += double(std::max<std::int64_t>(
                      0, std::min(x.end_sample, y.end_sample) - std::max(x.start_sample, y.start_sample))) *
                  sample_period_s;
    result.matched += common > 0.0 ? 1 : 0;
    result.common_s += common;
  }
  result.only_a_s = total_a - result.common_s;
  result.only_b_s = total_b - result.common_s;
  return result;
}

}  // namespace turncal
