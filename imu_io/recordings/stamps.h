// What the stamps of rows say: how long the period is, where rows are missing, and whether the sampling or the stamps jitter.
//
// Readings of the stamps are weighed by what it takes to tell all of them, in nats (Rissanen, 1978). An even clock: row k comes at
// t0 + P (k + missing) + e, in steps, e normal and of each row by itself. Rows are lost at random, or by turns; a row may come late, and those behind
// it wait (a queue); after a pause t0 is another. The likeliest way through is taken (Viterbi, 1967; eight are kept); along each a Kalman filter
// follows phase and rate, told only that the stamp's step holds the time. The search begins at the steepest part without gaps (bursts), the mean, and
// periods in which all phases agree (losses). Real intervals: each kind is named once, and then as likely as it is frequent, or by turns.
//
// A reading is sure where others take 4.6 nats more (100 to 1). Real intervals also have to add up: p being what the stamps are ahead of an even clock,
// the scatter of p[k + 2m] - 2 p[k + m] + p[k] grows with the root of m, unless a driver spaced the rows of a burst; or the rate changes by 200 ppm.
// Not seen: an even sensor behind a host's clock in steps; where in a burst rows are missing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace turncal {

// A row that comes so many periods after the one before. `anew`: and no whole number of them, or the clock was set.
struct StampGap {
  std::size_t row = 0;
  std::int64_t periods = 0;
  bool anew = false;
  bool operator==(const StampGap&) const = default;
};

inline constexpr double even_scatter = 1e-3;  // no less is looked for
struct StampModel {
  double period = 0.0;              // 0: the times do not grow
  double scatter = 0.0;             // of a stamp, in periods
  double cell = 0.0;                // in which stamps are told: their step, where it is coarse
  double cost = 0.0;                // -log of the likelihood
  bool sure = true;                 // of the period and the gaps
  bool adds_up = false;             // no even clock: the intervals are real
  std::vector<StampGap> gaps;       // in order
  std::vector<std::size_t> held{};  // rows that came late, and those that waited behind them
};
inline constexpr double steady_rate = 2e-4;  // change of a rate that is a clock's, not the sampling's
// `gap`: an interval of fewer periods, less what stamps scatter by, is none.
StampModel fit_stamps(std::span<const double> times, double gap = 1.5);

// Where the intervals are real. Longer ones than `gap` times the median of the 64 around are slow rounds or lost rows; beyond eight a gap.
StampModel real_intervals(std::span<const double> times, double gap);

// From each row's stamp to the next one's; of long records of some of them.
std::vector<double> intervals_of(std::span<const double> times, std::size_t most = std::size_t{1} << 17);

struct IncrementsChoice {
  bool even = true;  // the sampling is: `period` is right, else `intervals`
  std::string reason;
  bool sure = true;
};
IncrementsChoice choose_increments(std::span<const double> times_s, const StampModel& model);

}  // namespace turncal
