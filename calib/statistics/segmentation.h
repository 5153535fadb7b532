// Finds the rests in a stream of samples, and reports the threshold and its reason.
//
// The stream is summed in cells of about cell_s. In every window of window_cells cells the variance of the samples about their mean is
// taken over the three axes of each triad. The quiet level is the median over the quietest fifth of the windows (a tenth of the recording
// must be at rest). R = max over gyros and accelerometers of variance / quiet variance is near 1 at rest, 10 to 10^7 in motion. A hand that
// holds the unit shakes it, so the threshold does not follow from the noise. Of thresholds from the level that noise reaches to 10^5 times
// that, in steps of 26 %, the longest stretch is taken over which the number of rests (four or more) stays the same and that begins below
// most_tremor (limits.h); the threshold lies near its lower end. A rest ends where R rises above three times the threshold or stays above
// it for a window; guard_s is cut off both ends; anything shorter than min_rest_s is no rest. A slow even turn is as quiet as a rest: a
// run is taken for one if its mean rate stands out by slow_turn_sigmas robust deviations and the sample noise.
//
// The result is verified: each rest is cut to its longest still stretch (longest_still), and the quiet level must be noise. Variance over
// half the mean square difference of neighbouring samples is 1 for white noise, more for a smooth motion; above smooth_motion the unit
// swings and never rests.
//
// Pure function of the samples; memory: 100 bytes a cell. Not modelled: gaps longer than a cell, which count as motion.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/types/recording_types.h"

namespace turncal {

using SixChannels = Eigen::Array<double, 6, 1>;  // gyro x y z, accelerometer x y z

struct SegmentationOptions {
  double cell_s = 0.1;
  int window_cells = 5;
  double min_rest_s = 1.5;
  double guard_s = 0.3;
  std::optional<double> threshold = {};  // on R; given: not searched for
};

struct Segmentation {
  Segments segments;        // contiguous over all samples: still and rotate, step 0, angles 0; empty: no rest found
  double threshold = 0.0;   // on R
  double quiet_gyro = 0.0;  // quiet standard deviation of a sample, per axis, in increments
  double quiet_accel = 0.0;
  double plateau_begin = 0.0;  // thresholds between which the number of rests stays the same
  double plateau_end = 0.0;
  int slow_turns = 0;       // runs dropped
  int cut = 0;              // rests shortened because the unit still moved in them
  int moving = 0;           // rests dropped: too little of them was still
  double smoothness = 0.0;  // variance over half the mean square difference, gyros, median of the quiet windows
  std::string reason;       // one sentence
};

// Takes chunks of a stream; finish() returns the result.
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
    SixChannels sum = SixChannels::Zero();  // less the first sample of the stream
    SixChannels squares = SixChannels::Zero();
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
  std::int64_t samples_in(double seconds) const { return std::llround(seconds / period_s_); }
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
  SixChannels origin_ = SixChannels::Zero();
  Eigen::Array3d last_gyro_ = Eigen::Array3d::Zero();
  std::int64_t next_ = 0;
  std::vector<Cell> cells_;
};

// No segment has a commanded angle: only the sensors tell the attitudes (rest_model.h).
bool without_table_angles(const Segments& segments);

// The part of a nominal rest that is still. Of means over equal pieces, one moves if the mean of it and its two neighbours is more than
// `outlier` robust standard deviations (1.4826 times the median absolute deviation, at least their noise) from the median in any channel.
// Even creep or tremor stays; the start of a turn or a knock stands out. The longest still stretch is returned.
struct StillPart {
  std::size_t first = 0;
  std::size_t end = 0;  // exclusive; equal to first: nothing is still
};

// `noise`: standard deviation of a piece by sensor noise alone. Fewer than five pieces are returned whole.
StillPart longest_still(std::span<const SixChannels> pieces, const SixChannels& noise, double outlier = 8.0);

}  // namespace turncal
