#include "imu_io/recordings/stamps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <map>
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
  Noise(double s, double cell) : scatter(s), half(0.5 * cell) {}
  double scatter, half;  // normal; half of the cell that a stamp tells
  double walk = std::pow(scatter / std::max(32.0, 64.0 * scatter * scatter), 2);  // of the phase, a row
  double wander = 1e-6;                                                           // of the rate, a row
  double start = scatter * scatter + half * half / 3.0;                           // variance of a stamp
  double normal = std::log(std::sqrt(start) * std::sqrt(2.0 * std::numbers::pi) / (2.0 * half));
  double anywhere = -std::log(std::min(1.0, 2.0 * half));  // -log of a stamp that may be anywhere within some periods
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
    w_ += noise.wander * noise.wander;
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
      if (low < -3.0) return 0.0;  // as good as sure
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
  double level_ = 0.0, rate_ = 0.0, v_ = 0.0, cross_ = 0.0, w_ = 1e-6;  // their covariance: the rate is known to 0.1 %
};

// The period along the gaps: least squares, with a beginning of its own behind a pause of no whole number of periods.
double slope_along(std::span<const double> times, const StampModel& model, const Noise& noise) {
  double both = 0.0, squares = 0.0, first = 0.0;
  std::int64_t origin = 0, counter = 0;
  std::array<double, 5> s{};  // 1, m, m^2, y, m y of a piece
  const auto close = [&] {
    both += s[4] - s[1] * s[3] / std::max(1.0, s[0]);
    squares += s[2] - s[1] * s[1] / std::max(1.0, s[0]);
  };
  const double rate = 1.0 / model.period;
  Track track;
  int astray = 0;  // rows on end
  for (std::size_t k = 0, at = 0; k < times.size(); ++k, ++counter) {
    const double ahead = (times[k] - times[0]) * rate - double(k);
    bool begins = k == 0 || astray > 8;
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
    const double m = double(counter - origin), y = times[k] - first - m * model.period;
    s[0] += 1.0, s[1] += m, s[2] += m * m, s[3] += y, s[4] += m * y;
  }
  close();
  return model.period + (squares > 0.0 ? both / squares : 0.0);
}

double share_of(const StampModel& model, std::span<const double> times) {
  return (double(model.gaps.size()) + 0.5) / (double(times.size()) + 1.0);
}

double whole(std::int64_t n) { return std::log(double(n)) + std::log(double(n) + 1.0); }  // -log of 1 / n(n + 1)

// What it takes to tell kinds of things one after the other, and how often each comes: each is named once, and then as likely as it is frequent.
using Kinds = std::map<std::pair<std::int64_t, std::int64_t>, double>;
double told_by_kinds(const Kinds& kinds) {
  double count = 0.0, cost = 0.0;
  for (const auto& [kind, often] : kinds) count += often;
  std::pair<std::int64_t, std::int64_t> before{0, 0};
  for (const auto& [kind, often] : kinds) {
    const bool other = kind.first != before.first;
    cost += whole(kind.second - (other ? 0 : before.second)) + (other ? whole(kind.first - before.first) : 0.0) +
            often * std::log(count / often);
    before = kind;
  }
  return cost;
}

constexpr std::size_t beyond_steps = 10;  // rows from gap to gap: nearer, the stamps are in steps near to the period

// What is gained where rows are lost by turns: distance and length of a gap are then as likely as they are frequent, not each for itself. Of every
// second row it is a longer period.
double gain_by_turns(const StampModel& model, std::span<const double> times, std::size_t closest) {
  const double share = share_of(model, times);
  Kinds kinds;
  double gain = 0.0;
  for (std::size_t at = 1; at < model.gaps.size(); ++at) {
    const StampGap& gap = model.gaps[at];
    const std::size_t distance = gap.row - model.gaps[at - 1].row;
    if (distance < closest || gap.periods < 2) continue;
    gain += whole(gap.periods - 1) - std::log(share) - double(distance - 1) * std::log1p(-share);
    kinds[{gap.periods - 1, std::int64_t(distance)}] += 1.0;
  }
  return std::max(0.0, gain - told_by_kinds(kinds));
}

// What it takes to tell intervals that no clock makes: by kinds, in the best of some widths, and where in one, in cells.
double told_by_intervals(std::span<const double> times, double cell) {
  constexpr int widths = 8;
  double least = std::numeric_limits<double>::infinity();
  for (int octave = 0; octave < widths; ++octave) {
    Kinds kinds;
    for (std::size_t k = 1; k < times.size(); ++k) {
      const auto width = std::llround(std::ldexp((times[k] - times[k - 1]) / cell, -octave));
      kinds[{width < 0 ? 2 : 1, std::abs(width) + 1}] += 1.0;
    }
    least = std::min(least, told_by_kinds(kinds) + double(times.size()) * octave * std::numbers::ln2);
  }
  return least;
}

// Most of them come as many rows, two or more, after the one before: a driver may have written the stamps of a burst by a rate that is not the sensor's.
bool by_turns(const std::vector<StampGap>& gaps) {
  std::map<std::size_t, std::size_t> distances;
  std::size_t most = 0;
  for (std::size_t at = 1; at < gaps.size(); ++at)
    if (const std::size_t distance = gaps[at].row - gaps[at - 1].row; distance > 1)
      most = std::max(most, ++distances[distance]);
  return 2 * most > gaps.size();
}

// The likeliest reading with that scatter: rows follow a clock, and each may come some periods later than it would. `share`: of the rows that do. The
// period that is returned follows from the gaps, and they from the one that is given.
StampModel reading(std::span<const double> times, StampModel model, double cell, double gap, double share,
                   double limit) {
  constexpr std::size_t most_tracks = 8;
  constexpr double rarer = 5.0, rarest = 40.0, hopeless = 60.0, far = 32.0, longest = 1e15;
  const Noise noise(model.scatter, cell / model.period);
  share = std::clamp(share, 1e-5, 0.9);
  const double stay = -std::log1p(-share), rare = -std::log(share), rate = 1.0 / model.period;
  const double late_from = (gap - 3.0 * noise.scatter - 2.0 * noise.half) * model.period;
  model.gaps.clear(), model.cost = std::numeric_limits<double>::infinity();
  std::vector<std::pair<StampGap, std::size_t>> forks;  // and the place of the one before it, from 1
  std::vector<Track> tracks(2), next;                   // the first stamp may be a bad one
  tracks[0].begin_at(0.0, noise);
  tracks[1].begin_at((times[1] - times[0]) * rate - 1.0, noise);
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
      // A leap ahead is time that passed.
      if (cost >= noise.most) leap(off < 0.5 + noise.half ? 0.0 : std::max(0.0, std::round(off + track.carried)), true);
      if (!late || off < 0.5) continue;
      // Where stamps scatter by many periods it may be any of as many.
      const double around = std::min(noise.half + 3.0 * std::hypot(noise.scatter, track.spread()), far);
      for (double periods = std::max(1.0, std::floor(off - around)); periods < off + std::min(1.0, around) + 0.5;
           periods += 1.0)
        leap(periods, false);
    }
    std::ranges::sort(next, {}, &Track::cost);
    if (next.size() > most_tracks) next.resize(most_tracks);
    while (next.back().cost > next.front().cost + hopeless) next.pop_back();
    std::swap(tracks, next);
    if (tracks.front().cost > limit) return model;
  }
  for (std::size_t at = tracks.front().last_gap; at > 0; at = forks[at - 1].second)
    model.gaps.push_back(forks[at - 1].first);
  std::ranges::reverse(model.gaps);
  model.cost = tracks.front().cost - gain_by_turns(model, times, beyond_steps);
  model.period = slope_along(times, model, noise);
  return model;
}

// The scatter is the likeliest one, by halves. A smaller one gains a row no more than its logarithm: whoever cannot come below `limit` is left.
StampModel fit(std::span<const double> times, const StampModel& start, double cell, double gap, double share,
               double limit) {
  const auto read = [&](const StampModel& from, double likely) {
    const double gain = double(times.size()) * std::log(from.scatter / even_scatter);
    return reading(times, from, cell, gap, likely, limit + gain);
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
  const std::size_t width = std::clamp<std::size_t>(times.size() / 8, std::min<std::size_t>(64, times.size()), 512);
  std::vector<double> slopes;
  for (std::size_t row = 0; row + width <= times.size(); row += std::max(width, times.size() / 256))
    slopes.push_back(slope_of(times.subspan(row, width)));
  return value_at_rank(slopes, slopes.size() / 4);
}

// Periods by the phases of the stamps, which agree in the true one whatever rows are missing: the mean over windows of |sum exp(2 pi i f t)|^2
// is n + n (n - 1) exp(-4 pi^2 scatter^2) there, and n elsewhere (Rayleigh's test); its multiples, and those of coarse steps, agree too.
std::vector<std::pair<double, double>> common_phases(std::span<const double> times, double slope) {
  constexpr double least = 0.95, most = 4.5, steps = 4.0;  // frequencies: of 1 / slope
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
  peaks.resize(std::min<std::size_t>(peaks.size(), 6));
  return peaks;
}

// Periods above a step by up to a third, which phases do not tell: once in 1 / (1 - step / period) steps no row falls into one. Of each octave of such
// beats the one with most of the steps without a row.
std::vector<double> beats(std::span<const double> times, double step) {
  constexpr double longest = 64.0, slowest = 1e-3, fastest = 0.25;
  constexpr std::size_t width = 5;  // quarters of a step
  std::vector<double> empty, periods;
  double end = 0.0;
  for (std::size_t k = 1; k < times.size(); ++k) {
    const double steps = std::round((times[k] - times[k - 1]) / step);
    if (steps > longest) continue;  // a pause, which is cut out
    for (double more = 1.0; more < steps; more += 1.0) empty.push_back(end + more);
    end += steps;
  }
  const double share = double(empty.size()) / end;
  for (double each = slowest; each < std::min(2.0 * share, fastest);) {
    double best = 0.0, beat = each;
    for (const double octave = 2.0 * each; each < octave; each *= 1.0 + 0.5 / end) {
      const auto cells = std::size_t(4.0 / each);
      std::vector<double> folded(cells + width);
      for (const double place : empty)
        folded[std::size_t((place * each - std::floor(place * each)) * double(cells))] += 1.0;
      for (std::size_t k = 0; k < width; ++k) folded[cells + k] += folded[k];
      const double all = 0.25 * double(width) * each * end;
      double found = std::accumulate(&folded[0], &folded[width], 0.0);
      for (std::size_t k = 0; k < cells; found += folded[k + width] - folded[k], ++k)
        if (const double gain = (std::min(all, found) - share * all) / std::sqrt(all); gain > best)
          best = gain, beat = each;
    }
    periods.push_back(step / (1.0 - beat));
  }
  return periods;
}

// Of rows that all keep within half a period along one straight line, so that none is missing; else 0.
double even_period(std::span<const double> times) {
  const double period = slope_of(times);
  double least = 0.0, most = 0.0;
  for (std::size_t k = 0; k < times.size(); ++k) {
    const double ahead = times[k] - times[0] - double(k) * period;
    least = std::min(least, ahead), most = std::max(most, ahead);
  }
  return most - least < 0.5 * period ? period : 0.0;
}

}  // namespace

std::vector<double> intervals_of(std::span<const double> times, std::size_t most) {
  std::vector<double> intervals;
  const std::size_t step = std::max<std::size_t>(1, times.size() / most);
  for (std::size_t k = 1; k < times.size(); k += step) intervals.push_back(times[k] - times[k - 1]);
  return intervals;
}

StampModel real_intervals(std::span<const double> times, double gap) {
  constexpr std::size_t around = 32;  // rows, either way
  std::vector<double> some = intervals_of(times);
  const double usual = median(some);
  StampModel model{.period = usual, .adds_up = true, .gaps = {}};
  double passed = times.back() - times.front(), rows = double(times.size() - 1);
  for (std::size_t k = 1; k < times.size(); ++k) {
    const double interval = times[k] - times[k - 1], shortest = interval / gap;  // that is none
    if (!(shortest > usual)) continue;
    const std::size_t from = k > around ? k - around : 1, to = std::min(k + around, times.size() - 1);
    std::vector<double> near = intervals_of(times.subspan(from - 1, to - from + 2), times.size());
    const double periods = interval / median(near);
    const bool whole = periods > 1.5 && std::abs(periods - std::round(periods)) < 0.15;
    const std::size_t as_long = std::min(whole ? near.size() / 4 : 2, near.size() - 1);
    if (!(shortest > value_at_rank(near, near.size() - 1 - as_long))) continue;
    model.gaps.push_back({k, 2});
    passed -= interval, rows -= 1.0;
  }
  if (rows > 0.0) model.period = passed / rows;
  for (StampGap& g : model.gaps)
    g.periods = std::max<std::int64_t>(2, std::llround((times[g.row] - times[g.row - 1]) / model.period));
  return model;
}

StampModel fit_stamps(std::span<const double> times, double gap) {
  constexpr std::size_t enough = std::size_t{1} << 12, often = 64;
  constexpr double usual_scatter = 0.1, near_scatter = 0.02, phases_agree = 0.13, is_known = 1e-3, margin = 10.0;
  constexpr double any = std::numeric_limits<double>::infinity();
  StampModel best{.cost = any, .gaps = {}};
  if (times.size() < 2) return best;
  const auto [least, most] = std::ranges::minmax(times);
  const double slope = low_slope(times);
  if (!std::isfinite(most - least) || !(slope > 0.0)) return best;
  std::span<const double> some = times.first(std::min(times.size(), enough));
  const double rows = double(some.size()), fine = 10.0 * even_scatter * slope, steps_cost = 20.0;
  double step = resolution_of(times, slope), cell = std::max(step, fine);
  std::vector<StampModel> readings;
  const auto consider = [&](double period, double scatter) {
    readings.push_back(fit(some, {.period = period, .scatter = scatter, .gaps = {}}, cell, gap,
                           std::max(0.0, 1.0 - period / slope), best.cost + margin));
    if (readings.back().cost < best.cost) best = readings.back();
  };
  consider(slope, usual_scatter);
  if (!(best.gaps.empty() && best.scatter < 2.0 * even_scatter))
    for (const auto& [power, period] : common_phases(some, slope)) consider(period, usual_scatter);
  if (step > 0.5 * slope && step < 1.3 * slope && !best.gaps.empty())
    for (const double period : beats(some, step)) consider(period, near_scatter);
  if (cell > fine) {  // one that keeps to them needs none
    const double period = step * std::max(1.0, std::floor(best.period / step + 0.1));
    StampModel keeps =
        fit(some, {.period = period, .scatter = near_scatter, .gaps = {}}, fine, gap, share_of(best, some), any);
    keeps.cost -=
        std::log(rows) + std::max(0.0, steps_cost - gain_by_turns(keeps, some, beyond_steps));  // its rate is known
    readings.push_back(std::move(keeps));
    if (readings.back().cost < best.cost) best = readings.back(), step = 0.0, cell = fine;
  }
  bool doubtful = std::ranges::any_of(readings, [&](const StampModel& other) {
    return std::abs(other.period / best.period - 1.0) > std::max(3.0 / rows, is_known) &&
           other.cost < best.cost + margin;
  });
  if (const double even = best.gaps.empty() && gap >= 1.5 ? even_period(times) : 0.0; even > 0.0)
    best.period = even;
  else
    // What is missing is counted with the period that is given: the record lasts as long as its stamps say.
    for (int round = 0; round < 6; ++round) {
      const double period = best.period;
      best = reading(times, best, cell, gap, share_of(best, round > 0 ? times : some), any);
      const double found = std::exchange(best.period, period);
      if (std::abs(found - period) * double(times.size()) < 0.005 * period) break;
      best.period = found;
    }
  if (!best.gaps.empty()) {
    // Around the middle one, is it the intervals that scatter?
    some = times.subspan(std::min(best.gaps[best.gaps.size() / 2].row, times.size() - some.size()), some.size());
    const std::vector<double> intervals = intervals_of(some, enough);
    std::vector<double> sorted = intervals;
    const double usual = median(sorted);
    std::vector<StampGap> jumps;
    for (std::size_t k = 0; k < intervals.size(); ++k)
      if (intervals[k] > gap * usual) jumps.push_back({k, 2});
    const double share = share_of(best, times), decisive = margin + 0.05 * rows;
    const StampModel clock = reading(some, best, cell, gap, share, any);
    const bool regular = by_turns(jumps);
    const double gain = regular ? gain_by_turns(clock, some, 2) - gain_by_turns(clock, some, beyond_steps) : 0.0;
    const double less =
        often * clock.gaps.size() > some.size() ? clock.cost - gain - told_by_intervals(some, cell) : 0.0;
    if (less > decisive && !regular && std::ranges::min(intervals) > 0.0) return real_intervals(times, gap);
    doubtful = doubtful || less > margin;
    best.bursts = regular && less > margin && by_turns(real_intervals(times, gap).gaps);
  }
  const double behind = double(best.gaps.size()) / double(times.size());
  const double off = std::hypot(best.scatter * std::sqrt(12.0), step / best.period) * std::pow(behind, 1.5);
  const bool agree = step < best.period && std::exp(-2.0 * std::pow(std::numbers::pi * best.scatter, 2)) > phases_agree;
  best.sure = !doubtful && behind <= 0.6 && (agree || off < is_known);
  return best;
}

IncrementsChoice choose_increments(std::span<const double> times_s, const StampModel& model) {
  constexpr std::size_t fewest = 40, parts = 16;
  const std::size_t n = times_s.size(), each = n / parts;
  if (n < fewest) return {false, "too few rows to tell whether the stamps jitter"};
  if (!(model.period > 0.0)) return {false, "the times do not grow"};
  std::vector<double> ahead(n, 0.0);
  for (std::size_t k = 1, at = 0; k < n; ++k) {
    const StampGap gap = at < model.gaps.size() && model.gaps[at].row == k ? model.gaps[at++] : StampGap{k, 1, false};
    ahead[k] = ahead[k - 1];
    if (!gap.anew || gap.periods == 1) ahead[k] += times_s[k] - times_s[k - 1] - double(gap.periods) * model.period;
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
    return std::sqrt(std::accumulate(squares.begin(), largest, 0.0) / double(largest - squares.begin()));
  };
  const std::size_t far = std::min<std::size_t>(n / 8, 32);
  const double jitter = scatter(1) / std::sqrt(6.0);  // of a stamp, if each is off by itself
  const double resolution = resolution_of(times_s, model.period);
  const double growth = jitter > 1e-9 * model.period ? scatter(far) / std::max(scatter(1), resolution) : 0.0;
  // Of the rate from a sixteenth to the next, by the means of both.
  const auto rows = double(each);
  std::vector<double> means, rates;
  for (std::size_t part = 0; part < parts; ++part) {
    const std::span<const double> rows_of = std::span(ahead).subspan(part * each, each);
    means.push_back(std::accumulate(rows_of.begin(), rows_of.end(), 0.0) / rows);
    if (part > 0) rates.push_back((means[part] - means[part - 1]) / (rows * model.period));
  }
  std::ranges::sort(rates);
  const double change = rates[parts - 3] - rates[1];
  const bool paused = std::ranges::any_of(model.gaps, &StampGap::anew);  // the stamps around are off
  const double spread = std::max(jitter, scatter(far) / std::sqrt(6.0)) * std::sqrt(double(far) / rows);
  const double explained = (6.0 * (spread + (paused ? jitter : 0.0)) + 2.0 * resolution) / (rows * model.period);
  const std::string said =
      fmt::format("over {} rows the scatter of the stamps is {:.2g} times that over one", far, growth);
  if (model.adds_up) return {false, "intervals that vary each by itself explain the stamps better than an even clock"};
  if (model.bursts) return {true, "rows may come in bursts: the period is in doubt"};
  if (growth > std::pow(double(far), 0.25)) return {false, said + ": it adds up, the intervals are real"};
  if (!model.sure) return {true, "the period is in doubt"};
  if (change > std::max(steady_rate, explained))
    return {false, fmt::format("the rate changes by {:.2g} % within the record", 100.0 * change)};
  if (growth == 0.0) return {true, "the stamps are even"};
  return {true, said + ": it does not add up, the sampling is even and the stamps jitter"};
}

}  // namespace turncal
