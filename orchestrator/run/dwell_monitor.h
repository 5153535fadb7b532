// Decides whether a dwell counts. Pure logic on its samples: none may be missing by the unit's counter or flagged as bad, and the unit has to
// be at rest by its own readings.
//
// Stillness: for each sensor, the means of rate or specific force over consecutive windows of stillness_window_s. Their standard deviation
// over the dwell so far, and the largest deviation of one from their mean, must stay below the configured limits. (A single sample says
// nothing: one pulse of a laser gyro in 5 ms already amounts to 0.05 deg/s.) Judged at the end of every window, so that a knock in a long
// dwell does not cost the rest of it.
//
// A frozen channel is a defect: it gives one number v in n consecutive samples (0.9 s or more), while the N other samples have the mean u, and
//   |v - u| n > 8 sqrt(sigma^2 n (1 + n / N) + r^2)
// sigma: the noise of one sample, from the scatter of the sums of windows, or of tenths of windows when there are fewer than ten windows.
// r: rounding. A sum of pulses is rounded at its two ends only, r^2 = (1 + (n / N)^2) / 6; other numbers at every sample, r = n q / sqrt(12),
// with q the least step seen. So a channel that senses nothing may read zero for as long as it likes. A stretch is judged when it has ended, so
// that the repeated dwell does not begin inside it, or after 30 s; stillness is not judged meanwhile. When the stretches of all six coincide
// (a converter hangs, or a frame is repeated), the sum of their squared deviations in sigmas is judged, too. When such a stretch leaves too
// little to compare with, the changes expected in it, as in the stillest earlier dwell, may not exceed a hundred.
//
// When a single sample spoilt a window, and the unit was still without it, the reason calls that sample a glitch.
//
// Units: counts become deg/s and m/s^2 by the recording's nominal scale factors (start values of calib/model/parameters.h); a scale error of
// a per cent does not matter here. Not judged: whether the table reads another position. That is the caller's task.
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

// Returns the mean per count of a sum over `samples`, by the nominal scale: deg/s for the gyros, m/s^2 for the accelerometers.
std::array<double, 6> mean_per_count(const RecordingInfo& info, std::int64_t samples);

// Running mean and variance, relative to the first number so that a large mean costs no precision.
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
    ErrorKind kind = ErrorKind::device;  // kind of error when no repeat is left
    std::string reason;
  };

  DwellMonitor(const DwellConfig& config, const RecordingInfo& info);

  void start(std::int64_t first_counter, std::int64_t samples);
  // Takes the next samples of the stream. Returns the first defect of the dwell so far.
  const std::optional<Defect>& add(std::span<const ImuSample> samples);

  bool complete() const { return next_counter_ >= first_counter_ + samples_; }
  std::int64_t remaining() const { return first_counter_ + samples_ - next_counter_; }

 private:
  static constexpr int channels = 6;  // gyro x y z, accelerometer x y z
  void close_window();
  bool judge_dead();  // frozen channels; true: one may be frozen, and more samples will tell
  std::string glitch_text(std::size_t channel, double limit) const;

  // The most extreme sample of a window, and the window's mean without it.
  struct Outlier {
    double value = 0.0;
    std::int64_t counter = 0;
    double without = 0.0;
  };
  // Consecutive samples in which a channel gave the same number: the present stretch and the longest one.
  struct Stretch {
    double value = 0.0;
    std::int64_t first = 0, samples = 0;
  };
  struct Channel {
    Stretch now, longest;
    double step = std::numeric_limits<double>::infinity();  // least change between two samples
    // The present window and sums over the closed ones; values are relative to the dwell's first window.
    double window_sum = 0.0, part_sum = 0.0, origin = 0.0, sum = 0.0, square = 0.0, lowest = 0.0, highest = 0.0;
    Outlier least, most;            // of the present window
    Outlier in_lowest, in_highest;  // of the windows with the lowest and the highest mean
  };
  std::optional<Stretch> frozen_together() const;  // overlap of all six channels' longest stretches

  DwellConfig config_;
  bool pulses_[2] = {true, true};        // of gyros, accelerometers
  std::array<double, channels> unit_{};  // deg/s or m/s^2 per count and window
  std::int64_t window_samples_ = 200, part_samples_ = 20;
  double period_s_ = 0.0;
  double stillest_ = 0.0;  // changes per sample, of all channels, in the stillest earlier dwell
  // State of the present dwell.
  std::int64_t first_counter_ = 0, samples_ = 0, next_counter_ = 0;
  std::optional<Defect> defect_;
  std::array<Channel, channels> of_{};
  std::int64_t in_window_ = 0, windows_ = 0, in_part_ = 0;
  std::vector<std::array<double, channels>> parts_;  // sums of the tenths of windows
  std::int64_t changes_ = 0;                         // changes from one sample to the next, of all channels
};

}  // namespace turncal
