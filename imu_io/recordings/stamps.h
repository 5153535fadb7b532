// What the stamps of rows say: how long the period is, where rows are missing, and whether the sampling or the stamps jitter.
//
// Row k comes at t0 + P (k + missing) + e, written in steps: P the period, missing a whole number that only grows, e of each row by itself, normal
// with a few outliers. A clock that begins anew has another t0; time that passed meanwhile passed, so that the periods of all rows last as long as
// the stamps say. Of all ways to read the stamps so the most likely is taken (Viterbi, 1967; eight are kept), where a gap is as rare as the last
// reading found it, of n rows with 1 / n(n + 1), or all as likely as such distances and lengths are frequent; a new t0 is rarer. Along each a Kalman
// filter follows phase and rate of the clock; what it is told is that the stamp's step holds the time, so that a stamp in coarse steps that no row
// contradicts costs nothing. The scatter of e is the most likely one, P the slope of least squares along the gaps. The search begins at the steepest
// part without gaps (rows that come in bursts), at the periods in which all phases agree (rows that are lost), and at those whose beat with the step
// of the stamps shows in the steps without a row.
//
// P is sure where no other one is nearly as likely, at most 60 % of the rows come behind a gap, and either the step is shorter and the phases of e
// agree (exp(-2 (pi e)^2) above 0.13), or the n rows between two gaps tell it: to scatter sqrt(12 / n^3), below 0.1 %. Where every
// 64th row and more comes behind a gap, the intervals are told without a clock too: each kind is named once, and then as likely as it is frequent. If
// that takes less the intervals are real, or P is in doubt, as where the gaps come by turns: a driver may have written the stamps of a burst by a rate
// that is not the sensor's. Where it does not: let p be what the stamps are ahead of an even clock. If every stamp is off by itself (late,
// rounded), the scatter of p[k + 2m] - 2 p[k + m] + p[k] is the same for every m; if every interval is what it says, it grows with the root of m. Up
// to the geometric mean of both over 32 rows the sampling is even. Beyond it, or where the rate changes by more than 200 ppm from one sixteenth of
// the record to the next, the intervals are real. Not seen: an even sensor behind a host's clock in steps; where in a burst rows are missing.
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
  double period = 0.0;         // 0: the times do not grow
  double scatter = 0.0;        // of a stamp, in periods
  double cost = 0.0;           // -log of the likelihood
  bool sure = true;            // of the period
  bool adds_up = false;        // no even clock: the intervals are real
  bool bursts = false;         // its gaps may be a driver's
  std::vector<StampGap> gaps;  // in order
};
inline constexpr double steady_rate = 2e-4;  // change of a rate that is a clock's, not the sampling's
// `gap`: an interval of fewer periods, less what stamps scatter by, is none.
StampModel fit_stamps(std::span<const double> times, double gap = 1.5);

// Where the intervals are real: the mean one. A gap is longer than `gap` times the median, and than all but two of the 64 around; than all but a quarter
// of these, where it is a whole number of what is usual there, as of rows that were lost.
StampModel real_intervals(std::span<const double> times, double gap);

// From each row's stamp to the next one's; of long records of some of them.
std::vector<double> intervals_of(std::span<const double> times, std::size_t most = std::size_t{1} << 17);

struct IncrementsChoice {
  bool even = true;  // the sampling is: `period` is right, else `intervals`
  std::string reason;
};
IncrementsChoice choose_increments(std::span<const double> times_s, const StampModel& model);

}  // namespace turncal
