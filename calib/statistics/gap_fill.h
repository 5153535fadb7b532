// A few lost samples filled in between those that came, and how wrong that may be.
//
// At rest, with n lost: each is the mean m of the last `memory` samples. What the unit counted meanwhile is a whole number of pulses: the
// variance of the n together is f (1 - f), f the fraction of n m, and 1/6 at least, that of rounding both ends of a noisy count; but never more
// than n times the variance of those samples, which it is where increments are no pulses. That of n m comes on top.
// In a turn: linear between the increments x_a before and x_b after. With D the mean square of x_k - (x_(k-1) + x_(k+1)) / 2 where nothing
// is lost (GlitchFinder), of which a sample's noise is two thirds, the variance of the sum is (n + n^2 / 2) 2 D / 3. Where the slope
// changes across the gap by c with c^2 > 20 D, a corner of the motion fell into it: n^2 c^2 more.
// Not modelled: motion that comes and goes within the gap.
#pragma once

#include <array>
#include <cstdint>

#include <Eigen/Core>

#include "calib/types/recording_types.h"

namespace turncal {

struct GapFill {
  Eigen::Vector3d gyro_first, gyro_step, accel_first,
      accel_step;                                 // increments: of the first one, and from one to the next
  Eigen::Vector3d gyro_variance, accel_variance;  // of the sum, increments squared
};

class GapFiller {
 public:
  explicit GapFiller(const RecordingInfo& info)
      : counted_{info.gyro_increment == IncrementKind::pulses, info.accel_increment == IncrementKind::pulses} {}
  void begin_segment() { seen_ = 0; }
  void add(const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel) {
    Channels& at = samples_[seen_++ % memory];
    at.head<3>() = gyro;
    at.tail<3>() = accel;
  }
  // Between the last sample and `next`, of the same segment. `mean_square`: D of gyro x y z, accelerometer x y z.
  GapFill fill(const ImuSample& next, std::int64_t lost, bool at_rest,
               const Eigen::Matrix<double, 6, 1>& mean_square) const;
  // Two samples of the segment have come.
  bool can_fill() const { return seen_ >= 2; }

 private:
  static constexpr std::size_t memory = 32;
  using Channels = Eigen::Matrix<double, 6, 1>;

  const std::array<bool, 2> counted_;  // gyro, accelerometer increments are whole numbers
  std::array<Channels, memory> samples_;
  std::size_t seen_ = 0;
};

}  // namespace turncal
