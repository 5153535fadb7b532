// Screens the samples as they arrive: spikes that no unit can have measured, glitches, dead or stuck channels, temperatures.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/types/recording_types.h"

namespace turncal {

// Names of the six channels of a sample, gyros first.
inline constexpr std::array<const char*, 6> channel_names = {"gyro x",          "gyro y",          "gyro z",
                                                             "accelerometer x", "accelerometer y", "accelerometer z"};

using Channels = Eigen::Matrix<double, 6, 1>;  // gyro x y z, accelerometer x y z
inline Channels channels_of(const ImuSample& sample) {
  return {sample.gyro[0], sample.gyro[1], sample.gyro[2], sample.accel[0], sample.accel[1], sample.accel[2]};
}

// "glitch: gyro x gave 2147483647 in sample 1500 (7.500 s)"
std::string glitch_of(std::size_t channel, double value, std::int64_t counter, double sample_period_s);

// Finds samples that no unit on a table can have measured, such as a garbled word: a gyro beyond 100 rad/s or an
// accelerometer beyond 200 m/s^2, by the nominal scale, and more than eight times any earlier value of the channel, so
// that a unit whose scale is far from nominal does not look faulty. What lasts for more than five samples is believed.
class SpikeFinder {
 public:
  explicit SpikeFinder(const RecordingInfo& info);
  // Returns the worst channel of an impossible sample; none: it may be true. REQUIRES: samples in order of arrival.
  std::optional<std::size_t> spike_in(const ImuSample& sample);

 private:
  std::array<double, 6> limit_{};    // counts
  std::array<double, 6> largest_{};  // of the samples believed
  int in_a_row_ = 0;
};

// A thermometer inside a unit reads within these; NaN (not measured) passes.
inline constexpr double least_temperature_c = -100.0, most_temperature_c = 200.0;
inline bool temperature_can_be(float temperature_c) {
  return !(double(temperature_c) < least_temperature_c || double(temperature_c) > most_temperature_c);
}

// A fault of the samples, as listed.
struct DataEvent {
  enum class Kind { gap, duplicate, invalid, gyro_glitch, accel_glitch, temperature } kind = Kind::gap;
  std::int64_t sample = 0;  // counter
  std::int64_t count = 1;   // samples concerned
  int axis = -1;            // 0 1 2, or -1
  double size = 0.0;        // glitch: counts above the neighbours, or the value if left out; temperature: C
  bool left_out = false;    // in no block
  bool filled = false;      // gap: short, filled in between the samples beside it (compression.h)
};
const char* to_string(DataEvent::Kind kind);

struct GlitchLimits {
  double ratio = 12.0;       // of the rms second difference
  double counts_min = 20.0;  // nominal pulses
  double most_radps2 = 7.0;  // acceleration of a table
  // For a unit at rest, which nothing accelerates: the minimum is 0 pulses if none are counted, but this many steps of the written numbers.
  double steps_min = 0.0;
  static GlitchLimits at_rest(const RecordingInfo& info);
};

// Finds single samples that stand out from their neighbours. With d_k = x_(k-1) - (x_k + x_(k-2)) / 2 of one channel, sample k-1 is a suspect if
// |d_k| exceeds ratio times the running rms of d (memory of 100 samples) and a minimum: so many nominal pulses, for gyros also the effect of a table
// at 7 rad/s^2, for a unit at rest so many steps. A glitch of g gives d = -g/2, g, -g/2 with sum 0; where a table begins or ends to accelerate, the
// sum is as large as d. So a suspect stays if |sum of d, two before to two behind| < |d| / 2, or while that sum is not known.
// Not modelled: glitches closer than three samples to each other count as one; a glitch in the very corner of a motion is taken for the corner.
class GlitchFinder {
 public:
  GlitchFinder(const RecordingInfo& info, const GlitchLimits& limits);
  // Samples in order of arrival. Appends a suspect to `events`, and removes it two samples later if it was none.
  void add(const ImuSample& sample, std::vector<DataEvent>& events);
  // The next sample has no known neighbours: a turn went on while samples were lost.
  void forget_neighbours(const ImuSample& next);
  // The same at the beginning of a rest, whose first samples also set the usual size of d.
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
  Channels least_square_;                      // minimum of a glitch
  Channels step_ = Channels::Constant(1e300);  // smallest change from one sample to the next
  Channels mean_square_ = Channels::Zero();    // of d
  Channels last_ = Channels::Zero(), before_last_ = Channels::Zero();
  std::array<Difference, kept> differences_;  // that of sample n at n mod k
  std::uint64_t seen_ = 0;
  int wait_ = 0;                 // samples until suspects are checked again
  std::size_t unconfirmed_ = 0;  // index of the first unchecked suspect in `events`
};

// Detects dead and stuck channels: a dead one gives the same value all the time, a stuck one from some sample on. At rest a gyro that counts may well
// repeat itself, so a channel must change while the table turns the unit through a whole circle in total, and for at least 20 s.
// A gyro across the axis of a turn by half circles may give no pulse for minutes: if the other two measure the whole turn, the turn does not test it.
// Nor does a turn in which a channel still changed: an accelerometer may repeat itself from the end of a turn on.
// Not detected: a channel that is stuck for less than that; one that sticks near its true value and still flickers.
class ChannelLife {
 public:
  explicit ChannelLife(const RecordingInfo& info);
  void add(const ImuSample& sample);
  // The table turned the unit by this angle, up to the last sample.
  void turned(double angle_deg);
  // Returns the first defect, in one line; empty: none.
  const std::string& defect() const { return defect_; }
  // Returns the channels that gave one value in all samples, in one line; empty: none. If the unit was turned, they are dead.
  std::string without_change() const;

 private:
  struct Channel {
    double value = 0.0;
    std::int64_t since = 0;  // counter of the first sample with this value
    double turned_deg = 0.0;
    double sum = 0.0;  // since the last call of turned()
  };
  bool says_nothing_of(std::size_t channel, double angle_deg) const;
  double sample_period_s_;
  double gyro_deg_ = 1.0;  // of a count, nominal
  std::array<Channel, 6> channels_{};
  std::int64_t first_ = 0, last_ = 0;
  std::int64_t told_ = 0;  // sample up to which the table's turns are known
  bool any_ = false;
  std::string defect_;
};

// Finds channels that stick at rest, and marks those samples as invalid. A channel that shows noise (one change in twenty samples is larger than
// its step) gives one value for a second, and while twenty such changes are due: by chance less than once in 1e8. What another channel
// measures meanwhile goes with it. Samples come out late, by as many as may yet be found stuck.
// Not found: a coarse channel, which repeats itself at rest anyway; what sticks for a shorter time, or while the unit turns.
class StuckChannels {
 public:
  explicit StuckChannels(double sample_period_s);
  // Appends to `known` the samples of which more is not to be expected, in order.
  void add(const ImuSample& sample, bool at_rest, std::vector<ImuSample>& known);
  void finish(std::vector<ImuSample>& known);
  // A line for each time; of all, or of those that lasted to the last sample.
  std::vector<std::string> found(bool to_the_end = false) const;

 private:
  struct Channel {
    double value = 0.0, step = 1e300;  // step: smallest change
    std::int64_t run = 0;              // samples with this value, in the present rest
    double seen = 0.0, larger = 0.0;   // samples at rest; changes larger than the step
  };
  double sample_period_s_;
  std::array<Channel, 6> channels_{};
  std::vector<ImuSample> held_;
  std::vector<DataEvent> runs_;  // axis: the channel; size: its value
  std::int64_t last_ = 0;        // counter
};

}  // namespace turncal
