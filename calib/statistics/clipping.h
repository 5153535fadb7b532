// Finds where a gyro reached the end of its range: runs of one and the same extreme value.
//
// Clipping piles the samples of a turn up at one value. A channel and sense is clipped when its extreme value
//   - comes several times in a row, and several times in such runs,
//   - makes up at least half of all samples within about 1 % of it,
//   - is many of the smallest steps the channel makes (ClippingLimits in limits.h),
//   - and persists: a constant rate counted in steps flickers between two of them, so that most of its runs follow each other within two samples.
//
// Samples that a file reader, which sees the numbers themselves, flags as clipped (gyro_clipped_flag) are reported too.
//
// One pass; memory: 0.8 MB and the runs. For units turned by hand: at the constant rate of a table a coarse gyro may repeat one value too.
// There the turn itself decides (clipped_turns): the sums of its blocks repeat one value, and it is short of what was commanded.
// Not modelled: a sensor that wraps around, or that rings at the end of its range.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "calib/statistics/compression.h"
#include "calib/types/recording_types.h"

namespace turncal {

// Bits of ImuSample::flags, together with sample_flag_invalid.
constexpr std::uint32_t gyro_clipped_flag(int axis) { return std::uint32_t{2} << axis; }
// A bit of its own: the sample belongs to a rest that disagreed with all the others and was repeated. The whole rest is
// one event, invalid, with this in place of an axis.
inline constexpr std::uint32_t sample_flag_set_aside = 16;
inline constexpr int set_aside_axis = -2;

class ClippingFinder {
 public:
  ClippingFinder();
  void add(const ImuSample& sample);
  // Returns the runs in time order: invalid, with the axis; size: the end of the range.
  std::vector<DataEvent> finish();
  void note(std::vector<DataEvent>& events);

 private:
  struct Side {  // one axis, one sense of rotation
    double extreme = 0.0;
    std::vector<DataEvent> runs;  // at the extreme so far
    DataEvent current{.count = 0};
    std::vector<std::uint32_t> histogram;  // over magnitude, bins of 1/128 of it
  };
  void close(Side& side);

  std::array<std::array<Side, 2>, 3> sides_;
  std::vector<DataEvent> flagged_;
  std::array<double, 3> last_{};
  std::array<double, 3> step_{};  // smallest change that is not zero
  bool any_ = false;
};

// For a recording with table angles: returns an event for each axis that clipped in a turn, in time order; size: the end of the range.
std::vector<DataEvent> clipped_turns(const CompressedRecording& recording);

// Returns "gyro x clipped at 8 deg/s", by the nominal scale.
std::string clipped_text(const RecordingInfo& info, int axis, double increment);

}  // namespace turncal
