#include "calib/statistics/channel_life.h"

#include <cmath>
#include <cstdio>

namespace turncal {

namespace {

constexpr double circle_deg = 360.0;
constexpr double least_s = 20.0;

}  // namespace

void ChannelLife::add(const ImuSample& sample) {
  for (std::size_t i = 0; i < 6; ++i) {
    const double value = channel_of(sample, i);
    if (!any_ || value != channels_[i].value) channels_[i] = {value, sample.counter, 0.0};
  }
  if (!any_) first_ = sample.counter;
  any_ = true;
  last_ = sample.counter;
}

void ChannelLife::turned(double angle_deg) {
  for (std::size_t i = 0; any_ && i < 6; ++i) {
    Channel& channel = channels_[i];
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
}

}  // namespace turncal
