#include "calib/statistics/channel_life.h"

#include <cmath>
#include <cstdio>

#include "calib/model/parameters.h"

namespace turncal {

namespace {

constexpr double circle_deg = 360.0;
constexpr double least_s = 20.0;
// Of a turn that two gyros feel: the third may be 25 deg off its axis, and then feels some of it.
constexpr double whole = 0.9;

}  // namespace

ChannelLife::ChannelLife(const RecordingInfo& info)
    : sample_period_s_(info.sample_period_s), gyro_deg_(nominal_gyro_rad(info) / rad_per_deg) {}

bool ChannelLife::says_nothing_of(std::size_t channel, double angle_deg) const {
  constexpr double half_deg = 180.0, near_deg = 10.0;
  if (channel >= 3 || std::abs(std::remainder(angle_deg, half_deg)) > near_deg) return false;
  const double a = channels_[(channel + 1) % 3].sum, b = channels_[(channel + 2) % 3].sum;
  return gyro_deg_ * std::hypot(a, b) > whole * std::abs(angle_deg);
}

void ChannelLife::add(const ImuSample& sample) {
  for (std::size_t i = 0; i < 6; ++i) {
    const double value = channel_of(sample, i);
    channels_[i].sum += value;
    if (!any_ || value != channels_[i].value) channels_[i] = {value, sample.counter, 0.0, channels_[i].sum};
  }
  if (!any_) first_ = told_ = sample.counter;
  any_ = true;
  last_ = sample.counter;
}

void ChannelLife::turned(double angle_deg) {
  for (std::size_t i = 0; any_ && i < 6; ++i) {
    Channel& channel = channels_[i];
    if (channel.since > told_ || says_nothing_of(i, angle_deg)) continue;
    channel.turned_deg += std::abs(angle_deg);
    const double lasted_s = static_cast<double>(last_ - channel.since) * sample_period_s_;
    if (!defect_.empty() || channel.turned_deg < circle_deg || lasted_s < least_s) continue;
    char text[240];
    std::snprintf(text, sizeof text,
                  "%s is %s: from sample %lld on (%.1f s) it gave the same value, %.6g, for %.0f s in which the table "
                  "turned the unit by %.0f deg",
                  channel_names[i], channel.since == first_ ? "dead" : "stuck", static_cast<long long>(channel.since),
                  static_cast<double>(channel.since - first_) * sample_period_s_, channel.value, lasted_s,
                  channel.turned_deg);
    defect_ = text;
  }
  for (Channel& channel : channels_) channel.sum = 0.0;
  told_ = last_;
}

}  // namespace turncal
