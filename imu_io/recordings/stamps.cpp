#include "imu_io/recordings/stamps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>

#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

constexpr std::size_t enough = std::size_t{1} << 12;  // rows that tell readings apart
constexpr std::size_t fewest = 40;                    // rows that tell anything
constexpr std::size_t longest_span = 32;              // rows
constexpr double any = std::numeric_limits<double>::infinity();
constexpr double sure_by = 4.6;        // nats: 100 to 1
constexpr double longest_round = 8.0;  // of a loop, in usual rounds

// Returns the step through a long record of which about `most` rows tell enough.
std::size_t stride_of(std::size_t rows, std::size_t most = std::size_t{1} << 17) {
  return std::max<std::size_t>(1, rows / most);
}

// Returns the step in which coarse stamps are written: the longest one of which all intervals are multiples. 0: none is seen.
double resolution_of(std::span<const double> times, double period) {
  constexpr std::size_t most = 4096, tries = 32;
  constexpr double longest = 16.0, least = 1e-6;  // in periods
  std::vector<double> intervals;                  // each unlike the one before
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

// How stamps follow their clock, in periods.
struct Noise {
  Noise(double s, double cell) : scatter(s), half(0.5 * cell) {}
  double scatter, half;  // standard deviation; half of a stamp's cell
  double walk = std::pow(scatter / std::max(32.0, 64.0 * scatter * scatter), 2);  // of the phase in a row
  double wander = 1e-6;                                                           // of the rate in a row
  double start = scatter * scatter + half * half / 3.0;                           // variance of a stamp
  double normal = std::log(std::sqrt(start) * std::sqrt(2.0 * std::numbers::pi) / (2.0 * half));
  double anywhere = -std::log(std::min(1.0, 2.0 * half));  // -log of a stamp that may be in any cell of a period
  double most = 16.0 + anywhere;
};

// One reading of the stamps up to a row, in periods: the rows that are missing, and a Kalman filter of the clock's phase and rate.
class Track {
 public:
  double cost = 0.0;
  std::int64_t missing = 0;
  double carried = 0.0;       // sum of what pauses lasted beyond whole periods
  std::size_t last_fork = 0;  // place in the list of forks, from 1
  bool held = false;          // the row came late, or waited behind one that did

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
  // Returns -log of the stamp's likelihood, and updates the clock by it.
  double follow(double off, const Noise& noise) {
    const double variance = v_ + noise.scatter * noise.scatter, sigma = std::sqrt(variance);
    double mean = 0.0, less = 0.0, price = 0.0;  // of a standard normal cut to the cell: mean, 1 - variance
    if (noise.half < 0.5 * sigma) {
      const double all = variance + noise.half * noise.half / 3.0;
      price = 0.5 * off * off / all + noise.normal;
      mean = off * sigma / all, less = variance / all;
    } else {
      const double z = std::abs(off), low = (z - noise.half) / sigma, high = (z + noise.half) / sigma;
      if (low < -3.0) return 0.0;  // the stamp says nothing
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

// Fits the period along the gaps by least squares. Behind a pause of no whole number of periods the line begins anew.
double slope_along(std::span<const double> times, const StampModel& model) {
  double both = 0.0, squares = 0.0, first = times[0];
  std::int64_t origin = 0, counter = 0;
  std::array<double, 5> s{};  // sums of 1, m, m^2, y and m y over a piece
  const auto close = [&] {
    both += s[4] - s[1] * s[3] / std::max(1.0, s[0]);
    squares += s[2] - s[1] * s[1] / std::max(1.0, s[0]);
    s = {};
  };
  for (std::size_t k = 0, at = 0, late = 0; k < times.size(); ++k, ++counter) {
    if (at < model.gaps.size() && model.gaps[at].row == k) {
      counter += model.gaps[at].periods - 1;
      if (model.gaps[at++].anew) close(), origin = counter, first = times[k];
    }
    if (late < model.held.size() && model.held[late] == k) {
      ++late;
      continue;
    }
    const double m = double(counter - origin), y = times[k] - first - m * model.period;
    s[0] += 1.0, s[1] += m, s[2] += m * m, s[3] += y, s[4] += m * y;
  }
  close();
  return model.period + (squares > 0.0 ? both / squares : 0.0);
}

double slope_of(std::span<const double> times) { return slope_along(times, {}); }

double share_of(const StampModel& model, std::span<const double> times) {
  return (double(model.gaps.size()) + 0.5) / (double(times.size()) + 1.0);
}

double whole(std::int64_t n) { return std::log(double(n)) + std::log(double(n) + 1.0); }  // -log of 1 / n(n + 1)

// Returns the cost of telling numbers one by one. Each kind is named once, and then is as likely as it is frequent.
double told_by_kinds(const std::map<std::int64_t, double>& kinds) {
  double count = 0.0, cost = 0.0;
  for (const auto& [kind, often] : kinds) count += often;
  std::int64_t before = 0;
  for (const auto& [kind, often] : kinds) {
    cost += whole(std::abs(kind - before) + 1) + often * std::log(count / std::max(often, 1.0));
    before = kind;
  }
  return cost;
}

// The same, or by turns if that costs less: a number repeats the one `turn` places before, and the exceptions are told.
double told(std::span<const std::int64_t> numbers) {
  constexpr std::size_t longest = 64;
  std::size_t turn = 0;
  double most = 0.0;
  for (std::size_t each = 1; each <= longest && 4 * each < numbers.size(); ++each) {
    const double same = std::inner_product(numbers.begin() + std::ptrdiff_t(each), numbers.end(), numbers.begin(), 0.0,
                                           std::plus(), std::equal_to());
    if (const double share = same / double(numbers.size() - each); share > most) most = share, turn = each;
  }
  std::map<std::int64_t, double> all, others;
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    all[numbers[k]] += 1.0;
    if (k < turn || numbers[k] != numbers[k - turn]) others[numbers[k]] += 1.0;
  }
  const double rows = double(numbers.size() - turn);
  const double by_turns = told_by_kinds({{0, rows * most}, {1, std::round(rows * (1.0 - most))}});
  return std::min(told_by_kinds(all), turn > 0 ? told_by_kinds(others) + by_turns + whole(std::int64_t(turn)) : any);
}

// Returns the cost of intervals that no clock makes: each by the bin it is in, of the best width, and by its cell in the bin.
double told_by_intervals(std::span<const double> times, double cell) {
  constexpr int widths = 8;
  double least = any;
  std::vector<std::int64_t> numbers(times.size() - 1);
  for (int octave = 0; octave < widths; ++octave) {
    for (std::size_t k = 0; k < numbers.size(); ++k)
      numbers[k] = std::llround(std::ldexp((times[k + 1] - times[k]) / cell, -octave));
    least = std::min(least, told(numbers) + double(times.size()) * octave * std::numbers::ln2);
  }
  return least;
}

// Returns the likeliest reading with this scatter and share of gaps. The gaps follow from the given period, and the returned period from the gaps. A
// reading is given up when no smaller scatter can bring it below `limit`: it gains at most its logarithm in each row.
StampModel reading(std::span<const double> times, StampModel model, double gap, double share, double limit) {
  constexpr std::size_t most_tracks = 8;
  constexpr double rarer = 5.0, rarest = 40.0, hopeless = 60.0, far = 32.0, longest = 1e15, service = 0.1,
                   slowest = 0.5;
  const Noise noise(model.scatter, model.cell / model.period);
  share = std::clamp(share, 1e-5, 0.9);
  limit += double(times.size()) * std::log(model.scatter / even_scatter);
  const double stay = -std::log1p(-share), rare = -std::log(share), rate = 1.0 / model.period;
  const double onset = noise.anywhere + std::log((double(times.size()) + 1.0) / (double(model.held.size()) + 0.5)),
               served = std::max(0.0, noise.anywhere + std::log(service));
  const double late_from = gap - 3.0 * noise.scatter - 2.0 * noise.half;
  model.gaps.clear(), model.held.clear(), model.cost = any;
  std::vector<std::pair<StampGap, std::size_t>> forks;  // with the place of the fork before, from 1
  std::vector<Track> tracks(2), next;                   // in the second one the first stamp is bad
  tracks[0].begin_at(0.0, noise);
  tracks[1].begin_at((times[1] - times[0]) * rate - 1.0, noise);
  const auto join = [&](const Track& track) {
    const auto same = std::ranges::find_if(next, [&](const Track& other) {
      return other.missing == track.missing && other.held == track.held &&
             std::abs(other.level() - track.level()) < noise.scatter &&
             std::max(other.spread(), track.spread()) < 2.0 * std::min(other.spread(), track.spread());
    });
    if (same == next.end())
      next.push_back(track);
    else if (track.cost < same->cost)
      *same = track;
  };
  for (std::size_t k = 0; k < times.size(); ++k) {
    const double ahead = (times[k] - times[0]) * rate - double(k);
    const double interval = k > 0 ? (times[k] - times[k - 1]) * rate : 1.0;
    const bool late = k > 0 && interval > late_from;
    if (k > 0)
      for (Track& track : tracks) track.predict(noise);
    if (const double off = tracks[0].off(ahead); tracks.size() == 1 && (!late || off < 0.5)) {
      Track stays = tracks[0];
      if (const double cost = stays.follow(off, noise); cost < noise.most) {  // the usual case
        stays.cost += stay + cost, stays.held = false;
        tracks[0] = stays;
        continue;
      }
    }
    next.clear();
    for (const Track& track : tracks) {
      const double off = std::clamp(track.off(ahead), -longest, longest);
      Track stays = track;
      const double cost = stays.follow(off, noise);
      stays.cost += stay + cost, stays.held = false;
      join(stays);
      if (cost > onset && off > 0.0 && (!track.held || (interval >= 0.0 && interval < slowest))) {
        Track waits = track;
        waits.cost += stay + (track.held ? served + interval / service : onset + 2.0 * std::log1p(off));
        waits.held = true, waits.last_fork = forks.size() + 1;
        forks.push_back({{k, 0, false}, track.last_fork});
        join(waits);
      }
      const auto leap = [&](double periods, bool anew) {
        Track leaps = track;
        leaps.missing += std::int64_t(periods), leaps.held = false;
        leaps.cost += rare + std::log(periods + 1.0);
        if (anew) {
          leaps.carried += off - periods;
          leaps.begin_at(ahead, noise);
          leaps.cost += (periods > 0.0 ? rarer : rarest) + noise.anywhere;
        } else {
          leaps.cost += std::log(std::max(periods, 1.0)) + leaps.follow(off - periods, noise);  // 1 / n(n + 1)
        }
        leaps.last_fork = forks.size() + 1;
        forks.push_back({{k, std::int64_t(periods) + 1, anew}, track.last_fork});
        join(leaps);
      };
      // A leap ahead is time that passed.
      if (k > 0 && cost >= noise.most)
        leap(off < 0.5 + noise.half ? 0.0 : std::max(0.0, std::round(off + track.carried)), true);
      if (!(late || track.held) || off < 0.5) continue;
      // Stamps that scatter by many periods leave as many numbers possible.
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
  for (std::size_t at = tracks.front().last_fork; at > 0; at = forks[at - 1].second)
    if (const StampGap& fork = forks[at - 1].first; fork.periods > 0)
      model.gaps.push_back(fork);
    else
      model.held.push_back(fork.row);
  std::ranges::reverse(model.gaps);
  std::ranges::reverse(model.held);
  model.cost = tracks.front().cost;
  if (times.size() <= enough) {  // gaps may come by turns
    std::vector<std::int64_t> missing(times.size());
    double gain = 0.0;
    for (std::size_t at = 0; at < model.gaps.size(); ++at) {
      const StampGap& fork = model.gaps[at];
      const bool on_end = at > 0 && model.gaps[at - 1].row + 1 == fork.row;  // gaps at every row mean a longer period
      if (!fork.anew && !on_end) missing[fork.row] = fork.periods - 1, gain += rare - stay + whole(fork.periods - 1);
    }
    if (gain > 0.0)
      model.cost -= std::max(0.0, gain + double(times.size()) * stay - told(std::span(missing).subspan(1)));
  }
  model.period = slope_along(times, model);
  return model;
}

// Follows a first reading to its likeliest scatter.
StampModel fit(std::span<const double> times, const StampModel& first, double gap, double limit) {
  StampModel best = reading(times, first, gap, share_of(first, times), limit);
  for (const double factor : {0.25, 0.5, 2.0, 0.7, 1.4})
    for (bool better = true; better && std::isfinite(best.cost);) {
      StampModel other = best;
      other.scatter = std::max(even_scatter, best.scatter * factor);
      if (other.scatter == best.scatter) break;
      other = reading(times, other, gap, share_of(best, times), limit);
      better = factor < 1.0 ? other.cost <= best.cost : other.cost < best.cost;
      if (better) best = std::move(other);
    }
  return best;
}

// Returns a low quartile of the slopes over parts of the record: between bursts these parts have no gaps.
double low_slope(std::span<const double> times) {
  const std::size_t width = std::clamp<std::size_t>(times.size() / 8, std::min<std::size_t>(64, times.size()), 512);
  std::vector<double> slopes;
  for (std::size_t row = 0; row + width <= times.size(); row += std::max(width, times.size() / 256))
    slopes.push_back(slope_of(times.subspan(row, width)));
  return value_at_rank(slopes, slopes.size() / 4);
}

// Returns periods in which the phases of the stamps agree, whatever rows are missing (Rayleigh's test). In the true one the mean over windows of
// |sum exp(2 pi i f t)|^2 is n + n (n - 1) exp(-4 pi^2 scatter^2), elsewhere n. Multiples of the frequency, and coarse steps, agree too.
std::vector<std::pair<double, double>> common_phases(std::span<const double> times, double slope) {
  constexpr double least = 0.95, most = 4.5, steps = 4.0;  // of the frequencies, in 1 / slope
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

// Returns how much more long intervals cost as lost rows (whole periods, usual scatter) than as slow rounds (exponential in length).
double more_as_losses(const std::vector<std::pair<std::size_t, double>>& found, double scatter) {
  constexpr double decay = 2.0, most = 100.0;
  double more = 0.0;
  std::map<std::int64_t, double> lost;
  for (const auto& [row, x] : found) {
    if (x >= longest_round) continue;
    const double n = std::max(2.0, std::round(x)), sigma = scatter * std::sqrt(n);
    lost[std::int64_t(n) - 2] += 1.0;
    const double whole_rows = 0.5 * std::pow((x - n) / sigma, 2) + std::log(sigma * std::sqrt(2.0 * std::numbers::pi));
    more += std::min(whole_rows, most) - decay * (x - 1.0) + std::log(decay);
  }
  return more + told_by_kinds(lost);
}

}  // namespace

std::vector<double> intervals_of(std::span<const double> times, std::size_t most) {
  std::vector<double> intervals;
  const std::size_t step = stride_of(times.size(), most);
  for (std::size_t k = 1; k < times.size(); k += step) intervals.push_back(times[k] - times[k - 1]);
  return intervals;
}

StampModel real_intervals(std::span<const double> times, double gap) {
  constexpr std::size_t around = 32;  // rows on either side
  std::vector<double> some = intervals_of(times);
  const double usual = median(some);
  for (double& interval : some) interval = std::abs(interval - usual) / usual;
  const double scatter = std::max(1.5 * median(some), even_scatter);
  StampModel model{.period = usual, .adds_up = true, .gaps = {}};
  std::vector<std::pair<std::size_t, double>> found;
  for (std::size_t k = 1; k < times.size(); ++k) {
    const double interval = times[k] - times[k - 1];
    if (!(interval > gap * usual)) continue;
    const std::size_t from = k > around ? k - around : 1, to = std::min(k + around, times.size() - 1);
    std::vector<double> near = intervals_of(times.subspan(from - 1, to - from + 2), times.size());
    const double periods = interval / median(near);
    if (periods > gap) found.emplace_back(k, periods);
  }
  const double more = more_as_losses(found, scatter);
  model.sure = more == 0.0 || std::abs(more) > sure_by;
  double passed = times.back() - times.front(), rows = double(times.size() - 1);
  for (const auto& [row, periods] : found) {
    if (more > 0.0 && periods < longest_round) continue;
    model.gaps.push_back({row, 2, true});
    passed -= times[row] - times[row - 1], rows -= 1.0;
  }
  if (rows > 0.0) model.period = passed / rows;
  for (StampGap& g : model.gaps)
    g.periods = std::max<std::int64_t>(2, std::llround((times[g.row] - times[g.row - 1]) / model.period));
  return model;
}

namespace {

// How far each stamp is ahead of an even clock. A held stamp counts as far as the one before it.
class Ahead {
 public:
  Ahead(std::span<const double> times, const StampModel& model) : times_(times), model_(model) {
    begins_.emplace_back(0, times[0]);
    for (const StampGap& gap : model.gaps) {
      const bool unknown = gap.anew && gap.periods > 1;  // the pause may have had any length
      const double passed = unknown ? times[gap.row] - times[gap.row - 1] : double(gap.periods) * model.period;
      begins_.emplace_back(gap.row, begins_.back().second + passed - model.period);
    }
  }
  std::size_t size() const { return times_.size(); }
  double operator[](std::size_t row) const {
    while (row > 0 && std::ranges::binary_search(model_.held, row)) --row;
    const auto behind = std::ranges::upper_bound(begins_, row, {}, &std::pair<std::size_t, double>::first);
    return times_[row] - std::prev(behind)->second - double(row) * model_.period;
  }

 private:
  const std::span<const double> times_;
  const StampModel& model_;
  std::vector<std::pair<std::size_t, double>> begins_;  // rows behind gaps, and the stamp that row 0 would have
};

// Returns the rms of p[k + 2m] - 2 p[k + m] + p[k] without the largest hundredth, which are delays of the host and pauses.
double bend_over(const Ahead& ahead, std::size_t m) {
  std::vector<double> squares;
  if (ahead.size() <= 2 * m) return 0.0;
  for (std::size_t k = 2 * m; k < ahead.size(); k += stride_of(ahead.size())) {
    const double bend = ahead[k] - 2.0 * ahead[k - m] + ahead[k - 2 * m];
    squares.push_back(bend * bend);
  }
  const auto largest = squares.end() - std::ptrdiff_t(squares.size() / 100 + 1);
  std::nth_element(squares.begin(), largest, squares.end());
  return std::sqrt(std::accumulate(squares.begin(), largest, 0.0) / double(largest - squares.begin()));
}

// Returns whether errors add up. The bound is the geometric mean of their growth when stamps are off independently and when intervals are.
bool adds_up(const Ahead& ahead, std::size_t near, double resolution) {
  const std::size_t far = std::min(ahead.size() / 8, near * longest_span);
  const double before = std::max({bend_over(ahead, near), bend_over(ahead, near * 2 / 3), bend_over(ahead, near / 2)});
  return bend_over(ahead, far) > std::max(before, resolution) * std::pow(double(far) / double(near), 0.25);
}

// Returns the change of the rate over sixteenths of the record, by their medians; 0: scatter or a drifting clock explains it.
double rate_change(std::span<const double> times, const StampModel& model) {
  constexpr std::size_t parts = 16;
  const Ahead ahead(times, model);
  std::vector<double> middles, rates;
  const std::size_t each = times.size() / parts;
  if (each < 2) return 0.0;
  const double rows = double(each),
               scatter = std::max(bend_over(ahead, 1), bend_over(ahead, longest_span)) / std::sqrt(6.0);
  const bool paused = model.adds_up || std::ranges::any_of(model.gaps, &StampGap::anew);  // stamps beside it are off
  for (std::size_t part = 0; part < parts; ++part) {
    std::vector<double> some;
    for (std::size_t row = part * each; row < (part + 1) * each; row += stride_of(times.size()))
      some.push_back(ahead[row]);
    middles.push_back(median(some));
    if (part > 0) rates.push_back((middles[part] - middles[part - 1]) / (rows * model.period));
  }
  std::ranges::sort(rates);
  const double change = rates[parts - 3] - rates[1],
               within = std::sqrt(double(longest_span) / rows) + (paused ? 1.0 : 0.0);
  const double explained = (6.0 * scatter * within + 2.0 * resolution_of(times, model.period)) / (rows * model.period);
  return change > std::max(steady_rate, explained) ? change : 0.0;
}

}  // namespace

StampModel fit_stamps(std::span<const double> times, double gap) {
  constexpr double usual_scatter = 0.1, near_scatter = 0.02, phases_agree = 0.13, is_known = 1e-3, most_behind = 0.6;
  StampModel best{.cost = any, .gaps = {}};
  if (times.size() < 2) return best;
  const auto [least, most] = std::ranges::minmax(times);
  const double slope = low_slope(times);
  if (!std::isfinite(most - least) || !(slope > 0.0)) return best;
  std::span<const double> some = times.first(std::min(times.size(), enough));
  const double rows = double(some.size()), fine = 10.0 * even_scatter * slope, step = resolution_of(times, slope);
  std::vector<StampModel> readings;
  // A period is told to a fine cell, and then to what the record tells; the filter learns the step, too.
  const auto name_of = [&](const StampModel& model) {
    return whole(std::llround(slope / fine)) + std::log(rows) * (step > fine && model.cell == fine ? -1.0 : 1.0);
  };
  const auto consider = [&](double period, double scatter, double cell) {
    const double limit = cell < step ? any : best.cost + sure_by;
    const StampModel start{.period = period, .scatter = scatter, .cell = cell, .gaps = {}};
    const StampModel first = reading(some, start, gap, std::max(0.0, 1.0 - period / slope), limit);
    if (!readings.empty() && double(first.gaps.size()) > most_behind * rows) return;
    readings.push_back(fit(some, first, gap, limit));
    readings.back().cost += name_of(readings.back());
    if (readings.back().cost < best.cost) best = readings.back();
  };
  const double cell = std::max(step, fine);
  consider(slope, usual_scatter, cell);
  if (!(best.gaps.empty() && best.held.empty() && best.scatter < 2.0 * even_scatter)) {
    consider(slope_of(some), usual_scatter, cell);
    for (const auto& [power, period] : common_phases(some, slope)) consider(period, usual_scatter, cell);
  }
  // A period that keeps to coarse steps needs no cell.
  if (cell > fine) consider(step * std::max(1.0, std::floor(best.period / step + 0.1)), near_scatter, fine);
  // Steps without a row that come back regularly may mean a period slightly longer than a step.
  std::vector<double> empty;
  for (const StampGap& found : best.cell < step && best.period < 1.5 * step ? best.gaps : std::vector<StampGap>())
    for (std::int64_t back = 1; back < found.periods && !found.anew; ++back)
      empty.push_back(some[found.row] - double(back) * step);
  if (empty.size() >= fewest)
    for (const auto& [power, period] : common_phases(empty, 4.6 * step))
      consider(step / (1.0 - std::abs(std::remainder(step / period, 1.0))), near_scatter, step);
  bool doubtful = std::ranges::any_of(readings, [&](const StampModel& other) {
    return std::abs(other.period / best.period - 1.0) > std::max(3.0 / rows, is_known) &&
           other.cost < best.cost + sure_by;
  });
  // No row is missing if all keep within half a period of one straight line.
  const StampModel even{.period = slope_of(times), .gaps = {}};
  double early = 0.0, late = 0.0;
  for (std::size_t row = 0; row < times.size(); ++row) {
    const double ahead = times[row] - times[0] - double(row) * even.period;
    early = std::min(early, ahead), late = std::max(late, ahead);
  }
  if (best.gaps.empty() && best.held.empty() && gap >= 1.5 && late - early < 0.5 * even.period)
    best.period = even.period;
  else
    // Missing rows are counted with the given period, so that the record lasts as long as its stamps say.
    for (int round = 0; round < 6; ++round) {
      const double period = best.period;
      best = reading(times, best, gap, share_of(best, round > 0 ? times : some), any);
      const double found = std::exchange(best.period, period);
      if (std::abs(found - period) * double(times.size()) < 0.005 * period) break;
      best.period = found;
    }
  // Real intervals may explain the rows around the middle gap better.
  const std::size_t middle = best.gaps.empty() ? times.size() / 2 : best.gaps[best.gaps.size() / 2].row;
  some = times.subspan(std::min(middle, times.size() - some.size()), some.size());
  const double clock = reading(some, best, gap, share_of(best, times), any).cost + name_of(best);
  const bool may_be = times.size() >= fewest && std::ranges::is_sorted(times, std::less_equal());
  const double less = may_be ? clock - told_by_intervals(some, fine) : -any;
  if (less > -sure_by) {
    StampModel real = real_intervals(times, gap);
    const std::size_t longer_than_bursts = std::clamp<std::size_t>(times.size() / 64, 1, 64);
    const bool same = std::abs(real.period / best.period - 1.0) < is_known &&
                      std::ranges::equal(real.gaps, best.gaps, {}, &StampGap::row, &StampGap::row);
    if (same && best.scatter < 2.0 * even_scatter) return best;  // both readings are the same
    const bool walk = rate_change(times, real) > 0.0 ||
                      adds_up({times, real}, longer_than_bursts, std::max(step, even_scatter * slope));
    if (same && best.scatter < near_scatter && !walk) return best;
    real.sure = real.sure && less > sure_by && walk;
    return real;
  }
  const double behind = double(best.gaps.size()) / double(times.size()), coarse = best.cell > fine ? step : 0.0;
  const double off = std::hypot(best.scatter * std::sqrt(12.0), coarse / best.period) * std::pow(behind, 1.5);
  const bool agree =
      coarse < best.period && std::exp(-2.0 * std::pow(std::numbers::pi * best.scatter, 2)) > phases_agree;
  best.sure = !doubtful && behind <= most_behind && (agree || off < is_known);
  return best;
}

IncrementsChoice choose_increments(std::span<const double> times_s, const StampModel& model) {
  if (times_s.size() < fewest) return {false, "too few rows to tell whether the stamps jitter", true};
  if (!(model.period > 0.0)) return {false, "the times do not grow", true};
  if (model.adds_up)
    return {false, "intervals that vary each by itself explain the stamps better than an even clock", model.sure};
  if (!model.sure) return {true, "the period is in doubt", false};
  if (model.scatter < 2.0 * even_scatter && model.held.empty() &&  // too little scatter for the reading to tell
      adds_up({times_s, model}, 1, std::max(1e-9 * model.period, resolution_of(times_s, model.period))))
    return {false, "the scatter of the stamps adds up, the intervals are real", true};
  if (const double change = rate_change(times_s, model); change > 0.0)
    return {false, fmt::format("the rate changes by {:.2g} % within the record", 100.0 * change), model.held.empty()};
  return {true, fmt::format("an even clock explains the stamps, to {:.2g} of a period", model.scatter), true};
}

}  // namespace turncal
