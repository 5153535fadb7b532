#include "imu_io/recordings/stamps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <numeric>

#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

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

// -log of how likely a stamp is that is so far off: normal, and a few anywhere within some periods.
struct Loss {
  explicit Loss(double s) : scatter(s) {}
  double scatter, most = 4.6 + std::log(4.0 / scatter), half_weight = 0.5 / (scatter * scatter);
  double memory = std::max(32.0, 64.0 * scatter * scatter), least_gain = 1.0 / memory;  // of a track, in rows
  double operator()(double off) const { return std::min(half_weight * off * off, most); }
};

// One reading of the stamps up to a row: what was missing, and where an even clock stands. In periods.
class Track {
 public:
  double cost = 0.0;
  std::int64_t missing = 0;
  std::size_t last_gap = 0;  // its place in the list of gaps, from 1
  double level = 0.0;
  double rows = 0.0;  // since it began

  void begin_at(double ahead) { level = ahead, rows = 0.0; }
  double off(double ahead) const { return ahead - static_cast<double>(missing) - level; }
  // A mean over the rows so far, later over the last ones; one stamp does not draw it far.
  void follow(double off, const Loss& loss) {
    rows += 1.0;
    const double gain = rows < loss.memory ? 1.0 / rows : loss.least_gain;
    level += gain * std::clamp(off, -3.0 * loss.scatter, 3.0 * loss.scatter);
  }
};

struct Fork {
  StampGap gap;
  std::size_t before = 0;  // the one before it, from 1
};

// The most likely gaps: rows follow an even clock, and each may come some periods later than it would. `share`: of the rows that do.
std::pair<std::vector<StampGap>, double> likely_gaps(std::span<const double> times, double period, double scatter,
                                                     double share, double gap) {
  constexpr std::size_t most_tracks = 8;
  constexpr double never = 12.0, hopeless = 40.0, far = 32.0, longest = 1e9;
  const Loss loss(scatter);
  const double stay = -std::log1p(-share), rare = -std::log(share), rate = 1.0 / period;
  std::vector<Fork> forks;
  std::vector<Track> tracks(2), next;
  // The first stamp may be a bad one.
  std::vector<double> first;
  for (std::size_t k = 0; k < std::min<std::size_t>(16, times.size()); ++k)
    first.push_back((times[k] - times[0]) / period - static_cast<double>(k));
  tracks[1].begin_at(median(first));
  const auto join = [&](const Track& track) {
    const auto same = std::ranges::find_if(next, [&](const Track& other) {
      return other.missing == track.missing && std::abs(other.level - track.level) < scatter;
    });
    if (same == next.end())
      next.push_back(track);
    else if (track.cost < same->cost)
      *same = track;
  };
  for (std::size_t k = 0; k < times.size(); ++k) {
    const double ahead = (times[k] - times[0]) * rate - static_cast<double>(k);
    const bool late = k > 0 && times[k] - times[k - 1] > (gap - 3.0 * scatter) * period;
    next.clear();
    if (const double off = tracks[0].off(ahead); tracks.size() == 1 && !late && loss(off) < loss.most) {  // as ever
      tracks[0].cost += stay + loss(off);
      tracks[0].follow(off, loss);
      continue;
    }
    for (const Track& track : tracks) {
      const double off = std::clamp(track.off(ahead), -longest, longest);
      Track stays = track;
      stays.cost += stay + loss(off);
      stays.follow(off, loss);
      join(stays);
      const auto leap = [&](double periods, bool anew) {
        Track leaps = track;
        leaps.missing += static_cast<std::int64_t>(periods);
        leaps.cost += rare + loss(off - periods) + (anew ? never : 0.0);
        leaps.cost += std::log((periods + 1.0) * std::max(periods, 1.0));  // 1 / n(n + 1): of so many missing rows
        if (anew) leaps.begin_at(ahead - static_cast<double>(leaps.missing));
        leaps.follow(leaps.off(ahead), loss);
        leaps.last_gap = forks.size() + 1;
        forks.push_back({{k, static_cast<std::int64_t>(periods) + 1, anew}, track.last_gap});
        join(leaps);
      };
      if (loss(off) >= loss.most) leap(0.0, true);
      if (!late || off < 0.5) continue;
      // Where stamps scatter by many periods it may be any of as many.
      double periods = std::max(1.0, std::floor(off - std::min(3.0 * scatter, far)));
      for (; periods < off + 1.0; periods += 1.0) {
        leap(periods, false);
        if (loss(off - periods) >= loss.most) leap(periods, true);
      }
    }
    std::ranges::sort(next, {}, &Track::cost);
    if (next.size() > most_tracks) next.resize(most_tracks);
    const double worst = next.front().cost + hopeless;
    while (next.back().cost > worst) next.pop_back();
    std::swap(tracks, next);
  }
  std::vector<StampGap> gaps;
  for (std::size_t at = tracks.front().last_gap; at > 0; at = forks[at - 1].before) gaps.push_back(forks[at - 1].gap);
  std::ranges::reverse(gaps);
  return {std::move(gaps), tracks.front().cost + static_cast<double>(times.size()) * std::log(scatter * period)};
}

// Of stamps in coarse steps no less than theirs.
constexpr double coarse_scatter = 0.7;
double least_scatter(std::span<const double> times, double period) {
  return std::max(even_scatter, coarse_scatter * resolution_of(times, period) / period);
}

// The scatter along the gaps, and the period: least squares, with a beginning of its own behind a gap of no whole number of periods.
void measure(std::span<const double> times, double least, StampModel& model) {
  std::vector<double> offs;
  const std::size_t stride = 1 + times.size() / 65536;
  double both = 0.0, squares = 0.0, first = 0.0;
  std::int64_t origin = 0;
  std::array<double, 5> s{};  // 1, m, m^2, y, m y of a piece
  const auto close = [&] {
    if (s[0] < 2.0) return;
    both += s[4] - s[1] * s[3] / s[0];
    squares += s[2] - s[1] * s[1] / s[0];
  };
  const Loss loss(model.scatter);
  const double rate = 1.0 / model.period;
  Track track;
  std::int64_t counter = 0;
  for (std::size_t k = 0, at = 0, taken = 0; k < times.size(); ++k, ++counter) {
    const double ahead = (times[k] - times[0]) * rate - static_cast<double>(k);
    bool begins = k == 0;
    if (at < model.gaps.size() && model.gaps[at].row == k) {
      track.missing += model.gaps[at].periods - 1;
      counter += model.gaps[at].periods - 1;
      begins = model.gaps[at++].anew;
    }
    if (begins) {
      track.begin_at(ahead - static_cast<double>(track.missing));
      close();
      s = {}, origin = counter, first = times[k];
    }
    const double off = track.off(ahead);
    track.follow(off, loss);
    if (k == taken) offs.push_back(std::abs(off)), taken += stride;
    if (loss(off) >= loss.most) continue;
    const auto m = static_cast<double>(counter - origin);
    const double y = times[k] - first - m * model.period;
    s[0] += 1.0, s[1] += m, s[2] += m * m, s[3] += y, s[4] += m * y;
  }
  close();
  if (squares > 0.0) model.period += both / squares;
  model.scatter = std::max(least, 1.48 * median(offs));
}

StampModel fit(std::span<const double> times, const StampModel& start, double share, double gap) {
  const double least = least_scatter(times, start.period);
  StampModel model{.period = start.period, .scatter = std::max(least, start.scatter), .gaps = {}};
  for (int round = 0; round < 12; ++round) {
    auto [gaps, cost] = likely_gaps(times, model.period, model.scatter, std::clamp(share, 6e-6, 0.9), gap);
    model.cost = cost;
    const double before = model.scatter;
    const bool same = gaps.size() == model.gaps.size();
    std::swap(model.gaps, gaps);
    measure(times, least, model);
    if (same && std::abs(model.scatter - before) < 0.01 * before) break;
    share = (static_cast<double>(model.gaps.size()) + 0.5) / (static_cast<double>(times.size()) + 1.0);
  }
  return model;
}

// Slopes over parts of the record, where rows come in bursts: the lower ones have no gaps in them.
double low_slope(std::span<const double> times) {
  const std::size_t width = std::min<std::size_t>(512, times.size());
  std::vector<double> slopes;
  for (std::size_t row = 0; row + width <= times.size(); row += std::max(width, times.size() / 256)) {
    const double middle = 0.5 * static_cast<double>(width - 1);
    double both = 0.0, squares = 0.0;
    for (std::size_t k = 0; k < width; ++k) {
      const double m = static_cast<double>(k) - middle;
      both += m * (times[row + k] - times[row]);
      squares += m * m;
    }
    slopes.push_back(both / squares);
  }
  return value_at_rank(slopes, slopes.size() / 4);
}

// By the phases of the stamps, which agree in the true period whatever rows are missing: the mean over windows of |sum exp(2 pi i f t)|^2
// is n + n (n - 1) exp(-4 pi^2 scatter^2) there, and n elsewhere (Rayleigh's test). Its multiples agree less, or as much without scatter.
StampModel common_phase(std::span<const double> times, double slope) {
  constexpr double least = 0.95, most = 4.5, steps = 4.0, as_high = 0.8;  // frequencies: of 1 / slope
  const std::size_t width = std::min<std::size_t>(256, times.size());
  const double step = 1.0 / (steps * static_cast<double>(width));
  std::vector<double> power(static_cast<std::size_t>((most - least) / step));
  std::vector<std::complex<double>> sums(power.size());
  double windows = 0.0;
  for (std::size_t row = 0; row + width <= times.size(); row += std::max(width, times.size() / 32), ++windows) {
    std::ranges::fill(sums, 0.0);
    for (std::size_t k = row; k < row + width; ++k) {
      const double turn = 2.0 * std::numbers::pi * (times[k] - times[row]) / slope;
      std::complex<double> phase = std::polar(1.0, least * turn);
      const std::complex<double> by = std::polar(1.0, step * turn);
      for (std::complex<double>& sum : sums) sum += phase, phase *= by;
    }
    for (std::size_t f = 0; f < sums.size(); ++f) power[f] += std::norm(sums[f]);
  }
  std::size_t best = 0;
  for (const double highest = std::ranges::max(power); power[best] < as_high * highest;) ++best;
  while (best + 1 < power.size() && power[best + 1] > power[best]) ++best;
  const auto n = static_cast<double>(width);
  const double agree = std::clamp((power[best] / (windows * n) - 1.0) / (n - 1.0), 1e-9, 1.0);
  return {.period = slope / (least + step * static_cast<double>(best)),
          .scatter = std::sqrt(-std::log(agree)) / (2.0 * std::numbers::pi),
          .gaps = {}};
}

}  // namespace

std::vector<double> intervals_of(std::span<const double> times, std::size_t most) {
  std::vector<double> intervals;
  const std::size_t step = std::max<std::size_t>(1, times.size() / most);
  for (std::size_t k = 1; k < times.size(); k += step) intervals.push_back(times[k] - times[k - 1]);
  return intervals;
}

StampModel fit_stamps(std::span<const double> times, double gap) {
  constexpr std::size_t enough = std::size_t{1} << 15;
  constexpr double usual_scatter = 0.3, phases_agree = 0.32, is_known = 1e-3;
  StampModel best{.cost = std::numeric_limits<double>::infinity(), .gaps = {}};
  if (times.size() < 2) return best;
  const auto [least, most] = std::ranges::minmax(times);
  const double slope = low_slope(times);
  if (!std::isfinite(most - least) || !(slope > 0.0)) return best;
  const std::span<const double> some = times.first(std::min(times.size(), enough));
  best = fit(some, {.period = slope, .scatter = usual_scatter, .gaps = {}}, 0.0, gap);
  if (!best.gaps.empty() || best.scatter > phases_agree) {
    const StampModel start = common_phase(some, slope);
    StampModel model = fit(some, start, 1.0 - start.period / slope, gap);
    const double grid = coarse_scatter * resolution_of(some, slope);  // no reading is likelier than its cells
    const auto cost = [&](const StampModel& m) {
      return m.cost + static_cast<double>(some.size()) * std::max(0.0, std::log(grid / (m.scatter * m.period)));
    };
    if (cost(model) < cost(best)) best = std::move(model);
  }
  if (some.size() < times.size()) best = fit(times, best, static_cast<double>(best.gaps.size()) / enough, gap);
  const double stretch = static_cast<double>(times.size()) / static_cast<double>(best.gaps.size());
  best.sure = best.scatter < phases_agree || best.scatter * std::sqrt(12.0 / std::pow(stretch, 3)) < is_known;
  return best;
}

IncrementsChoice choose_increments(std::span<const double> times_s, const StampModel& model) {
  constexpr std::size_t fewest = 40, parts = 16;
  const std::size_t n = times_s.size();
  if (n < fewest) return {false, "too few rows to tell whether the stamps jitter"};
  if (!(model.period > 0.0)) return {false, "the times do not grow"};
  const double period = model.period;
  std::vector<double> ahead(n, 0.0);
  for (std::size_t k = 1, at = 0; k < n; ++k) {
    const std::int64_t periods = at < model.gaps.size() && model.gaps[at].row == k ? model.gaps[at++].periods : 1;
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
  if (!model.sure) return {true, "the period is in doubt"};
  if (change > std::max(2e-4, explained))
    return {false, fmt::format("the rate changes by {:.2g} % within the record", 100.0 * change)};
  if (growth == 0.0) return {true, "the stamps are even"};
  return {true, said + ": it does not add up, the sampling is even and the stamps jitter"};
}

}  // namespace turncal
