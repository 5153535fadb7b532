#include "orchestrator/devices/gravity_watch.h"

#include <algorithm>
#include <cmath>

#include "calib/model/parameters.h"

namespace turncal {

namespace {

constexpr double half_s = 0.5;
constexpr std::int64_t longest_gap = 2000;  // samples; behind a longer one nobody knows
constexpr double still = 0.02;              // of the halves' mean

}  // namespace

GravityWatch::GravityWatch(ImuSource& source, double sample_period_s)
    : source_(source), half_samples_(std::max(1, static_cast<int>(std::lround(half_s / sample_period_s)))) {}

Status GravityWatch::open() {
  count_ = 0;
  sum_ = {};
  last_.reset();
  before_.reset();
  counter_.reset();
  RecordingInfo info;
  source_.describe(info);
  deg_per_count_ = nominal_gyro_rad(info) / rad_per_deg;
  return source_.open();
}

Result<std::size_t> GravityWatch::read(std::span<ImuSample> out, double timeout_s) {
  Result<std::size_t> got = source_.read(out, timeout_s);
  if (!got) return got;
  for (const ImuSample& sample : out.first(*got)) {
    const std::int64_t steps =
        counter_ ? std::clamp<std::int64_t>(sample.counter - *counter_, 1, longest_gap) : std::int64_t{1};
    counter_ = sample.counter;
    for (std::size_t i = 0; i < 3; ++i) {
      sum_[i] += sample.accel[i];
      turned_[i] += deg_per_count_ * sample.gyro[i] * static_cast<double>(steps);
    }
    if (++count_ < half_samples_) continue;
    for (double& value : sum_) value /= half_samples_;
    before_ = last_;
    last_ = sum_;
    sum_ = {};
    count_ = 0;
  }
  return got;
}

std::optional<std::array<double, 3>> GravityWatch::mean() const {
  if (!last_ || !before_) return {};
  std::array<double, 3> mean{};
  double size = 0.0, difference = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    mean[i] = 0.5 * ((*last_)[i] + (*before_)[i]);
    size += mean[i] * mean[i];
    difference += std::pow((*last_)[i] - (*before_)[i], 2);
  }
  if (!(std::sqrt(difference) <= still * std::sqrt(size))) return {};
  return mean;
}

}  // namespace turncal
