// Does a dwell count? Pure logic on its samples: counted by the unit's counter, every sample there and good, and the unit
// at rest by its own account.
//
// Stillness: the mean rate and mean specific force of each sensor over consecutive windows of stillness_window_s; their
// standard deviation over the dwell so far and the largest distance of one from the mean of all must stay below the
// configured limits (a single sample says nothing: one pulse of a laser gyro in 5 ms is already 0.05 deg/s). Judged at
// the end of every window, so that a knock in a long dwell does not cost the rest of it.
//
// Nor may a channel give one and the same number v in n samples, 0.9 s or longer, where the N others of the dwell have the mean u:
//   |v - u| n > 8 sqrt(sigma^2 n (1 + n / N) + r^2)
// sigma: the noise of a sample, by the scatter of the sums of windows, or, where there are not ten, of their tenths. r: what rounding may do:
// pulses of a running sum are off by the two ends, r^2 = (1 + (n / N)^2) / 6; numbers by each, r = n q / sqrt(12), q the least step seen. A
// channel that feels nothing may so read zero for as long as it likes. A stretch is judged when it has ended, so that the dwell is not begun
// again into it, or after 30 s; meanwhile nothing is said of stillness. Where the stretches of all six are one (a converter hangs, or a frame is
// sent again), the sum of their squares in sigmas is judged; where nothing of the dwell is left beside it, it may not last for so long that
// the channels would have changed a hundred times as in the stillest dwell before.
//
// One sample alone may have spoilt a window: when the unit was still without it, the reason names it as a glitch.
//
// Units: counts become deg/s and m/s^2 by the nominal scale factors of the recording (start values of calib/model/parameters.h);
// a per cent of scale error does not matter here. That the table reads elsewhere is the caller's to see.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

// What a count in the sum over so many samples is of their mean, by the nominal scale: deg/s of the gyros, m/s^2 of the accelerometers.
std::array<double, 6> mean_per_count(const RecordingInfo& info, std::int64_t samples);

// Mean and variance of numbers as they come; relative to the first, so that nothing is lost to a large mean.
struct Scatter {
  void add(double value) {
    if (count == 0) first = value;
    sum += value - first;
    squares += (value - first) * (value - first);
    ++count;
  }
  double mean() const { return first + sum / double(count); }
  double variance() const {
    const double n = double(count);
    return std::max(0.0, squares - sum * sum / n) / (n - 1.0);
  }
  double first = 0.0, sum = 0.0, squares = 0.0;
  std::size_t count = 0;
};

class DwellMonitor {
 public:
  struct Defect {
    ErrorKind kind = ErrorKind::device;  // what it means when no repeat is left
    std::string reason;
  };

  DwellMonitor(const DwellConfig& config, const RecordingInfo& info);

  void start(std::int64_t first_counter, std::int64_t samples);
  // The next samples of the stream. The first defect, if there is one so far.
  const std::optional<Defect>& add(std::span<const ImuSample> samples);

  bool complete() const { return next_counter_ >= first_counter_ + samples_; }
  std::int64_t remaining() const { return first_counter_ + samples_ - next_counter_; }

 private:
  static constexpr int channels = 6;  // gyro x y z, accelerometer x y z
  void close_window();
  bool judge_dead();  // channels that stood still; true: one may have, and more samples will tell
  std::string glitch_text(std::size_t channel, double limit) const;

  // The sample of a window that stands out most, and where the window's mean would be without it.
  struct Outlier {
    double value = 0.0;
    std::int64_t counter = 0;
    double without = 0.0;
  };
  // Samples in a row in which a channel gave one number alone: those that go on, and the longest.
  struct Stretch {
    double value = 0.0;
    std::int64_t first = 0, samples = 0;
  };
  struct Channel {
    Stretch now, longest;
    double step = std::numeric_limits<double>::infinity();  // the least from sample to sample
    // The running window, and what the closed ones sum up to; values relative to the first window of the dwell.
    double window_sum = 0.0, part_sum = 0.0, origin = 0.0, sum = 0.0, square = 0.0, lowest = 0.0, highest = 0.0;
    Outlier least, most;            // of the running window
    Outlier in_lowest, in_highest;  // of the windows with the lowest and the highest mean
  };
  std::optional<Stretch> frozen_together() const;  // the longest stretches of all six, where they are one

  DwellConfig config_;
  bool pulses_[2] = {true, true};        // of gyros, accelerometers
  std::array<double, channels> unit_{};  // deg/s or m/s^2 per count and window
  std::int64_t window_samples_ = 200, part_samples_ = 20;
  double period_s_ = 0.0;
  double stillest_ = 0.0;  // changes per sample, the fewest of an earlier dwell
  // Of the dwell.
  std::int64_t first_counter_ = 0, samples_ = 0, next_counter_ = 0;
  std::optional<Defect> defect_;
  std::array<Channel, channels> of_{};
  std::int64_t in_window_ = 0, windows_ = 0, in_part_ = 0;
  std::vector<std::array<double, channels>> parts_;  // sums of the tenths of windows
  std::int64_t changes_ = 0;                         // of a channel, from one sample to the next
};

}  // namespace turncal
