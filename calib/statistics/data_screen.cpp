#include "calib/statistics/data_screen.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "calib/model/parameters.h"

namespace turncal {
namespace {

constexpr double most_radps = 100.0, most_mps2 = 200.0;
constexpr double beyond_all_before = 8.0;
constexpr int longest_spike = 5;

constexpr double nominal_gyro_pulse_rad = 0.932920 * rad_per_arcsec;  // of one count, before anything is measured
constexpr double nominal_accel_pulse_mps = 0.0005;                    // where the increments are not counted
constexpr std::uint64_t settled = 50;                                 // samples until the rms is known
constexpr double memory = 0.01;                                       // weight of one sample in it
constexpr int behind = 2;

bool is_glitch(const DataEvent& e) {
  return (e.kind == DataEvent::Kind::gyro_glitch || e.kind == DataEvent::Kind::accel_glitch) && !e.left_out;
}

constexpr std::int64_t most_run = std::numeric_limits<std::int64_t>::max();
constexpr double circle_deg = 360.0;
constexpr double least_s = 20.0;
// Part of a turn that two gyros must measure to excuse the third: the turn's axis is then within 25 deg of their plane.
constexpr double whole = 0.9;

}  // namespace

std::string glitch_of(std::size_t channel, double value, std::int64_t counter, double sample_period_s) {
  return fmt::format("glitch: {} gave {:.10g} in sample {} ({:.3f} s)", channel_names[channel], value, counter,
                     double(counter) * sample_period_s);
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
  for (std::size_t i = 0; i < 6; ++i) size[i] = std::abs(channel_of(sample, i));
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

const char* to_string(DataEvent::Kind kind) {
  static constexpr const char* names[] = {
      "gap", "duplicate", "invalid", "gyro glitch", "accelerometer glitch", "impossible temperature"};
  return names[std::size_t(kind)];
}

GlitchLimits GlitchLimits::at_rest(const RecordingInfo& info) {
  const bool counts = info.gyro_increment == IncrementKind::pulses || info.accel_increment == IncrementKind::pulses;
  return {.counts_min = counts ? GlitchLimits{}.counts_min : 0.0, .most_radps2 = 0.0, .steps_min = 4.0};
}

GlitchFinder::GlitchFinder(const RecordingInfo& info, const GlitchLimits& limits)
    : square_ratio_(limits.ratio * limits.ratio), steps_min_(limits.steps_min) {
  const double pulse_mps = info.accel_increment == IncrementKind::pulses ? 1.0 : nominal_accel_pulse_mps;
  const double turn_rad = 0.5 * limits.most_radps2 * info.sample_period_s * info.sample_period_s;
  const double gyro_rad = std::max(limits.counts_min * nominal_gyro_pulse_rad, turn_rad);
  least_square_.head<3>().setConstant(std::pow(gyro_rad / nominal_gyro_rad(info), 2));
  least_square_.tail<3>().setConstant(std::pow(limits.counts_min * pulse_mps, 2));
}

void GlitchFinder::forget_neighbours(const ImuSample& next) { last_ = before_last_ = channels_of(next); }

void GlitchFinder::begin_rest(std::span<const ImuSample> first) {
  constexpr std::size_t fewest = 20, neighbours = 6;
  if (first.size() < fewest) return forget_neighbours(first.front());
  before_last_ = channels_of(first[neighbours - 1]), last_ = channels_of(first[neighbours]);
  Eigen::Matrix<double, 6, Eigen::Dynamic> squares(6, std::ssize(first) - 2);
  for (std::size_t k = 1; k < first.size(); ++k) learn_step(channels_of(first[k]) - channels_of(first[k - 1]));
  for (std::size_t k = 2; k < first.size(); ++k)
    squares.col(Eigen::Index(k) - 2) =
        (channels_of(first[k - 1]) - 0.5 * (channels_of(first[k]) + channels_of(first[k - 2]))).cwiseAbs2();
  for (auto of_channel : squares.rowwise()) std::sort(of_channel.begin(), of_channel.end());
  mean_square_ = squares.leftCols(squares.cols() - squares.cols() / 10).rowwise().mean();  // glitches are rare
  seen_ = std::max(seen_, settled + 1);
}

void GlitchFinder::learn_step(const Channels& change) {
  step_ = (change.array() != 0.0).select(step_.cwiseMin(change.cwiseAbs()), step_);
}

void GlitchFinder::add(const ImuSample& sample, std::vector<DataEvent>& events) {
  const Channels now = channels_of(sample);
  if (seen_ >= 2) {
    const Channels difference = last_ - 0.5 * (now + before_last_);
    differences_[seen_ % kept] = {sample.counter, difference};
    const Channels square = difference.cwiseAbs2();
    Channels limit = (square_ratio_ * mean_square_).cwiseMax(least_square_);
    if (steps_min_ > 0.0) {
      learn_step(now - last_);
      limit = limit.cwiseMax((steps_min_ * step_).cwiseAbs2());
    }
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

// A suspect stays out of the rms that it is measured against.
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
  events.erase(std::remove_if(events.begin() + std::ptrdiff_t(unconfirmed_), events.end(), is_corner), events.end());
}

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
    const double lasted_s = double(last_ - channel.since) * sample_period_s_;
    if (!defect_.empty() || channel.turned_deg < circle_deg || lasted_s < least_s) continue;
    defect_ = fmt::format(
        "{} is {}: from sample {} on ({:.1f} s) it gave the same value, {:.6g}, for {:.0f} s in which the table "
        "turned the unit by {:.0f} deg",
        channel_names[i], channel.since == first_ ? "dead" : "stuck", channel.since,
        double(channel.since - first_) * sample_period_s_, channel.value, lasted_s, channel.turned_deg);
  }
  for (Channel& channel : channels_) channel.sum = 0.0;
  told_ = last_;
}

StuckChannels::StuckChannels(double sample_period_s) : sample_period_s_(sample_period_s) {}

void StuckChannels::add(const ImuSample& sample, bool at_rest, std::vector<ImuSample>& known) {
  constexpr double fewest = 100.0, noisy = 0.05, due = 20.0, second_s = 1.0, beyond_step = 1.5;
  const auto enough_of = [&](const Channel& channel) {  // samples
    if (channel.seen < fewest || channel.larger < noisy * channel.seen) return most_run;
    return std::int64_t(std::ceil(std::max(second_s / sample_period_s_, due * channel.seen / channel.larger)));
  };
  held_.push_back(sample);
  last_ = sample.counter;
  std::int64_t longest = at_rest ? 1 : 0;
  bool stuck = false;
  for (std::size_t i = 0; i < 6; ++i) {
    Channel& channel = channels_[i];
    const double value = channel_of(sample, i);
    if (!at_rest || channel.run == 0 || value != channel.value) {
      const double change = std::abs(value - channel.value);
      if (at_rest && channel.run > 0) {
        channel.step = std::min(channel.step, change);
        channel.larger += change > beyond_step * channel.step ? 1.0 : 0.0;
        channel.seen += channel.run == 1 ? 1.0 : double(std::min(channel.run, enough_of(channel)));
      }
      channel.value = value;
      channel.run = at_rest ? 1 : 0;
      continue;
    }
    const std::int64_t enough = enough_of(channel);
    if (++channel.run < enough) {
      if (enough < most_run) longest = std::max(longest, channel.run);
      continue;
    }
    stuck = true;
    if (channel.run == enough)
      runs_.push_back({DataEvent::Kind::invalid, sample.counter - enough + 1, enough - 1, int(i), value});
    ++std::ranges::find(runs_.rbegin(), runs_.rend(), int(i), &DataEvent::axis)->count;
  }
  for (ImuSample& one : held_) one.flags |= stuck ? sample_flag_invalid : 0;
  const auto keep = stuck ? 0 : std::min(longest, std::ssize(held_));
  known.insert(known.end(), held_.begin(), held_.end() - keep);
  held_.erase(held_.begin(), held_.end() - keep);
}

void StuckChannels::finish(std::vector<ImuSample>& known) {
  known.insert(known.end(), held_.begin(), held_.end());
  held_.clear();
}

std::vector<std::string> StuckChannels::found(bool to_the_end) const {
  std::vector<std::string> lines;
  for (const DataEvent& run : runs_)
    if (!to_the_end || run.sample + run.count > last_)
      lines.push_back(
          fmt::format("{} is stuck: it gave one value, {:.6g}, in {} samples at rest from sample {} ({:.3f} s) on",
                      channel_names[std::size_t(run.axis)], run.size, run.count, run.sample,
                      double(run.sample) * sample_period_s_));
  return lines;
}

std::string ChannelLife::without_change() const {
  std::vector<std::string> found;
  for (std::size_t i = 0; last_ > first_ && i < 6; ++i)
    if (channels_[i].since == first_)
      found.push_back(
          fmt::format("{} gave the same value, {:.6g}, in all samples", channel_names[i], channels_[i].value));
  return fmt::format("{}", fmt::join(found, "; "));
}

}  // namespace turncal
