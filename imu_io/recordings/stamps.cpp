#include "imu_io/recordings/stamps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "calib/statistics/distributions.h"

namespace turncal {
namespace {

// What time it is at a row by the stamps of it and those after it: their median, or the least where stamps come late and never early.
struct StampLevel {
  std::span<const double> times;
  double period = 0.0;
  std::size_t width = 8;
  bool least = false;
  double scatter = 0.0;  // of the difference of two levels
  double spread = 0.0;   // range of the stamps in a window

  double at(std::size_t row, std::size_t most, double* range = nullptr) const {
    std::array<double, 128> level{};
    const std::size_t rows = std::min({width, most, times.size() - row});
    for (std::size_t k = 0; k < rows; ++k) level[k] = times[row + k] - static_cast<double>(k) * period;
    const std::span<double> levels(level.data(), rows);
    const auto [first, last] = std::ranges::minmax(levels);
    if (range != nullptr) *range = last - first;
    return least ? first : median(levels);
  }
  // Of a few windows; some of them may have gaps.
  void find_scatter() {
    constexpr std::size_t enough = 512;
    std::vector<double> rises, spreads;
    for (std::size_t row = 0; row + 2 * width <= times.size(); row += std::max(width, times.size() / enough)) {
      double range = 0.0;
      const double here = at(row, width, &range);
      rises.push_back(at(row + width, width) - here);
      spreads.push_back(range);
    }
    if (rises.empty()) return;
    const double middle = median(rises);
    for (double& rise : rises) rise = std::abs(rise - middle);
    scatter = std::min(value_at_rank(rises, 3 * rises.size() / 4) / 1.15, period / 6.0);
    spread = median(spreads);
  }
};

// The narrowest of a few windows whose levels scatter by less than a twelfth of a period; else the one that scatters least.
StampLevel find_level(std::span<const double> times, double period) {
  StampLevel best{times, period};
  best.scatter = period;
  for (const std::size_t width : {8, 32, 128})
    for (const bool least : {false, true}) {
      if (best.scatter < period / 12.0 || (width > 8 && times.size() < 4 * width)) continue;
      StampLevel level{times, period, width, least};
      level.find_scatter();
      if (level.scatter < best.scatter) best = level;
    }
  return best;
}

// The steps in which stamps are written, where they are coarse: the least by which intervals differ.
double resolution_of(std::span<const double> times, double period) {
  std::vector<double> intervals;
  for (std::size_t k = 1; k < times.size(); k += 1 + times.size() / 4096)
    if (const double interval = times[k] - times[k - 1]; interval < 1.5 * period) intervals.push_back(interval);
  std::ranges::sort(intervals);
  double least = period;
  for (std::size_t k = 1; k < intervals.size(); ++k)
    if (const double step = intervals[k] - intervals[k - 1]; step > 1e-6 * period) least = std::min(least, step);
  return least < period ? least : 0.0;
}

}  // namespace

std::vector<double> intervals_over(std::span<const double> times, std::size_t span, std::size_t most) {
  std::vector<double> intervals;
  const std::size_t step = std::max<std::size_t>(1, times.size() / most);
  intervals.reserve(times.size() / step + 1);
  for (std::size_t k = span; k < times.size(); k += step)
    intervals.push_back((times[k] - times[k - span]) / static_cast<double>(span));
  return intervals;
}

std::vector<StampGap> find_gaps(std::span<const double> times, double period, double gap) {
  const std::size_t n = times.size();
  std::vector<StampGap> gaps;
  const StampLevel level = find_level(times, period);
  std::size_t last_gap = 0;
  const auto is_late = [&](std::size_t row) { return times[row] - times[row - 1] > gap * period; };
  const bool fine = level.width == StampLevel{}.width && level.spread < 0.6 * period;
  // From before a row, up to another one or itself.
  const auto rise = [&](std::size_t row, std::size_t to) {
    const std::size_t from = std::max(last_gap, row - std::min(row, level.width));
    return level.at(to, level.width) - level.at(from, fine ? row - from : level.width) -
           static_cast<double>(to - from) * period;
  };
  for (std::size_t row = 1; row < n; ++row) {
    if (!is_late(row)) continue;
    const auto seen = static_cast<double>(std::min({n - row, row - last_gap, level.width}));
    const double chance = 5.0 * level.scatter * std::sqrt(static_cast<double>(level.width) / seen);
    const double least = std::max(chance, n - row < level.width ? level.spread + 0.5 * period : 0.5 * period);
    if (rise(row, row) < least) continue;
    // A median sees a gap half a window before it: it is the longest interval there. Fine stamps say themselves which row it is.
    std::size_t at = row;
    for (std::size_t next = row + 1; !level.least && !fine && next < std::min(n, row + level.width / 2 + 1); ++next)
      if (times[next] - times[next - 1] > times[at] - times[at - 1]) at = next;
    const double missing = fine ? times[row] - times[row - 1] - period : rise(row, at);
    gaps.push_back({at, 1 + std::max<std::int64_t>(1, std::llround(missing / period))});
    last_gap = row = at;
  }
  return gaps;
}

double typical_interval(std::span<const double> times) {
  std::vector<double> intervals;
  const auto over = [&](std::size_t span) {
    intervals = intervals_over(times, span);
    return intervals.empty() ? 0.0 : median(intervals);
  };
  const double one = over(1);
  std::vector<double> single = intervals;
  double middle = 0.0;
  std::size_t span = 16;
  for (;; span *= 4) {
    span = std::clamp<std::size_t>(times.size() / 4, 1, span);
    middle = over(span);
    if (middle > 0.0 || span == 256 || span == std::max<std::size_t>(times.size() / 4, 1)) break;
  }
  if (!(middle > 0.0)) return middle;
  // Stamps in coarse steps are right in the mean only, and of rows that come in bursts whole bursts.
  const bool bursts = one < 0.5 * middle;
  for (double& interval : single) interval = std::abs(interval - (bursts ? 0.0 : one));
  const std::size_t rank = single.size() - 1 - single.size() / (bursts ? 50 : 20);
  const double step = std::max(0.4 * middle, value_at_rank(single, rank));
  const double near = 1.2 * step / static_cast<double>(span);
  const auto end =
      std::partition(intervals.begin(), intervals.end(), [&](double x) { return std::abs(x - middle) <= near; });
  return std::accumulate(intervals.begin(), end, 0.0) / static_cast<double>(end - intervals.begin());
}

IncrementsChoice choose_increments(std::span<const double> times_s) {
  constexpr std::size_t fewest = 40, parts = 16;
  const std::size_t n = times_s.size();
  if (n < fewest) return {false, "too few rows to tell whether the stamps jitter"};
  const double period = typical_interval(times_s);
  if (!(period > 0.0)) return {false, "the times do not grow"};
  // By what the stamps are ahead of an even clock; periods that are missing are gaps.
  const std::vector<StampGap> gaps = find_gaps(times_s, period, 1.5);
  std::vector<double> ahead(n, 0.0);
  for (std::size_t k = 1, at = 0; k < n; ++k) {
    const std::int64_t periods = at < gaps.size() && gaps[at].row == k ? gaps[at++].periods : 1;
    ahead[k] = ahead[k - 1] + times_s[k] - times_s[k - 1] - static_cast<double>(periods) * period;
  }
  // Rms without the largest hundredth: knocks of the host, gaps that were not whole periods.
  const auto scatter = [&](std::size_t m) {
    std::vector<double> squares;
    for (std::size_t k = 2 * m; k < n; ++k) {
      const double bend = ahead[k] - 2.0 * ahead[k - m] + ahead[k - 2 * m];
      squares.push_back(bend * bend);
    }
    const auto largest = squares.end() - static_cast<std::ptrdiff_t>(squares.size() / 100 + 1);
    std::nth_element(squares.begin(), largest, squares.end());
    squares.erase(largest, squares.end());
    return std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0) / static_cast<double>(squares.size()));
  };
  const std::size_t far = std::min<std::size_t>(n / 8, 32);
  const double jitter = scatter(1) / std::sqrt(6.0);  // of a stamp, if each is off by itself
  const double resolution = resolution_of(times_s, period);
  const double growth = jitter > 1e-9 * period ? scatter(far) / std::max(scatter(1), resolution) : 0.0;
  // Of the rate from a sixteenth to the next, by the means of both.
  const std::size_t length = n / parts;
  const auto rows = static_cast<double>(length);
  std::vector<double> means, rates;
  for (std::size_t part = 0; part < parts; ++part) {
    const std::span<const double> rows_of = std::span(ahead).subspan(part * length, length);
    means.push_back(std::accumulate(rows_of.begin(), rows_of.end(), 0.0) / rows);
    if (part > 0) rates.push_back((means[part] - means[part - 1]) / (rows * period));
  }
  std::ranges::sort(rates);
  const double change = rates[parts - 3] - rates[1];
  const double spread = std::max(jitter, scatter(far) / std::sqrt(6.0)) * std::sqrt(static_cast<double>(far) / rows);
  const double explained = (6.0 * spread + 2.0 * resolution) / (rows * period);
  const std::string said =
      fmt::format("over {} rows the scatter of the stamps is {:.2g} times that over one", far, growth);
  if (growth > std::pow(static_cast<double>(far), 0.25)) return {false, said + ": it adds up, the intervals are real"};
  if (change > std::max(2e-4, explained))
    return {false, fmt::format("the rate changes by {:.2g} % within the record", 100.0 * change)};
  if (growth == 0.0) return {true, "the stamps are even"};
  return {true, said + ": it does not add up, the sampling is even and the stamps jitter"};
}

}  // namespace turncal
