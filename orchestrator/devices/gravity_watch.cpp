#include "orchestrator/devices/gravity_watch.h"

#include <algorithm>
#include <cmath>

namespace turncal {

namespace {

constexpr double half_s = 0.5;
constexpr double still = 0.02;  // of the halves' mean

}  // namespace

GravityWatch::GravityWatch(ImuSource& source, double sample_period_s)
    : source_(source), half_samples_(std::max(1, static_cast<int>(std::lround(half_s / sample_period_s)))) {}

Status GravityWatch::open() {
  count_ = 0;
  sum_ = {};
  last_.reset();
  before_.reset();
  return source_.open();
}

Result<std::size_t> GravityWatch::read(std::span<ImuSample> out, double timeout_s) {
  Result<std::size_t> got = source_.read(out, timeout_s);
  if (!got) return got;
  for (const ImuSample& sample : out.first(*got)) {
    for (std::size_t i = 0; i < 3; ++i) sum_[i] += sample.accel[i];
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
