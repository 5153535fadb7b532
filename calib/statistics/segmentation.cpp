#include "calib/statistics/segmentation.h"

#include <algorithm>

#include <fmt/format.h>

#include "calib/model/limits.h"
#include "calib/statistics/data_screen.h"
#include "calib/statistics/numerics.h"

namespace turncal {

namespace {

double quantile(std::vector<double> values, double part) {
  if (values.empty()) return 0.0;
  return value_at_rank(values, std::size_t(part * double(values.size() - 1)));
}

}  // namespace

RestFinder::RestFinder(const RecordingInfo& info, const SegmentationOptions& options)
    : options_(options),
      period_s_(info.sample_period_s),
      cell_samples_(std::max(4, int(std::lround(options.cell_s / info.sample_period_s)))) {}

void RestFinder::add(std::span<const ImuSample> samples) {
  for (const ImuSample& sample : samples) {
    SixChannels x = channels_of(sample);
    if (!have_origin_) {
      origin_ = x;
      last_gyro_ = x.head<3>();
    }
    const std::int64_t lost = have_origin_ ? sample.counter - next_ : 0;
    const bool gap = lost < 0 || lost > cell_samples_ || (sample.flags & sample_flag_invalid) != 0;
    have_origin_ = true;
    next_ = sample.counter + 1;
    if (cells_.empty() || cells_.back().samples == cell_samples_ || gap) {
      if (!cells_.empty()) cells_.back().end = sample.counter;
      cells_.emplace_back();
      cells_.back().start = sample.counter;
    }
    Cell& cell = cells_.back();
    cell.gap = cell.gap || gap;
    cell.end = sample.counter + 1;
    ++cell.samples;
    if (!gap) cell.gyro_changes += (x.head<3>() - last_gyro_).square().sum();
    last_gyro_ = x.head<3>();
    x -= origin_;  // variances of small differences keep their digits
    cell.sum += x;
    cell.squares += x * x;
  }
}

std::vector<RestFinder::Window> RestFinder::window_variances() const {
  const std::size_t width = std::size_t(options_.window_cells);
  std::vector<Window> windows(cells_.size() < width ? 0 : cells_.size() - width + 1);
  for (std::size_t k = 0; k < windows.size(); ++k) {
    SixChannels sum = SixChannels::Zero();
    SixChannels squares = sum;
    double n = 0.0;
    double changes = 0.0;
    bool gap = false;
    for (std::size_t c = k; c < k + width; ++c) {
      changes += cells_[c].gyro_changes;
      sum += cells_[c].sum;
      squares += cells_[c].squares;
      n += cells_[c].samples;
      gap = gap || cells_[c].gap;
    }
    const SixChannels variance = ((squares - sum * sum / n) / std::max(n - 1.0, 1.0)).max(0.0);
    windows[k] = {variance.head<3>().mean(), variance.tail<3>().mean()};
    if (changes > 0.0) windows[k].smoothness = 2.0 * n * variance.head<3>().sum() / changes;
    if (gap) windows[k].gyro = windows[k].accel = INFINITY;
  }
  return windows;
}

double RestFinder::noise_limit() const {
  // The variance of n samples on three axes has relative deviation sqrt(2 / 3n); noise passes 4.3 of them once in 10^5.
  const double n = double(options_.window_cells * cell_samples_);
  return std::max(2.0, 1.0 + 4.3 * std::sqrt(2.0 / (3.0 * n)));
}

void RestFinder::choose_threshold(const std::vector<double>& ratios, Segmentation& result) const {
  constexpr double step = 0.1;  // of log10 R
  const double first = std::log10(noise_limit());
  double best_length = 0.0;
  int count_before = -1;
  double begin = first;
  const auto judge = [&](double end, int count) {
    const double length = end - begin;
    if (count >= segmentation_limits.fewest_rests && length > best_length + 1e-9 &&
        begin <= std::log10(segmentation_limits.most_tremor)) {
      best_length = length;
      result.plateau_begin = std::pow(10.0, begin);
      result.plateau_end = std::pow(10.0, end);
    }
  };
  for (int k = 0; k <= 50; ++k) {
    const double at = first + k * step;
    std::vector<Run> runs = runs_below(ratios, std::pow(10.0, at));
    drop_short(runs);
    const int count = int(runs.size());
    if (count != count_before) {
      judge(at, count_before);
      begin = at;
      count_before = count;
    }
    if (k == 50) judge(at + step, count);
  }
  if (best_length > segmentation_limits.shortest_plateau) {
    // Near the lower end: a higher threshold lets in the beginning of motion.
    result.threshold = result.plateau_begin * std::pow(10.0, std::min(0.5, best_length / 3.0));
    result.reason = fmt::format(
        "the number of rests stays the same for thresholds from {:.3g} to {:.3g}, the longest such stretch; taken near "
        "its lower end",
        result.plateau_begin, result.plateau_end);
  } else {
    result.threshold = 2.0 * noise_limit();
    result.plateau_begin = result.plateau_end = result.threshold;
    result.reason = "the number of rests changes with every threshold; taken at twice what noise alone reaches";
  }
}

void RestFinder::drop_short(std::vector<Run>& runs) const {
  const std::int64_t shortest = samples_in(options_.min_rest_s) + 2 * samples_in(options_.guard_s);
  std::erase_if(runs, [&](const Run& run) {
    return run.end <= run.first || cells_[run.end - 1].end - cells_[run.first].start < shortest;
  });
}

std::vector<RestFinder::Run> RestFinder::runs_below(const std::vector<double>& ratios, double threshold) const {
  const std::size_t width = std::size_t(options_.window_cells);
  std::vector<Run> runs;
  bool inside = false;
  std::size_t first = 0;
  std::size_t last_quiet = 0;
  const auto close = [&] {
    // Windows first..last_quiet were quiet: takes the cells they cover.
    runs.push_back({first, last_quiet + width});
    inside = false;
  };
  for (std::size_t k = 0; k < ratios.size(); ++k) {
    const bool quiet = ratios[k] < threshold;
    if (!inside && quiet) {
      inside = true;
      first = k;
    }
    if (inside && quiet) last_quiet = k;
    if (inside && (ratios[k] > segmentation_limits.hysteresis * threshold || k - last_quiet >= width)) close();
  }
  if (inside) close();
  // Two runs may share cells: the cell between them that moved belongs to neither.
  for (std::size_t k = 1; k < runs.size(); ++k)
    if (runs[k].first < runs[k - 1].end) {
      const std::size_t from = runs[k].first;
      runs[k].first = runs[k - 1].end;
      runs[k - 1].end = from;
    }
  return runs;
}

Eigen::Vector3d RestFinder::mean_gyro(const Run& run) const {
  SixChannels sum = SixChannels::Zero();
  double n = 0.0;
  for (std::size_t c = run.first; c < run.end; ++c) {
    sum += cells_[c].sum;
    n += cells_[c].samples;
  }
  return (sum.head<3>() / n).matrix();
}

void RestFinder::drop_slow_turns(std::vector<Run>& runs, Segmentation& result) const {
  if (runs.size() < 4) return;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> means;
    for (const Run& run : runs) means.push_back(mean_gyro(run)[axis]);
    const double middle = quantile(means, 0.5);
    std::vector<double> off;
    for (const double m : means) off.push_back(std::abs(m - middle));
    const double limit = segmentation_limits.slow_turn_sigmas * 1.4826 * quantile(off, 0.5) + result.quiet_gyro;
    const std::size_t before = runs.size();
    std::erase_if(runs, [&](const Run& run) { return std::abs(mean_gyro(run)[axis] - middle) > limit; });
    result.slow_turns += int(before - runs.size());
  }
}

void RestFinder::cut_to_still(std::vector<Run>& runs, Segmentation& result) const {
  SixChannels noise;
  noise << Eigen::Array3d::Constant(result.quiet_gyro), Eigen::Array3d::Constant(result.quiet_accel);
  noise /= std::sqrt(double(cell_samples_));
  // Rests that tremble (held by hand) count as rests: with a smaller variance ratio than this, fewer of them would be found.
  noise *= std::sqrt(std::max(1.0, result.plateau_begin));
  // The guard is cut off later: motion within it needs no cut here, and a cut leaves room for it.
  const auto spared = std::size_t(samples_in(options_.guard_s) / cell_samples_);
  std::vector<SixChannels> means;
  for (Run& run : runs) {
    const std::size_t first = run.first == 0 ? 0 : std::min(run.first + spared, run.end);
    const std::size_t end = run.end == cells_.size() ? run.end : std::max(run.end - spared, first);
    means.clear();
    for (std::size_t c = first; c < end; ++c) means.push_back(cells_[c].sum / std::max(1, cells_[c].samples));
    const StillPart part = longest_still(means, noise);
    if (part.first == 0 && part.end == means.size()) continue;
    ++result.cut;
    if (part.end < means.size()) run.end = first + part.end;
    if (part.first > 0) run.first = first + part.first;
  }
}

Segmentation RestFinder::finish() {
  Segmentation result;
  const std::vector<Window> windows = window_variances();
  if (windows.size() < 10) {
    result.reason = "the recording is too short: fewer than ten windows";
    return result;
  }
  std::vector<double> gyro, accel;
  for (const Window& w : windows) {
    gyro.push_back(w.gyro);
    accel.push_back(w.accel);
  }
  // The median of the quietest fifth; a constant channel has no variance to speak of.
  const double quiet_gyro = std::max(quantile(gyro, 0.1), 1e-300);
  const double quiet_accel = std::max(quantile(accel, 0.1), 1e-300);
  result.quiet_gyro = std::sqrt(quiet_gyro);
  result.quiet_accel = std::sqrt(quiet_accel);
  std::vector<double> ratios;
  for (const Window& w : windows) ratios.push_back(std::max(w.gyro / quiet_gyro, w.accel / quiet_accel));
  // The quietest fifth, by the gyros.
  std::vector<double> smooth;
  const double quiet_fifth = quantile(gyro, 0.2);
  for (const Window& w : windows)
    if (w.gyro <= quiet_fifth) smooth.push_back(w.smoothness);
  result.smoothness = quantile(smooth, 0.5);
  if (result.smoothness > segmentation_limits.smooth_motion) {
    result.reason = fmt::format(
        "even in its quietest fifth the gyros follow a smooth motion and no noise (variance {:.3g} times that of "
        "neighbouring samples): the unit swings and never rests",
        result.smoothness);
    return result;
  }
  if (options_.threshold) {
    result.threshold = result.plateau_begin = result.plateau_end = *options_.threshold;
    result.reason = "given";
  } else {
    choose_threshold(ratios, result);
  }
  std::vector<Run> runs = runs_below(ratios, result.threshold);
  drop_short(runs);
  drop_slow_turns(runs, result);
  const std::size_t found = runs.size();
  cut_to_still(runs, result);
  drop_short(runs);
  result.moving = int(found - runs.size());
  const std::int64_t guard = samples_in(options_.guard_s);
  std::int64_t at = cells_.front().start;
  const auto append = [&](SegmentKind kind, std::int64_t from, std::int64_t to) {
    if (to > from) result.segments.push_back({.kind = kind, .start_sample = from, .end_sample = to});
  };
  for (const Run& run : runs) {
    const std::int64_t from = run.first == 0 ? cells_[run.first].start : cells_[run.first].start + guard;
    const std::int64_t to = run.end == cells_.size() ? cells_[run.end - 1].end : cells_[run.end - 1].end - guard;
    append(SegmentKind::rotate, at, from);
    append(SegmentKind::still, from, to);
    at = to;
  }
  if (!runs.empty()) append(SegmentKind::rotate, at, cells_.back().end);
  return result;
}

bool without_table_angles(const Segments& segments) {
  return std::ranges::all_of(
      segments, [](const Segment& s) { return s.heading_deg == 0.0 && s.pitch_deg == 0.0 && s.roll_deg == 0.0; });
}

StillPart longest_still(std::span<const SixChannels> pieces, const SixChannels& noise, double outlier) {
  const std::size_t n = pieces.size();
  if (n < 5) return {0, n};
  SixChannels centre, limit;
  std::vector<double> values(n);
  for (int channel = 0; channel < 6; ++channel) {
    for (std::size_t k = 0; k < n; ++k) values[k] = pieces[k][channel];
    centre[channel] = median(values);
    for (std::size_t k = 0; k < n; ++k) values[k] = std::abs(pieces[k][channel] - centre[channel]);
    limit[channel] = outlier * std::max(1.4826 * median(values), noise[channel]);
  }
  StillPart best, now;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t from = k > 0 ? k - 1 : 0;
    const std::size_t to = std::min(k + 2, n);
    SixChannels mean = SixChannels::Zero();
    for (std::size_t j = from; j < to; ++j) mean += pieces[j];
    mean /= double(to - from);
    if (((mean - centre).abs() > limit).any()) {
      now = {k + 1, k + 1};
      continue;
    }
    now.end = k + 1;
    if (now.end - now.first > best.end - best.first) best = now;
  }
  return best;
}

}  // namespace turncal
