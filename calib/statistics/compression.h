// Sufficient statistics of a recording, on which the estimators iterate instead of raw samples.
//
// The stream is cut into blocks that never cross a segment border: a second each in static segments (less if the unit was moved
// by more than static_angle_rad); in rotations as many samples as turn the unit by about block_angle_rad (at most block_samples,
// more at a steady rate). The sums of a block are in raw counts, so that its motion can be evaluated exactly for any parameters
// (block_motion.h). One pass; about 0.25 kB a block, 4 MB for the fourteen steps, 25 ns a sample.
//
// With alpha_i, beta_i the increments of sample i (gyro, accelerometer), theta_i = sum of alpha_j, j < i, and
// s_i the time of the middle of sample i from the start of the block:
//   gyro = sum alpha_i, accel = sum beta_i, gyro_time = sum s_i alpha_i, accel_time = sum s_i beta_i
//   coning = sum [theta_i x alpha_i + k_i (alpha_{i-1} x alpha_i + alpha_i x alpha_{i+1}) / 12]
//   sculling = sum [(theta_i + alpha_i/2) beta_i' + k_i (K_{i-1} + K_i) / 24]   (3x3),   K_i = alpha_i beta_{i+1}' - alpha_{i+1} beta_i'
//   k_i = 1 + 11/60 |alpha_i|^2  (rad, nominal)
// The motion within a sample is inferred from the samples on both sides. (Savage (1998) uses the one before alone, which leaves
// r^3 / 24 of a force that stands still while the unit turns by r a sample.) Both sides leave r^4 / 66; k is the exact sum for an
// even rate over that of three samples, to r^2: r^6 / 500 is left, 1e-7 of the force at 0.2 rad a sample. The last sample of a
// block is completed when the next one arrives; beside lost samples, and at both ends of a recording, that half is missing.
//
// Data faults are detected here and listed as events; the estimator decides what to do about them. A sample that cannot
// be true (data_screen.h) is dropped as if it had not arrived. A few samples lost inside a segment are filled in, and
// the variance of that is kept. An impossible temperature counts as not measured.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "calib/statistics/data_screen.h"
#include "calib/types/recording_types.h"

namespace turncal {

struct BlockState;  // calib/model/effects.h

// Fills in a few lost samples between those that arrived, with the variance of the error.
// At rest, with n lost: each is the mean m of the last `memory` samples. The true sum is a whole number of pulses: its variance is f (1 - f), f the
// fraction of n m, but at least 1/6 (rounding at both ends of a noisy count), and at most n times the variance of those samples; that maximum for
// increments that are no pulses. The variance of n m is added.
// In a turn: linear between the increments beside the gap. With D the mean square of x_k - (x_(k-1) + x_(k+1)) / 2 (GlitchFinder) the variance of the
// sum is (n + n^2 / 2) 2 D / 3. A slope that changes across the gap by c with c^2 > 20 D adds n^2 c^2: a corner fell into it.
// Not modelled: motion that comes and goes within the gap.
struct GapFill {
  Channels first, step;  // increments: the first one, and the difference from one to the next
  Channels variance;     // of the sum, increments squared
};

class GapFiller {
 public:
  explicit GapFiller(const RecordingInfo& info)
      : counted_{info.gyro_increment == IncrementKind::pulses, info.accel_increment == IncrementKind::pulses} {}
  void begin_segment() { seen_ = 0; }
  void add(const Channels& sample) { samples_[seen_++ % memory] = sample; }
  // Fills between the last sample and `next`, of the same segment. `mean_square`: D.
  GapFill fill(const ImuSample& next, std::int64_t lost, bool at_rest, const Channels& mean_square) const;
  // Have two samples of the segment arrived?
  bool can_fill() const { return seen_ >= 2; }

 private:
  static constexpr std::size_t memory = 32;

  const std::array<bool, 2> counted_;  // gyro, accelerometer increments are whole numbers
  std::array<Channels, memory> samples_;
  std::size_t seen_ = 0;
};

struct Block {
  std::int64_t start_sample = 0;          // the unit's counter at the first sample
  std::int32_t samples = 0;               // samples summed, filled-in ones included
  std::int32_t missing = 0;               // missing inside or directly before it by the counter, and not filled in
  std::int32_t segment = 0;               // index into CompressedRecording::segments
  bool whole_second = false;              // static, with the length of a static second
  float temperature_c = 0.0F;             // mean; NaN when not measured
  float temperature_rate_c_per_h = 0.0F;  // dT/dt in its middle; 0 when not measured
  Eigen::Vector3f gyro_filled = Eigen::Vector3f::Zero();   // variance of the sums by the samples that were filled in,
  Eigen::Vector3f accel_filled = Eigen::Vector3f::Zero();  // increments squared
  double duration_s = 0.0;                                 // (samples + missing) * period
  Eigen::Vector3d gyro_at_start =
      Eigen::Vector3d::Zero();  // increments a sample where it begins: mean of the samples on either side
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();
  Eigen::Vector3d gyro_time = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_time = Eigen::Vector3d::Zero();
  Eigen::Vector3d coning = Eigen::Vector3d::Zero();
  Eigen::Matrix3d sculling = Eigen::Matrix3d::Zero();
};

// Sets what regressors see of a block's temperature: its excess over the reference, and its rate; 0 if not measured.
void take_temperature(const Block& block, double reference_c, BlockState& state);

// Returns the block that two consecutive blocks make together (exact).
Block merge(const Block& first, const Block& second);

struct CompressedRecording {
  RecordingInfo info;
  Segments segments;          // in order of arrival, contiguous
  std::vector<Block> blocks;  // in time order
  std::vector<DataEvent> events;
  std::int64_t samples = 0;
  double mean_temperature_c = 0.0;  // over all samples; NaN when not measured

  bool rotates(const Block& block) const { return segments[block.segment].kind == SegmentKind::rotate; }
  // Returns the time of the middle of a block, from the first sample of block `from`.
  double middle_s(const Block& block, std::size_t from = 0) const {
    return double(block.start_sample - blocks[from].start_sample) * info.sample_period_s + 0.5 * block.duration_s;
  }
};

struct CompressionOptions {
  double static_block_s = 1.0;
  double static_angle_rad = 0.1;
  double block_angle_rad = 0.012;
  int block_samples = 20;
  GlitchLimits glitch;
  bool leaves_out_turning = true;  // blocks that still turn in a rest do not count as rest
};

class Compressor {
 public:
  explicit Compressor(const RecordingInfo& info, const CompressionOptions& options = {});
  // Segments must follow one another without a hole; samples belong to the segment begun last. end_segment may change
  // the kind: a dwell that did not count is closed as SegmentKind::rotate.
  void begin_segment(const Segment& segment);
  void add(std::span<const ImuSample> samples);
  void end_segment(SegmentKind final_kind, std::int64_t end_sample);
  // The recording so far; after take() it is moved from.
  const CompressedRecording& recording() const { return recording_; }
  CompressedRecording take();

 private:
  void close_block();
  void add_one(const ImuSample& sample);
  void add_to_closed_block(const Eigen::Vector3d& alpha, const Eigen::Vector3d& beta);
  // Returns k / 24, bounded above: beyond a radian a sample the series does not hold (gyros of another unit).
  double within_sample(const Eigen::Vector3d& alpha) const {
    return std::min((1.0 + square_of_even_rate_ * alpha.squaredNorm()) / 24.0, 0.05);
  }
  void open_block(std::int64_t counter, std::int32_t missing);
  void add_sums(const Eigen::Vector3d& alpha, const Eigen::Vector3d& beta, bool behind_a_gap);
  void close_full_block();
  bool fill(const ImuSample& next, std::int64_t gap);
  bool leave_out(const ImuSample& sample);
  void add_temperature(const ImuSample& sample);

  CompressionOptions options_;
  CompressedRecording recording_;
  Block block_;
  bool in_segment_ = false;
  int static_block_samples_ = 200;
  double static_counts_ = 0.0;        // |sum alpha| at which a static block closes early, in counts
  double rotation_counts_ = 0.0;      // the same for a rotation block
  double square_of_even_rate_ = 0.0;  // (k - 1) / |alpha|^2, alpha in counts
  std::int64_t next_counter_ = 0;
  SpikeFinder spikes_;
  std::int64_t left_out_ = 0;                   // samples since the last accepted one
  std::ptrdiff_t impossible_temperature_ = -1;  // index of its event
  bool have_previous_ = false;
  Eigen::Vector3d previous_gyro_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d previous_accel_ = Eigen::Vector3d::Zero();
  GapFiller filler_;
  double temperature_sum_ = 0.0;    // over the block
  double temperature_total_ = 0.0;  // over the recording
  std::int64_t temperature_count_ = 0;
  GlitchFinder glitches_;
};

// Feeds a stream of sample chunks to a Compressor, and opens and closes the listed segments.
class SegmentedFeed {
 public:
  SegmentedFeed(Compressor& compressor, const Segments& segments) : compressor_(compressor), segments_(segments) {}
  void add(std::span<const ImuSample> samples);
  void finish();

 private:
  Compressor& compressor_;
  const Segments& segments_;
  std::size_t index_ = 0;
  bool open_ = false;
};

}  // namespace turncal
