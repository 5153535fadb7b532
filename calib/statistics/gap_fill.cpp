#include "calib/statistics/gap_fill.h"

#include <algorithm>
#include <cmath>

namespace turncal {

GapFill GapFiller::fill(const ImuSample& next, std::int64_t lost, bool at_rest,
                        const Eigen::Matrix<double, 6, 1>& mean_square) const {
  const auto n = static_cast<double>(lost);
  Channels first, step, variance;
  if (at_rest && seen_ >= memory) {
    Channels square = Channels::Zero();
    first.setZero();
    for (const Channels& sample : samples_) first += sample / static_cast<double>(memory);
    for (const Channels& sample : samples_) square += (sample - first).cwiseAbs2() / static_cast<double>(memory - 1);
    step.setZero();
    for (int k = 0; k < 6; ++k) {
      const double part = n * first[k] - std::floor(n * first[k]);
      constexpr double of_rounding = 1.0 / 6.0;  // of two ends that noise puts anywhere
      variance[k] = n * square[k];
      if (counted_[static_cast<std::size_t>(k / 3)])
        variance[k] = std::min(variance[k], std::max(part * (1.0 - part), of_rounding));
      variance[k] += n * n * square[k] / static_cast<double>(memory);
    }
  } else {
    constexpr double corner = 20.0;  // one in 300 of white noise, whose changes of slope are 7/3 of D
    const Channels& last = samples_[(seen_ - 1) % memory];
    const Channels& before = samples_[(seen_ - 2) % memory];
    Channels after;
    after << next.gyro[0], next.gyro[1], next.gyro[2], next.accel[0], next.accel[1], next.accel[2];
    step = (after - last) / (n + 1.0);
    first = last + step;
    const Channels change = (step - (last - before)).cwiseAbs2();
    for (int k = 0; k < 6; ++k)
      variance[k] =
          (n + 0.5 * n * n) * mean_square[k] / 1.5 + (change[k] > corner * mean_square[k] ? n * n * change[k] : 0.0);
  }
  return {first.head<3>(), step.head<3>(), first.tail<3>(), step.tail<3>(), variance.head<3>(), variance.tail<3>()};
}

}  // namespace turncal
