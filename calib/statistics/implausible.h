// Samples that no unit on a table can have felt: a word that was garbled on its way.
//
// A gyro beyond 100 rad/s or an accelerometer beyond 200 m/s^2, by the nominal scale, and more than eight times what the channel ever gave
// before: so a unit whose scale is far from the nominal one is not taken for faulty. What lasts for more than five samples is believed: it
// is no spike, whatever it is. What is smaller than that is for GlitchFinder to see (glitches.h).
#pragma once

#include <array>
#include <optional>
#include <string>

#include "calib/types/recording_types.h"

namespace turncal {

// Of the six channels of a sample, gyros first.
inline constexpr std::array<const char*, 6> channel_names = {"gyro x",          "gyro y",          "gyro z",
                                                             "accelerometer x", "accelerometer y", "accelerometer z"};
inline double channel_of(const ImuSample& sample, std::size_t channel) {
  return channel < 3 ? sample.gyro[channel] : sample.accel[channel - 3];
}

// "glitch: gyro x gave 2147483647 in sample 1500 (7.500 s)"
std::string glitch_of(std::size_t channel, double value, std::int64_t counter, double sample_period_s);

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
  return !(static_cast<double>(temperature_c) < least_temperature_c ||
           static_cast<double>(temperature_c) > most_temperature_c);
}

}  // namespace turncal
