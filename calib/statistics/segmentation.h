// Finds the rests in a stream of samples by itself, and says by which threshold and why.
//
// The stream is summed in cells of about cell_s. For every window of window_cells cells the variance of the samples
// about their mean is taken, summed over the three axes, for gyros and accelerometers. The quiet level of each triad is
// the median over the quietest fifth of the windows: the sensor's own noise, provided that a tenth of the recording is
// at rest. The ratio
//   R = max(gyro variance / quiet gyro variance, accelerometer variance / quiet accelerometer variance)
// is near 1 at rest and 10 to 10^7 in motion. A hand that holds the unit shakes it, so the threshold cannot follow from
// the noise: it is looked for where the outcome does not depend on it. Of all thresholds from what noise reaches to
// 10^5 times that, in steps of 26 %, the longest stretch over which the number of rests (four or more) stays the same
// is taken, and in it a point near the lower end. A stretch that begins above most_tremor (limits.h) is none: what shakes
// so much moves. Hysteresis: a rest begins where R falls below the threshold and ends where R rises above three times it,
// or stays above the threshold for a whole window. Cells of quiet windows are at rest; guard_s is cut at both ends, where a
// window may still hold the end of a motion; shorter than min_rest_s is no rest. A slow even turn is as quiet as a rest:
// one whose mean rate stands out from the others (by slow_turn_sigmas robust deviations and more than the sample noise) is
// taken out.
//
// What was found verifies itself. Each rest is cut to the longest stretch that stands still, which takes the slow start
// of a turn off its ends. And the quiet level must be noise: the variance of a window about its mean is set against half the mean
// square of the differences of neighbouring samples, 1 for white noise and (2 n / 2 pi)^2 / 2 and the like for a smooth motion that
// turns back within n samples. Where that ratio is above smooth_motion in the gyros' quiet windows, the unit swings: no rest.
//
// Pure function of the samples; memory: 100 bytes a cell. Not modelled: gaps (a cell with one is in motion).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/types/recording_types.h"

namespace turncal {

struct SegmentationOptions {
  double cell_s = 0.1;
  int window_cells = 5;
  double min_rest_s = 1.5;
  double guard_s = 0.3;
  std::optional<double> threshold;  // on R, given and not looked for
};

struct Segmentation {
  Segments segments;        // contiguous over all samples: still and rotate, step 0, angles 0; empty: no rest found
  double threshold = 0.0;   // on R
  double quiet_gyro = 0.0;  // quiet standard deviation a sample and axis, in increments
  double quiet_accel = 0.0;
  double plateau_begin = 0.0;  // thresholds between which the number of rests stays the same
  double plateau_end = 0.0;
  int slow_turns = 0;       // taken out
  int cut = 0;              // rests that were shortened because the unit still moved in them
  int moving = 0;           // taken out: too little of them was still
  double smoothness = 0.0;  // variance over half the mean square difference, gyros, median of the quiet windows
  std::string reason;       // one sentence
};

// Feeds on chunks of a stream; finish() gives the result.
class RestFinder {
 public:
  explicit RestFinder(const RecordingInfo& info, const SegmentationOptions& options = {});
  void add(std::span<const ImuSample> samples);
  Segmentation finish();

 private:
  struct Cell {
    std::int64_t start = 0;
    std::int64_t end = 0;  // counter, exclusive
    std::int32_t samples = 0;
    bool gap = false;
    Eigen::Array<double, 6, 1> sum = Eigen::Array<double, 6, 1>::Zero();  // less the first sample of the stream
    Eigen::Array<double, 6, 1> squares = Eigen::Array<double, 6, 1>::Zero();
    double gyro_changes = 0.0;  // sum of squared differences to the sample before, over the three axes
  };
  struct Window {
    double gyro = 0.0;  // mean variance over the axes
    double accel = 0.0;
    double smoothness = 1.0;  // of the gyros
  };
  struct Run {
    std::size_t first = 0;  // cells
    std::size_t end = 0;
  };
  std::vector<Window> window_variances() const;
  double noise_limit() const;
  void drop_short(std::vector<Run>& runs) const;
  void choose_threshold(const std::vector<double>& ratios, Segmentation& result) const;
  std::vector<Run> runs_below(const std::vector<double>& ratios, double threshold) const;
  void drop_slow_turns(std::vector<Run>& runs, Segmentation& result) const;
  void cut_to_still(std::vector<Run>& runs, Segmentation& result) const;
  Eigen::Vector3d mean_gyro(const Run& run) const;

  SegmentationOptions options_;
  double period_s_;
  int cell_samples_;
  bool have_origin_ = false;
  Eigen::Array<double, 6, 1> origin_ = Eigen::Array<double, 6, 1>::Zero();
  Eigen::Array3d last_gyro_ = Eigen::Array3d::Zero();
  std::int64_t next_ = 0;
  std::vector<Cell> cells_;
};

Segmentation find_rests(const RecordingInfo& info, std::span<const ImuSample> samples,
                        const SegmentationOptions& options = {});

// No segment has a commanded angle: nothing is known of the attitudes but what the sensors say (rest_model.h).
bool without_table_angles(const Segments& segments);

// Which part of a stretch that is said to be at rest really is.
//
// The stretch comes as means over equal pieces, gyros x y z and accelerometers x y z. A piece moves when the mean of it and its two
// neighbours stands more than `outlier` robust standard deviations (1.4826 times the median of absolute deviations of the
// pieces, but not less than their noise) from the median in any channel. What creeps or trembles evenly raises that deviation and
// stays; the start of a turn, a knock or a second turn in the middle stands out. Of what is left the longest stretch counts.
using SixChannels = Eigen::Array<double, 6, 1>;

struct StillPart {
  std::size_t first = 0;
  std::size_t end = 0;  // exclusive; equal to first: nothing is still
};

// `noise`: standard deviation of a piece by sensor noise alone. Fewer than five pieces are taken as they are.
StillPart longest_still(std::span<const SixChannels> pieces, const SixChannels& noise, double outlier = 8.0);

}  // namespace turncal
