#include "calib/statistics/glitches.h"

#include <algorithm>
#include <cmath>

#include "calib/model/parameters.h"

namespace turncal {
namespace {

constexpr double nominal_gyro_pulse_rad = 0.932920 * rad_per_arcsec;  // of one count, before anything is measured
constexpr double most_radps2 = 7.0;                                   // what a table accelerates by
constexpr double nominal_accel_pulse_mps = 0.0005;                    // where the increments are not counted
constexpr std::uint64_t settled = 50;                                 // samples until the rms is known
constexpr double memory = 0.01;                                       // weight of one sample in it
constexpr int behind = 2;

Eigen::Matrix<double, 6, 1> channels_of(const ImuSample& sample) {
  Eigen::Matrix<double, 6, 1> all;
  all << sample.gyro[0], sample.gyro[1], sample.gyro[2], sample.accel[0], sample.accel[1], sample.accel[2];
  return all;
}

bool is_glitch(const DataEvent& e) {
  return (e.kind == DataEvent::Kind::gyro_glitch || e.kind == DataEvent::Kind::accel_glitch) && !e.left_out;
}

}  // namespace

const char* to_string(DataEvent::Kind kind) {
  switch (kind) {
    case DataEvent::Kind::gap: return "gap";
    case DataEvent::Kind::duplicate: return "duplicate";
    case DataEvent::Kind::invalid: return "invalid";
    case DataEvent::Kind::gyro_glitch: return "gyro glitch";
    case DataEvent::Kind::accel_glitch: return "accelerometer glitch";
    case DataEvent::Kind::temperature: return "impossible temperature";
  }
  return "?";
}

GlitchFinder::GlitchFinder(const RecordingInfo& info, const GlitchLimits& limits)
    : square_ratio_(limits.ratio * limits.ratio) {
  const double pulse_mps = info.accel_increment == IncrementKind::pulses ? 1.0 : nominal_accel_pulse_mps;
  const double turn_rad = 0.5 * most_radps2 * info.sample_period_s * info.sample_period_s;
  const double gyro_rad = std::max(limits.counts_min * nominal_gyro_pulse_rad, turn_rad);
  least_square_.head<3>().setConstant(std::pow(gyro_rad / nominal_gyro_rad(info), 2));
  least_square_.tail<3>().setConstant(std::pow(limits.counts_min * pulse_mps, 2));
}

void GlitchFinder::forget_neighbours(const ImuSample& next) { last_ = before_last_ = channels_of(next); }

void GlitchFinder::add(const ImuSample& sample, std::vector<DataEvent>& events) {
  const Channels now = channels_of(sample);
  if (seen_ >= 2) {
    const Channels difference = last_ - 0.5 * (now + before_last_);
    differences_[seen_ % kept] = {sample.counter, difference};
    const Channels square = difference.cwiseAbs2();
    const Channels limit = (square_ratio_ * mean_square_).cwiseMax(least_square_);
    if (seen_ > settled && (square.array() > limit.array()).any())
      suspect(sample, difference, square, limit, events);
    else
      mean_square_ += (square - mean_square_) * memory;
    if (wait_ > 0 && --wait_ == 0) drop_corners(events);
  }
  before_last_ = last_;
  last_ = now;
  ++seen_;
}

// A suspect does not spoil the scale it is measured against.
void GlitchFinder::suspect(const ImuSample& sample, const Channels& difference, const Channels& square,
                           const Channels& limit, std::vector<DataEvent>& events) {
  if (wait_ == 0) unconfirmed_ = events.size();
  wait_ = behind + 1;
  for (int channel = 0; channel < 6; ++channel) {
    if (!(square[channel] > limit[channel])) {
      mean_square_[channel] += (square[channel] - mean_square_[channel]) * memory;
      continue;
    }
    // The sample in the middle stands out; its two neighbours see half of it with the other sign.
    const double value = difference[channel];
    const auto kind = channel < 3 ? DataEvent::Kind::gyro_glitch : DataEvent::Kind::accel_glitch;
    auto known = events.rbegin();
    while (known != events.rend() && known->sample >= sample.counter - 3 &&
           !(known->kind == kind && known->axis == channel % 3))
      ++known;
    if (known == events.rend() || known->sample < sample.counter - 3) {
      events.push_back({kind, sample.counter - 1, 1, channel % 3, value});
    } else if (std::abs(value) > std::abs(known->size)) {
      known->sample = sample.counter - 1;
      known->size = value;
    }
  }
}

void GlitchFinder::drop_corners(std::vector<DataEvent>& events) const {
  const auto is_corner = [&](const DataEvent& e) {
    if (!is_glitch(e)) return false;
    const Eigen::Index channel = e.axis + (e.kind == DataEvent::Kind::gyro_glitch ? 0 : 3);
    double sum = 0.0;
    int found = 0;
    for (const Difference& d : differences_)
      if (std::abs(d.sample - (e.sample + 1)) <= behind) sum += d.value[channel], ++found;
    return found == 2 * behind + 1 && std::abs(sum) >= 0.5 * std::abs(e.size);
  };
  events.erase(std::remove_if(events.begin() + static_cast<std::ptrdiff_t>(unconfirmed_), events.end(), is_corner),
               events.end());
}

}  // namespace turncal
