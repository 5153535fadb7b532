// Finds the period, the lost rows and the jitter in the stamps of rows.
//
// A reading of the stamps costs what it takes to tell all of them, in nats (Rissanen, 1978). An even clock puts row k at t0 + P (k + missing) + e,
// in steps; e is normal and independent. Rows are lost at random or by turns. A row may come late, and the rows behind it wait in a queue. A pause
// changes t0. The likeliest path through the rows is taken (Viterbi, 1967), out of eight; along each path a Kalman filter follows
// phase and rate, and learns from a stamp only that the time lies in its step. The search starts from the steepest part without gaps (for bursts), from
// the mean slope, and from periods in which all phases agree (for losses). Of real intervals each kind is named once, and then costs by how rare it is;
// or they come by turns.
//
// A reading is sure if all others cost 4.6 nats more (100 to 1). Real intervals also have to add up: the scatter of p[k + 2m] - 2 p[k + m] + p[k],
// p being the lead of the stamps over an even clock, grows with the root of m, or the rate changes by 200 ppm. Where a driver spaced the rows of a
// burst it does not grow. Not seen: an even sensor behind a host's clock in steps; where in a burst rows are missing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace turncal {

// A row that comes several periods after the one before. `anew`: the pause was no whole number of periods, or the clock was set.
struct StampGap {
  std::size_t row = 0;
  std::int64_t periods = 0;
  bool anew = false;
  bool operator==(const StampGap&) const = default;
};

inline constexpr double even_scatter = 1e-3;  // the smallest that is looked for
struct StampModel {
  double period = 0.0;              // 0: the times do not grow
  double scatter = 0.0;             // of a stamp, in periods
  double cell = 0.0;                // width to which a stamp is told: the step of coarse stamps
  double cost = 0.0;                // -log of the likelihood
  bool sure = true;                 // of the period and the gaps
  bool adds_up = false;             // no even clock: the intervals are real
  std::vector<StampGap> gaps;       // in order
  std::vector<std::size_t> held{};  // rows that came late, and rows that waited behind them
};
inline constexpr double steady_rate =
    2e-4;  // change of rate up to which a clock drifts; beyond it the sampling changes
// An interval shorter than `gap` periods, less the scatter of the stamps, is no gap.
StampModel fit_stamps(std::span<const double> times, double gap = 1.5);

// Takes the intervals as real. One longer than `gap` times the median of the 64 around is a slow round or lost rows; beyond eight times it is a gap.
StampModel real_intervals(std::span<const double> times, double gap);

// Returns the intervals from each stamp to the next; of a long record about `most` of them.
std::vector<double> intervals_of(std::span<const double> times, std::size_t most = std::size_t{1} << 17);

struct IncrementsChoice {
  bool even = true;  // the sampling is even, so `period` is right; else `intervals`
  std::string reason;
  bool sure = true;
};
IncrementsChoice choose_increments(std::span<const double> times_s, const StampModel& model);

}  // namespace turncal
