// Does a resting unit give the same six numbers over and over while its counter runs on? Its converter hangs, or its last frame is sent
// again. A single channel may well repeat itself at rest (pulses), so what counts is all six, and how long this very unit is used to:
// a stretch of 2 s that is twenty times as long as any other, of this dwell and of those before. A unit that repeats itself for most of a
// dwell (coarse numbers, a simulator without noise) is not judged; that it is dead the first turn shows (data_screen.h).
//
// Told when the stretch has ended, so that its last sample is known, and the dwell is not begun again into it; after 30 s in any case.
#pragma once

#include <cstdint>
#include <string>

#include "calib/types/recording_types.h"

namespace turncal {

class FrozenWatch {
 public:
  explicit FrozenWatch(double sample_period_s) : period_s_(sample_period_s) {}
  void start();  // a dwell
  // What is wrong, in one line; empty: nothing. Samples in their order, none missing.
  std::string add(const ImuSample& sample);
  std::string finish();  // the dwell is complete
  // A stretch of no usual length goes on: what its mean is tells nothing of how still the unit is.
  bool suspects() const { return unusual(now_, longest_.samples); }

 private:
  struct Stretch {
    std::int64_t first = 0;
    std::int64_t samples = 0;
  };
  void close();
  bool unusual(const Stretch& stretch, std::int64_t longest_other) const;
  bool frozen(const Stretch& stretch, std::int64_t longest_other) const;
  std::string text(const Stretch& stretch) const;

  double period_s_;
  ImuSample last_{};
  std::int64_t samples_ = 0;  // of the dwell
  Stretch now_, longest_;     // the one going on; of those that have ended
  std::int64_t second_ = 0;   // the next longest
  std::int64_t usual_ = 0;    // the longest of the dwells before; 0: there was none
  bool repeats_itself_ = false;
};

}  // namespace turncal
