// One screen of the samples as they come: spikes that no unit can have felt, glitches, channels that are dead or stuck, temperatures.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/types/recording_types.h"

namespace turncal {

// Of the six channels of a sample, gyros first.
inline constexpr std::array<const char*, 6> channel_names = {"gyro x",          "gyro y",          "gyro z",
                                                             "accelerometer x", "accelerometer y", "accelerometer z"};

using Channels = Eigen::Matrix<double, 6, 1>;  // gyro x y z, accelerometer x y z
inline Channels channels_of(const ImuSample& sample) {
  return {sample.gyro[0], sample.gyro[1], sample.gyro[2], sample.accel[0], sample.accel[1], sample.accel[2]};
}

// "glitch: gyro x gave 2147483647 in sample 1500 (7.500 s)"
std::string glitch_of(std::size_t channel, double value, std::int64_t counter, double sample_period_s);

// Samples that no unit on a table can have felt: a word that was garbled on its way. A gyro beyond 100 rad/s or an accelerometer beyond
// 200 m/s^2, by the nominal scale, and more than eight times what the channel ever gave before: so a unit whose scale is far from the
// nominal one is not taken for faulty. What lasts for more than five samples is believed.
class SpikeFinder {
 public:
  explicit SpikeFinder(const RecordingInfo& info);
  // The worst channel of a sample that cannot be; nothing: it may be true. Samples in the order in which they came.
  std::optional<std::size_t> spike_in(const ImuSample& sample);

 private:
  std::array<double, 6> limit_{};    // counts
  std::array<double, 6> largest_{};  // of those believed
  int in_a_row_ = 0;
};

// A thermometer inside a unit shows no more and no less than this; NaN (not measured) is fine.
inline constexpr double least_temperature_c = -100.0, most_temperature_c = 200.0;
inline bool temperature_can_be(float temperature_c) {
  return !(double(temperature_c) < least_temperature_c || double(temperature_c) > most_temperature_c);
}

// What is wrong with the samples, as it is listed.
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
  double most_radps2 = 7.0;  // what a table accelerates by
  // Of a unit at rest, which nothing accelerates: no pulses where none are counted, but so many of the steps in which numbers are written.
  double steps_min = 0.0;
  static GlitchLimits at_rest(const RecordingInfo& info);
};

// Single samples that stand out from their neighbours. With d_k = x_(k-1) - (x_k + x_(k-2)) / 2 of one channel sample k-1 is suspected when
// |d_k| is above ratio times the running rms of d (memory of 100 samples) and above a least value: so many nominal pulses, and of gyros what
// a table of 7 rad/s^2 does; of a unit at rest as many steps. A glitch of g gives d = -g/2, g, -g/2 with sum 0; where a table begins or
// ends to accelerate the sum is as large as d. So a suspect stays when |sum of d, two before to two behind| < |d| / 2, or where that is not
// known yet.
// Not modelled: glitches closer than three samples to each other are one; a glitch in the very corner of a motion is taken for it.
class GlitchFinder {
 public:
  GlitchFinder(const RecordingInfo& info, const GlitchLimits& limits);
  // Samples in the order in which they came. A suspect is put at the end of `events`, and taken away again two samples later where it was none.
  void add(const ImuSample& sample, std::vector<DataEvent>& events);
  // The next sample's neighbours are not known: a turn went on while samples were lost.
  void forget_neighbours(const ImuSample& next);
  // The same at the beginning of a rest, whose first samples say what is usual, too.
  void begin_rest(std::span<const ImuSample> first);
  // Mean square of d over the last 100 samples or so, increments squared.
  const Channels& mean_square() const { return mean_square_; }

 private:
  static constexpr std::size_t kept = 16;  // a power of two
  struct Difference {
    std::int64_t sample = 0;
    Channels value = Channels::Zero();
  };
  void suspect(const ImuSample& sample, const Channels& difference, const Channels& square, const Channels& limit,
               std::vector<DataEvent>& events);
  void learn_step(const Channels& change);
  void drop_corners(std::vector<DataEvent>& events) const;

  double square_ratio_;
  double steps_min_;
  Channels least_square_;                      // below this nothing is a glitch
  Channels step_ = Channels::Constant(1e300);  // the least change from one sample to the next
  Channels mean_square_ = Channels::Zero();    // of d
  Channels last_ = Channels::Zero(), before_last_ = Channels::Zero();
  std::array<Difference, kept> differences_;  // of sample n at n mod kept
  std::uint64_t seen_ = 0;
  int wait_ = 0;                 // samples until suspects are looked at again
  std::size_t unconfirmed_ = 0;  // the first suspect of them in `events`
};

// Does every channel live? A dead one gives the same value all the time, a stuck one does from some sample on. At rest a gyro that counts may
// well repeat itself, so a channel is asked to change while the table turns the unit: through a whole circle in all, and for 20 s at least.
// A gyro across the axis of a turn by half circles may give no pulse for minutes: where the other two feel the turn whole, it says nothing
// of the third. Nor does a turn in which a channel still changed: an accelerometer may repeat itself from the end of a turn on.
// Not seen: a channel that is stuck for less than that; one that sticks near its true value and still flickers.
class ChannelLife {
 public:
  explicit ChannelLife(const RecordingInfo& info);
  void add(const ImuSample& sample);
  // The table turned the unit by so much, up to the last sample.
  void turned(double angle_deg);
  // What was found first, in one line; empty: nothing.
  const std::string& defect() const { return defect_; }
  // The channels that gave one value in all samples, in one line; empty: none. Of a unit that was turned these are dead.
  std::string without_change() const;

 private:
  struct Channel {
    double value = 0.0;
    std::int64_t since = 0;  // counter of the first sample with this value
    double turned_deg = 0.0;
    double sum = 0.0;  // since the table's last turn was told
  };
  bool says_nothing_of(std::size_t channel, double angle_deg) const;
  double sample_period_s_;
  double gyro_deg_ = 1.0;  // of a count, nominally
  std::array<Channel, 6> channels_{};
  std::int64_t first_ = 0, last_ = 0;
  std::int64_t told_ = 0;  // up to which the table's turns are known
  bool any_ = false;
  std::string defect_;
};

}  // namespace turncal
