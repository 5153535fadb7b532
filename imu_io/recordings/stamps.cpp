#include "imu_io/recordings/stamps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

// The steps in which stamps are written, where they are coarse: the longest of which all intervals are multiples. 0: not seen.
double resolution_of(std::span<const double> times, double period) {
  constexpr std::size_t most = 4096, tries = 32;
  constexpr double longest = 16.0, least = 1e-6;  // in periods
  std::vector<double> intervals;                  // that are not those before
  for (std::size_t k = 1; k < times.size() && intervals.size() < most; ++k) {
    const double interval = times[k] - times[k - 1];
    const bool again = !intervals.empty() && std::abs(interval - intervals.back()) < least * period;
    if (!again && interval < longest * period) intervals.push_back(interval);
  }
  std::ranges::sort(intervals);
  std::vector<double> jumps;
  for (std::size_t k = 1; k < intervals.size(); ++k)
    if (const double jump = intervals[k] - intervals[k - 1]; jump > least * period) jumps.push_back(jump);
  std::ranges::sort(jumps, std::ranges::greater());
  jumps.resize(std::min(jumps.size(), tries));
  const auto step = std::ranges::find_if(jumps, [&](double jump) {
    return std::ranges::all_of(intervals, [&](double interval) {
      const double steps = interval / jump;
      return std::abs(steps - std::round(steps)) < std::min(1e-3 + 3e-4 * steps, 0.25);
    });
  });
  return step == jumps.end() ? 0.0 : *step;
}

// How stamps follow their clock. In periods.
struct Noise {
  Noise(double s, double step) : scatter(s), half(0.5 * std::max(step, 10.0 * even_scatter)) {}
  double scatter, half;                                      // normal; half of the step in which stamps are written
  double memory = std::max(32.0, 64.0 * scatter * scatter);  // of the clock's phase, in rows
  double walk = scatter * scatter / (memory * memory);       // of the phase, a row
  double start = scatter * scatter + half * half / 3.0;      // variance of a stamp
  double normal = std::log(std::sqrt(start) * std::sqrt(2.0 * std::numbers::pi) / (2.0 * half));
  // -log of one that may be anywhere within some periods; of one whose clock begins anew
  double anywhere = -std::log(std::min(1.0, 2.0 * half));
  double most = 16.0 + anywhere;
};

// One reading of the stamps up to a row: what was missing, and where an even clock stands (phase and rate: a Kalman filter, whose measurement
// says that the stamp's cell holds what is normal). In periods.
class Track {
 public:
  double cost = 0.0;
  std::int64_t missing = 0;
  double carried = 0.0;      // what pauses had less or more than a whole number of periods
  std::size_t last_gap = 0;  // its place in the list of gaps, from 1

  void begin_at(double ahead, const Noise& noise) {
    level_ = ahead - double(missing);
    v_ = noise.start, cross_ = 0.0;
  }
  double level() const { return level_; }
  double spread() const { return std::sqrt(v_); }
  void predict(const Noise& noise) {
    level_ += rate_;
    v_ += 2.0 * cross_ + w_ + noise.walk;
    cross_ += w_;
    w_ += wander * wander;
  }
  double off(double ahead) const { return ahead - double(missing) - level_; }
  // -log of how likely the stamp is, and what it says of the clock.
  double follow(double off, const Noise& noise) {
    const double variance = v_ + noise.scatter * noise.scatter, sigma = std::sqrt(variance);
    double mean = 0.0, less = 0.0, price = 0.0;  // of the standard normal within the cell: its mean, 1 - its variance
    if (noise.half < 0.5 * sigma) {
      const double all = variance + noise.half * noise.half / 3.0;
      price = 0.5 * off * off / all + noise.normal;
      mean = off * sigma / all, less = variance / all;
    } else {
      const double z = std::abs(off), low = (z - noise.half) / sigma, high = (z + noise.half) / sigma;
      constexpr double sure = 3.0;
      if (low < -sure) return 0.0;
      if (low > 8.0) return noise.most;
      const double share = 0.5 * (std::erfc(low * std::numbers::sqrt2 / 2) - std::erfc(high * std::numbers::sqrt2 / 2));
      const double at_low = std::exp(-0.5 * low * low) / 2.5066 / share,
                   at_high = std::exp(-0.5 * high * high) / 2.5066 / share;
      price = -std::log(share);
      mean = std::copysign(at_low - at_high, off);
      less = mean * mean - low * at_low + high * at_high;
    }
    if (!(price < noise.most)) return noise.most;
    const double gain = v_ / sigma, of_rate = cross_ / sigma;
    level_ += gain * mean, rate_ += of_rate * mean;
    v_ -= gain * gain * less, cross_ -= gain * of_rate * less, w_ -= of_rate * of_rate * less;
    return price;
  }

 private:
  static constexpr double period_known = 1e-3, wander = 1e-6;
  double level_ = 0.0, rate_ = 0.0;
  double v_ = 0.0, cross_ = 0.0, w_ = period_known * period_known;  // their covariance
};

struct Fork {
  StampGap gap;
  std::size_t before = 0;  // the one before it, from 1
};

// The most likely gaps: rows follow an even clock, and each may come some periods later than it would. `share`: of the rows that do.
std::pair<std::vector<StampGap>, double> likely_gaps(std::span<const double> times, double period, const Noise& noise,
                                                     double share, double gap, double limit) {
  constexpr std::size_t most_tracks = 8;
  constexpr double rarer = 5.0, rarest = 40.0, hopeless = 60.0, far = 32.0, longest = 1e15;
  const double stay = -std::log1p(-share), rare = -std::log(share), rate = 1.0 / period;
  const double late_from = (gap - 3.0 * noise.scatter - 2.0 * noise.half) * period;
  std::vector<Fork> forks;
  std::vector<Track> tracks(2), next;
  // The first stamp may be a bad one.
  std::vector<double> first;
  for (std::size_t k = 0; k < std::min<std::size_t>(16, times.size()); ++k)
    first.push_back((times[k] - times[0]) * rate - double(k));
  tracks[0].begin_at(0.0, noise);
  tracks[1].begin_at(median(first), noise);
  const auto join = [&](const Track& track) {
    const auto same = std::ranges::find_if(next, [&](const Track& other) {
      return other.missing == track.missing && std::abs(other.level() - track.level()) < noise.scatter &&
             std::max(other.spread(), track.spread()) < 2.0 * std::min(other.spread(), track.spread());
    });
    if (same == next.end())
      next.push_back(track);
    else if (track.cost < same->cost)
      *same = track;
  };
  for (std::size_t k = 0; k < times.size(); ++k) {
    const double ahead = (times[k] - times[0]) * rate - double(k);
    const bool late = k > 0 && times[k] - times[k - 1] > late_from;
    if (k > 0)
      for (Track& track : tracks) track.predict(noise);
    if (tracks.size() == 1) {
      const double off = tracks[0].off(ahead);
      if (!late || off < 0.5) {
        Track stays = tracks[0];
        if (const double cost = stays.follow(off, noise); cost < noise.most) {  // as ever
          stays.cost += stay + cost;
          tracks[0] = stays;
          continue;
        }
      }
    }
    next.clear();
    for (const Track& track : tracks) {
      const double off = std::clamp(track.off(ahead), -longest, longest);
      Track stays = track;
      const double cost = stays.follow(off, noise);
      stays.cost += stay + cost;
      join(stays);
      const auto leap = [&](double periods, bool anew) {
        Track leaps = track;
        leaps.missing += std::int64_t(periods);
        leaps.cost += rare + std::log(periods + 1.0);
        if (anew) {
          leaps.carried += off - periods;
          leaps.begin_at(ahead, noise);
          leaps.cost += (periods > 0.0 ? rarer : rarest) + noise.anywhere;
        } else {
          leaps.cost += std::log(std::max(periods, 1.0)) + leaps.follow(off - periods, noise);  // 1 / n(n + 1)
        }
        leaps.last_gap = forks.size() + 1;
        forks.push_back({{k, std::int64_t(periods) + 1, anew}, track.last_gap});
        join(leaps);
      };
      const bool lost = cost >= noise.most;
      // A leap ahead is time that passed.
      if (lost) leap(off < 0.5 + noise.half ? 0.0 : std::max(0.0, std::round(off + track.carried)), true);
      if (!late || off < 0.5) continue;
      // Where stamps scatter by many periods it may be any of as many.
      const double around = std::min(noise.half + 3.0 * std::hypot(noise.scatter, track.spread()), far);
      for (double periods = std::max(1.0, std::floor(off - around)); periods < off + std::min(1.0, around) + 0.5;
           periods += 1.0)
        leap(periods, false);
    }
    std::ranges::sort(next, {}, &Track::cost);
    if (next.size() > most_tracks) next.resize(most_tracks);
    const double worst = next.front().cost + hopeless;
    while (next.back().cost > worst) next.pop_back();
    std::swap(tracks, next);
    if (tracks.front().cost > limit) return {{}, std::numeric_limits<double>::infinity()};
  }
  std::vector<StampGap> gaps;
  for (std::size_t at = tracks.front().last_gap; at > 0; at = forks[at - 1].before) gaps.push_back(forks[at - 1].gap);
  std::ranges::reverse(gaps);
  // A clock that began anew did so where the time passed, not at the row that agrees with the next one.
  for (std::size_t k = 0; k < gaps.size(); ++k) {
    StampGap& g = gaps[k];
    const std::size_t least = k > 0 ? gaps[k - 1].row + 3 : 2;
    while (g.anew && g.periods > 1 && g.row >= least &&
           times[g.row] - times[g.row - 1] < times[g.row - 1] - times[g.row - 2] - period)
      --g.row;
  }
  return {std::move(gaps), tracks.front().cost};
}

// The period along the gaps: least squares, with a beginning of its own behind a pause of no whole number of periods.
double slope_along(std::span<const double> times, const StampModel& model, const Noise& noise) {
  constexpr int most_astray = 8;
  double both = 0.0, squares = 0.0, first = 0.0;
  std::int64_t origin = 0;
  std::array<double, 5> s{};  // 1, m, m^2, y, m y of a piece
  const auto close = [&] {
    if (s[0] < 2.0) return;
    both += s[4] - s[1] * s[3] / s[0];
    squares += s[2] - s[1] * s[1] / s[0];
  };
  const double rate = 1.0 / model.period;
  Track track;
  std::int64_t counter = 0;
  int astray = 0;  // rows on end
  for (std::size_t k = 0, at = 0; k < times.size(); ++k, ++counter) {
    const double ahead = (times[k] - times[0]) * rate - double(k);
    bool begins = k == 0 || astray > most_astray;
    if (at < model.gaps.size() && model.gaps[at].row == k) {
      track.missing += model.gaps[at].periods - 1;
      counter += model.gaps[at].periods - 1;
      begins = model.gaps[at++].anew || begins;
    }
    if (k > 0) track.predict(noise);
    if (begins) {
      track.begin_at(ahead, noise);
      close();
      s = {}, origin = counter, first = times[k];
    }
    const double off = track.off(ahead);
    const bool lost = track.follow(off, noise) >= noise.most && std::abs(off) > 1.0 + noise.half + 8.0 * noise.scatter;
    astray = lost ? astray + 1 : 0;
    if (lost) continue;
    const auto m = double(counter - origin);
    const double y = times[k] - first - m * model.period;
    s[0] += 1.0, s[1] += m, s[2] += m * m, s[3] += y, s[4] += m * y;
  }
  close();
  return model.period + (squares > 0.0 ? both / squares : 0.0);
}

// The likeliest reading with that scatter, from this one on: the period follows from the gaps, and they from it.
StampModel reading(std::span<const double> times, StampModel model, double step, double gap, double share,
                   double limit) {
  const Noise noise(model.scatter, step / model.period);
  std::tie(model.gaps, model.cost) = likely_gaps(times, model.period, noise, std::clamp(share, 1e-5, 0.9), gap, limit);
  if (!std::isfinite(model.cost)) return model;
  model.period = slope_along(times, model, noise);
  return model;
}

double share_of(const StampModel& model, std::span<const double> times) {
  return (double(model.gaps.size()) + 0.5) / (double(times.size()) + 1.0);
}

// The scatter is the likeliest one, by halves. A smaller one gains a row no more than its logarithm: whoever cannot come below `limit` is left.
StampModel fit(std::span<const double> times, const StampModel& start, double step, double gap, double share,
               double limit) {
  const auto read = [&](const StampModel& from, double likely) {
    const double gain = double(times.size()) * std::log(from.scatter / even_scatter);
    return reading(times, from, step, gap, likely, limit + gain);
  };
  StampModel best = read(start, share);
  best = read(best, share_of(best, times));
  for (const double factor : {0.25, 0.5, 2.0, 0.7, 1.4})
    for (bool better = true; better && std::isfinite(best.cost);) {
      StampModel other = best;
      other.scatter = std::max(even_scatter, best.scatter * factor);
      if (other.scatter == best.scatter) break;
      other = read(other, share_of(best, times));
      better = factor < 1.0 ? other.cost <= best.cost : other.cost < best.cost;
      if (better) best = std::move(other);
    }
  return best;
}

// Of least squares, over the rows.
double slope_of(std::span<const double> times) {
  const double n = double(times.size()), middle = 0.5 * (n - 1.0);
  double both = 0.0;
  for (std::size_t k = 0; k < times.size(); ++k) both += (double(k) - middle) * (times[k] - times[0]);
  return both / (n * (n * n - 1.0) / 12.0);
}

// Slopes over parts of the record, where rows come in bursts: the lower ones have no gaps in them.
double low_slope(std::span<const double> times) {
  const std::size_t width = std::min<std::size_t>(512, times.size());
  std::vector<double> slopes;
  for (std::size_t row = 0; row + width <= times.size(); row += std::max(width, times.size() / 256)) {
    slopes.push_back(slope_of(times.subspan(row, width)));
  }
  return value_at_rank(slopes, slopes.size() / 4);
}

// Periods by the phases of the stamps, which agree in the true one whatever rows are missing: the mean over windows of |sum exp(2 pi i f t)|^2
// is n + n (n - 1) exp(-4 pi^2 scatter^2) there, and n elsewhere (Rayleigh's test); its multiples, and those of coarse steps, agree too.
std::vector<double> common_phases(std::span<const double> times, double slope) {
  constexpr double least = 0.95, most = 4.5, steps = 4.0;  // frequencies: of 1 / slope
  constexpr std::size_t most_found = 6;
  const std::size_t width = std::min<std::size_t>(256, times.size());
  const double step = 1.0 / (steps * double(width));
  std::vector<double> power(std::size_t((most - least) / step));
  std::vector<std::complex<double>> sums(power.size());
  for (std::size_t row = 0; row + width <= times.size(); row += std::max(width, times.size() / 16)) {
    std::ranges::fill(sums, 0.0);
    for (std::size_t k = row; k < row + width; ++k) {
      const double turn = 2.0 * std::numbers::pi * (times[k] - times[row]) / slope;
      std::complex<double> phase = std::polar(1.0, least * turn);
      const std::complex<double> by = std::polar(1.0, step * turn);
      for (std::complex<double>& sum : sums) sum += phase, phase *= by;
    }
    for (std::size_t f = 0; f < sums.size(); ++f) power[f] += std::norm(sums[f]);
  }
  std::vector<std::pair<double, double>> peaks;  // - power, period
  for (std::size_t f = 1; f + 1 < power.size(); ++f) {
    const double here = power[f], before = here - power[f - 1], after = here - power[f + 1];
    if (before <= 0.0 || after < 0.0) continue;
    const double between = 0.5 * (before - after) / (before + after);
    peaks.emplace_back(-here, slope / (least + step * (double(f) + between)));
  }
  std::ranges::sort(peaks);
  peaks.resize(std::min(peaks.size(), most_found));
  std::vector<double> periods;
  for (const auto& peak : peaks) periods.push_back(peak.second);
  return periods;
}

// Of rows that all keep within a quarter of a period of one straight line, so that none is missing; else 0.
double even_period(std::span<const double> times) {
  const double n = double(times.size()), period = slope_of(times);
  double sum = 0.0;
  for (const double time : times) sum += time - times[0];
  const double begins = times[0] + sum / n - 0.5 * (n - 1.0) * period;
  for (std::size_t k = 0; k < times.size(); ++k)
    if (!(std::abs(times[k] - begins - double(k) * period) < 0.25 * period)) return 0.0;
  return period;
}

}  // namespace

std::vector<double> intervals_of(std::span<const double> times, std::size_t most) {
  std::vector<double> intervals;
  const std::size_t step = std::max<std::size_t>(1, times.size() / most);
  for (std::size_t k = 1; k < times.size(); k += step) intervals.push_back(times[k] - times[k - 1]);
  return intervals;
}

StampModel fit_stamps(std::span<const double> times, double gap) {
  constexpr std::size_t enough = std::size_t{1} << 12;
  constexpr double usual_scatter = 0.1, phases_agree = 0.13, is_known = 1e-3, margin = 10.0;
  StampModel best{.cost = std::numeric_limits<double>::infinity(), .gaps = {}};
  if (times.size() < 2) return best;
  const auto [least, most] = std::ranges::minmax(times);
  const double slope = low_slope(times);
  if (!std::isfinite(most - least) || !(slope > 0.0)) return best;
  const std::span<const double> some = times.first(std::min(times.size(), enough));
  const double grid = resolution_of(times, slope), rows = double(some.size());
  const double steps_cost = 20.0 + std::log(rows);  // of a model that has them
  std::vector<StampModel> readings;
  double step = 0.0;
  const auto consider = [&](double period) {
    for (const double of : {0.0, grid}) {
      StampModel model = fit(some, {.period = period, .scatter = usual_scatter, .gaps = {}}, of, gap,
                             1.0 - period / slope, best.cost + margin);
      if (of > 0.0) model.cost += steps_cost;
      if (model.cost < best.cost) best = model, step = of;
      readings.push_back(std::move(model));
      if (grid == 0.0) break;
    }
  };
  consider(slope);
  if (!(best.gaps.empty() && best.scatter < 2.0 * even_scatter))
    for (const double period : common_phases(some, slope)) consider(period);
  const bool doubtful = std::ranges::any_of(readings, [&](const StampModel& other) {
    return std::abs(other.period / best.period - 1.0) > std::max(3.0 / rows, is_known) &&
           other.cost < best.cost + margin;
  });
  // What is missing is counted with the period that is given: the record lasts as long as its stamps say.
  const auto of_all = [&](StampModel model, double of) {
    for (int round = 0; round < 6; ++round) {
      const double period = model.period;
      model = reading(times, model, of, gap, share_of(model, round > 0 ? times : some),
                      std::numeric_limits<double>::infinity());
      const double found = std::exchange(model.period, period);
      if (std::abs(found - period) * double(times.size()) < 0.005 * period) break;
      model.period = found;
    }
    return model;
  };
  const auto slips = [](const StampGap& g) { return g.anew && g.periods == 1; };
  const StampModel start = best;
  if (const double even = best.gaps.empty() && gap >= 1.5 ? even_period(times) : 0.0; even > 0.0)
    best.period = even;
  else
    best = of_all(start, step);
  if (step == 0.0 && grid > 0.0 && some.size() < times.size() && std::ranges::any_of(best.gaps, slips)) {
    StampModel other = of_all(start, grid);
    if (other.cost + steps_cost < best.cost) best = std::move(other), step = grid;
  }
  const double stretch = double(times.size()) / double(best.gaps.size());
  const double cell = step / best.period * std::numbers::pi;
  const double agree = std::exp(-2.0 * std::pow(std::numbers::pi * best.scatter, 2)) *
                       (cell > 0.0 ? std::max(0.0, std::sin(std::min(cell, std::numbers::pi)) / cell) : 1.0);
  const double all = std::hypot(best.scatter, step / best.period / std::sqrt(12.0));
  best.sure = !doubtful && (agree > phases_agree || all * std::sqrt(12.0 / std::pow(stretch, 3)) < is_known);
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
    const StampGap gap = at < model.gaps.size() && model.gaps[at].row == k ? model.gaps[at++] : StampGap{k, 1, false};
    ahead[k] = ahead[k - 1];
    if (!gap.anew || gap.periods == 1) ahead[k] += times_s[k] - times_s[k - 1] - double(gap.periods) * period;
  }
  // Rms without the largest hundredth: knocks of the host, gaps that were not whole periods.
  const auto scatter = [&](std::size_t m) {
    std::vector<double> squares;
    for (std::size_t k = 2 * m; k < n; ++k) {
      const double bend = ahead[k] - 2.0 * ahead[k - m] + ahead[k - 2 * m];
      squares.push_back(bend * bend);
    }
    const auto largest = squares.end() - std::ptrdiff_t(squares.size() / 100 + 1);
    std::nth_element(squares.begin(), largest, squares.end());
    squares.erase(largest, squares.end());
    return std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0) / double(squares.size()));
  };
  const std::size_t far = std::min<std::size_t>(n / 8, 32);
  const double jitter = scatter(1) / std::sqrt(6.0);  // of a stamp, if each is off by itself
  const double resolution = resolution_of(times_s, period);
  const double growth = jitter > 1e-9 * period ? scatter(far) / std::max(scatter(1), resolution) : 0.0;
  // Of the rate from a sixteenth to the next, by the means of both.
  const std::size_t length = n / parts;
  const auto rows = double(length);
  std::vector<double> means, rates;
  for (std::size_t part = 0; part < parts; ++part) {
    const std::span<const double> rows_of = std::span(ahead).subspan(part * length, length);
    means.push_back(std::accumulate(rows_of.begin(), rows_of.end(), 0.0) / rows);
    if (part > 0) rates.push_back((means[part] - means[part - 1]) / (rows * period));
  }
  std::ranges::sort(rates);
  const double change = rates[parts - 3] - rates[1];
  const double paused =
      std::ranges::any_of(model.gaps, &StampGap::anew) ? jitter : 0.0;  // what the stamps around are off
  const double spread = std::max(jitter, scatter(far) / std::sqrt(6.0)) * std::sqrt(double(far) / rows);
  const double explained = (6.0 * (spread + paused) + 2.0 * resolution) / (rows * period);
  const std::string said =
      fmt::format("over {} rows the scatter of the stamps is {:.2g} times that over one", far, growth);
  if (growth > std::pow(double(far), 0.25)) return {false, said + ": it adds up, the intervals are real"};
  if (!model.sure) return {true, "the period is in doubt"};
  if (change > std::max(steady_rate, explained))
    return {false, fmt::format("the rate changes by {:.2g} % within the record", 100.0 * change)};
  if (growth == 0.0) return {true, "the stamps are even"};
  return {true, said + ": it does not add up, the sampling is even and the stamps jitter"};
}

}  // namespace turncal
