#include "orchestrator/run/dwell_monitor.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "calib/model/parameters.h"
#include "calib/statistics/data_screen.h"
#include "calib/types/value_text.h"

namespace turncal {

std::array<double, 6> mean_per_count(const RecordingInfo& info, std::int64_t samples) {
  const double seconds = double(samples) * info.sample_period_s;
  const double gyro_degps = nominal_gyro_rad(info) / rad_per_deg / seconds;
  const double accel_mps2 = start_parameters(info).a(0, 0) * si_per_unit(info)[15] / seconds;
  return {gyro_degps, gyro_degps, gyro_degps, accel_mps2, accel_mps2, accel_mps2};
}

DwellMonitor::DwellMonitor(const DwellConfig& config, const RecordingInfo& info)
    : config_(config), period_s_(info.sample_period_s) {
  window_samples_ = std::max<std::int64_t>(1, std::llround(config.stillness_window_s / info.sample_period_s));
  unit_ = mean_per_count(info, window_samples_);
  part_samples_ = std::max<std::int64_t>(1, window_samples_ / 10);
  pulses_[0] = info.gyro_increment == IncrementKind::pulses;
  pulses_[1] = info.accel_increment == IncrementKind::pulses;
}

void DwellMonitor::start(std::int64_t first_counter, std::int64_t samples) {
  if (samples_ > 0 && complete() && !defect_) {
    const double of_last = double(changes_) / double(samples_);
    stillest_ = stillest_ > 0.0 ? std::min(stillest_, of_last) : of_last;
  }
  changes_ = 0;
  first_counter_ = next_counter_ = first_counter;
  samples_ = samples;
  defect_.reset();
  in_window_ = windows_ = in_part_ = 0;
  of_ = {};
  parts_.clear();
  parts_.reserve(std::size_t(samples / part_samples_) + 1);
}

const std::optional<DwellMonitor::Defect>& DwellMonitor::add(std::span<const ImuSample> samples) {
  for (const ImuSample& sample : samples) {
    if (defect_) break;
    if (sample.counter != next_counter_)
      defect_ =
          Defect{ErrorKind::device,
                 fmt::format("{} lost at sample {}", counted(sample.counter - next_counter_, "sample"), next_counter_)};
    else if ((sample.flags & sample_flag_invalid) != 0)
      defect_ =
          Defect{ErrorKind::unit_failed, fmt::format("the unit flagged its data as bad at sample {}", sample.counter)};
    if (defect_) break;
    ++next_counter_;
    for (std::size_t i = 0; i < channels; ++i) {
      const double value = channel_of(sample, i);
      Channel& c = of_[i];
      c.window_sum += value;
      c.part_sum += value;
      if (c.now.samples == 0 || value != c.now.value) {
        if (c.now.samples > 0) c.step = std::min(c.step, std::abs(value - c.now.value));
        changes_ += c.now.samples > 0 ? 1 : 0;
        c.now = {value, sample.counter, 0};
      }
      if (++c.now.samples >= c.longest.samples) c.longest = c.now;
      if (in_window_ == 0 || value < c.least.value) c.least = {value, sample.counter, 0.0};
      if (in_window_ == 0 || value > c.most.value) c.most = {value, sample.counter, 0.0};
    }
    if (++in_part_ == part_samples_) {
      auto& part = parts_.emplace_back();
      for (std::size_t i = 0; i < channels; ++i) part[i] = std::exchange(of_[i].part_sum, 0.0);
      in_part_ = 0;
    }
    if (++in_window_ == window_samples_) close_window();
    if (complete() && !defect_) judge_dead();
  }
  return defect_;
}

void DwellMonitor::close_window() {
  const double size = double(in_window_);
  for (std::size_t i = 0; i < channels; ++i) {
    Channel& c = of_[i];
    const double mean = c.window_sum * unit_[i], middle = c.window_sum / size;
    if (windows_ == 0) c.origin = mean;
    const double d = mean - c.origin;
    c.sum += d;
    c.square += d * d;
    Outlier outlier = c.most.value - middle > middle - c.least.value ? c.most : c.least;
    outlier.without = size > 1.0 ? (c.window_sum - outlier.value) * size / (size - 1.0) * unit_[i] - c.origin : d;
    if (windows_ == 0 || d < c.lowest) c.in_lowest = outlier;
    if (windows_ == 0 || d > c.highest) c.in_highest = outlier;
    c.lowest = std::min(c.lowest, d);
    c.highest = std::max(c.highest, d);
    c.window_sum = 0.0;
  }
  in_window_ = 0;
  ++windows_;
  if (judge_dead() || defect_) return;
  const double count = double(windows_);
  for (std::size_t i = 0; i < channels; ++i) {
    const bool gyro = i < 3;
    const double centre = of_[i].sum / count;
    const double deviation = std::sqrt(std::max(0.0, of_[i].square / count - centre * centre));
    const double peak = std::max(of_[i].highest - centre, centre - of_[i].lowest);
    const double max_deviation = gyro ? config_.max_gyro_std_degps : config_.max_accel_std_mps2;
    const double max_peak = gyro ? config_.max_gyro_peak_degps : config_.max_accel_peak_mps2;
    if (peak <= max_peak && deviation <= max_deviation) continue;
    const bool jumps = !(peak <= max_peak);
    const std::string glitch = glitch_text(i, max_peak);
    const char* unit = gyro ? "deg/s" : "m/s^2";
    defect_ = Defect{ErrorKind::device,
                     !glitch.empty() ? glitch
                                     : fmt::format("not still: {} {} by {:.4g} {} (limit {:.4g} {}) within {:.0f} s",
                                                   channel_names[i], jumps ? "mean jumps" : "means scatter",
                                                   jumps ? peak : deviation, unit, jumps ? max_peak : max_deviation,
                                                   unit, count * config_.stillness_window_s)};
    return;
  }
}

bool DwellMonitor::judge_dead() {
  constexpr double sigmas = 8.0, shortest_s = 0.9, longest_s = 30.0, most_changes = 100.0;
  constexpr std::size_t fewest = 10, tenths = 10;
  const double part = double(part_samples_);
  const std::optional<Stretch> together = frozen_together();
  bool more_will_tell = false;
  const auto frozen = [&] {
    return fmt::format("all six channels gave the same in {} samples, {} to {} ({:.3f} s)", together->samples,
                       together->first, together->first + together->samples - 1, double(together->samples) * period_s_);
  };
  double squares = 0.0, most = sigmas;
  for (std::size_t i = 0; i < channels; ++i) {
    const Stretch& same = of_[i].longest;
    const double same_s = double(same.samples) * period_s_;
    if (same_s < shortest_s) continue;
    const std::int64_t end = same.first + same.samples;
    const bool goes_on = end == next_counter_ && same_s < longest_s && !complete();
    const auto first_touched = std::size_t((same.first - first_counter_) / part_samples_);
    const auto last_touched = std::size_t((end - 1 - first_counter_) / part_samples_);
    Scatter by_parts, by_windows;
    double window = 0.0;
    std::size_t in_window = 0;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
      if (k >= first_touched && k <= last_touched) {
        window = 0.0;
        in_window = 0;
        continue;
      }
      by_parts.add(parts_[k][i]);
      window += parts_[k][i];
      if (++in_window < tenths) continue;
      by_windows.add(window);
      window = 0.0;
      in_window = 0;
    }
    if (by_parts.count < fewest) {
      const bool too_long = together && double(together->samples) * stillest_ > most_changes;
      more_will_tell = more_will_tell || (together && end != next_counter_) || (too_long && goes_on);
      if (too_long && !goes_on) defect_ = Defect{ErrorKind::device, frozen()};
      continue;
    }
    const double variance = by_windows.count >= fewest  // of a sample
                                ? by_windows.variance() / (part * double(tenths))
                                : by_parts.variance() / part;
    const double n = double(same.samples), others = part * double(by_parts.count);
    const double mean = by_parts.mean() / part, off = std::abs(same.value - mean) * n;
    const double share = n / others;
    // A sum of pulses is rounded at its two ends only, rounded numbers at every sample.
    const double rounding = pulses_[i / 3] ? (1.0 + share * share) / 6.0 : n * of_[i].step * n * of_[i].step / 12.0;
    const double sigma = std::sqrt(variance * n * (1.0 + share) + rounding);
    if (off > 0.0) squares += off * off / (sigma * sigma);
    const bool is_off = off > most * sigma;
    const bool all_off = together && squares > sigmas * sigmas;
    if (!is_off && !all_off) continue;
    more_will_tell = more_will_tell || goes_on;
    if (goes_on) continue;
    if (is_off) most = off / sigma;
    defect_ = Defect{
        ErrorKind::device,
        together ? frozen()
                 : fmt::format("{} gave one and the same number in samples {} to {} ({:.1f} s): expected {} in all, "
                               "not {}",
                               channel_names[i], same.first, end - 1, same_s, plus_minus(mean * n, sigma),
                               value_with_sigma(same.value * n, sigma))};
  }
  return more_will_tell && !defect_ && !complete();
}

std::optional<DwellMonitor::Stretch> DwellMonitor::frozen_together() const {
  std::int64_t first = first_counter_, end = next_counter_, shortest = samples_;
  for (const Channel& c : of_) {
    first = std::max(first, c.longest.first);
    end = std::min(end, c.longest.first + c.longest.samples);
    shortest = std::min(shortest, c.longest.samples);
  }
  // Tolerates a neighbouring sample that happens to be equal, and a slow gyro that often repeats a value.
  return 10 * (end - first) > 9 * shortest ? std::optional(Stretch{0.0, first, end - first}) : std::nullopt;
}

// Describes the outlier of the window that is furthest from the mean of the others; empty when the window is not still without it.
std::string DwellMonitor::glitch_text(std::size_t channel, double limit) const {
  if (windows_ < 2) return {};
  const double others = double(windows_ - 1);
  const Channel& c = of_[channel];
  const auto mean_of_others = [&](double d) { return (c.sum - d) / others; };
  const bool is_high = c.highest - mean_of_others(c.highest) > mean_of_others(c.lowest) - c.lowest;
  const double d = is_high ? c.highest : c.lowest;
  const Outlier& outlier = is_high ? c.in_highest : c.in_lowest;
  const double with_it = std::abs(d - mean_of_others(d)), without = std::abs(outlier.without - mean_of_others(d));
  if (!(without <= limit && without < 0.1 * with_it)) return {};
  return glitch_of(channel, outlier.value, outlier.counter, period_s_) + ", and was still without it";
}

}  // namespace turncal
