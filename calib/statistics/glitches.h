// Single samples that stand out from their neighbours, and other faults of the data as they are listed.
//
// With x_k the increment of one channel, d_k = x_(k-1) - (x_k + x_(k-2)) / 2. Sample k-1 is suspected when |d_k| is above ratio times the running rms
// of d (memory of 100 samples) and above a least value: so many nominal pulses, and of gyros what a table of 7 rad/s^2 does.
// A sample that stands out by g gives d = -g/2, g, -g/2, and sum d = 0. Where a table begins or ends to accelerate the slope of x changes by s, and
// sum d = -s/2 with no |d| above it. So a suspect stays when |sum of d about it, two before to two behind| < |d| / 2; else it is a corner of the motion.
// Where that is not known yet, at the end or beside a gap, it stays.
//
// Not modelled: glitches closer than three samples to each other are one; a glitch in the very corner of a motion is taken for it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "calib/types/recording_types.h"

namespace turncal {

struct DataEvent {
  enum class Kind { gap, duplicate, invalid, gyro_glitch, accel_glitch, temperature } kind = Kind::gap;
  std::int64_t sample = 0;  // counter
  std::int64_t count = 1;   // samples concerned
  int axis = -1;            // 0 1 2, or -1
  double size = 0.0;  // glitches: in counts above the neighbours, or as it came where it was left out; temperature: C
  bool left_out = false;  // it is in no block
  bool filled = false;    // gaps: short, and filled in between the samples beside it (compression.h)
};
const char* to_string(DataEvent::Kind kind);

struct GlitchLimits {
  double ratio = 12.0;       // of the rms second difference
  double counts_min = 20.0;  // nominal pulses
};

class GlitchFinder {
 public:
  GlitchFinder(const RecordingInfo& info, const GlitchLimits& limits);
  // Samples in the order in which they came. A suspect is put at the end of `events`, and taken away again two samples later where it was none.
  void add(const ImuSample& sample, std::vector<DataEvent>& events);
  // The next sample's neighbours are not known: a turn went on while samples were lost.
  void forget_neighbours(const ImuSample& next);
  // Mean square of d over the last 100 samples or so, channels gyro x y z, accelerometer x y z, increments squared.
  const Eigen::Matrix<double, 6, 1>& mean_square() const { return mean_square_; }

 private:
  using Channels = Eigen::Matrix<double, 6, 1>;
  static constexpr std::size_t kept = 16;  // a power of two
  struct Difference {
    std::int64_t sample = 0;
    Channels value = Channels::Zero();
  };
  void suspect(const ImuSample& sample, const Channels& difference, const Channels& square, const Channels& limit,
               std::vector<DataEvent>& events);
  void drop_corners(std::vector<DataEvent>& events) const;

  double square_ratio_;
  Channels least_square_;                    // below this nothing is a glitch
  Channels mean_square_ = Channels::Zero();  // of d
  Channels last_ = Channels::Zero(), before_last_ = Channels::Zero();
  std::array<Difference, kept> differences_;  // of sample n at n mod kept
  std::uint64_t seen_ = 0;
  int wait_ = 0;                 // samples until suspects are looked at again
  std::size_t unconfirmed_ = 0;  // the first suspect of them in `events`
};

}  // namespace turncal
