#include "calib/statistics/implausible.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/model/parameters.h"

namespace turncal {

namespace {

constexpr double most_radps = 100.0, most_mps2 = 200.0;
constexpr double beyond_all_before = 8.0;
constexpr int longest_spike = 5;

}  // namespace

std::string glitch_of(std::size_t channel, double value, std::int64_t counter, double sample_period_s) {
  char text[120];
  std::snprintf(text, sizeof text, "glitch: %s gave %.10g in sample %lld (%.3f s)", channel_names[channel], value,
                static_cast<long long>(counter), static_cast<double>(counter) * sample_period_s);
  return text;
}

SpikeFinder::SpikeFinder(const RecordingInfo& info) {
  const SensorModel model = sensor_model(start_parameters(info), info);
  for (std::size_t i = 0; i < 6; ++i)
    limit_[i] =
        info.sample_period_s * (i < 3 ? most_radps / model.gyro_scale(0, 0) : most_mps2 / model.accel_scale(0, 0));
}

std::optional<std::size_t> SpikeFinder::spike_in(const ImuSample& sample) {
  std::array<double, 6> size;
  bool within = true;
  for (std::size_t i = 0; i < 3; ++i) {
    size[i] = std::abs(sample.gyro[i]);
    size[i + 3] = std::abs(sample.accel[i]);
  }
  for (std::size_t i = 0; i < 6; ++i) within &= size[i] <= limit_[i];
  if (within) {  // as nearly all are
    for (std::size_t i = 0; i < 6; ++i) largest_[i] = std::max(largest_[i], size[i]);
    in_a_row_ = 0;
    return {};
  }
  std::optional<std::size_t> worst;
  double beyond = 1.0;
  for (std::size_t i = 0; i < 6; ++i) {
    const double ratio = size[i] / std::max(limit_[i], beyond_all_before * largest_[i]);
    if (!(ratio > beyond)) continue;
    beyond = ratio;
    worst = i;
  }
  in_a_row_ = worst ? in_a_row_ + 1 : 0;
  if (in_a_row_ > longest_spike) worst.reset();
  if (!worst)
    for (std::size_t i = 0; i < 6; ++i) largest_[i] = std::max(largest_[i], size[i]);
  return worst;
}

}  // namespace turncal
