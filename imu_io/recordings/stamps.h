// What the stamps of rows say: how long the period is, where rows are missing, and whether the sampling or the stamps jitter.
//
// Where the map does not say, the stamps do. Let p be what they are ahead of an even clock. If every stamp is off by itself (a late
// interrupt, a host that was busy, rounding), the scatter of p[k + 2m] - 2 p[k + m] + p[k] is the same for every m; if every interval is what it says,
// it grows with the root of m. Up to the geometric mean of both, over 32 rows, it is `period`; and so it is, too, for a sensor that was truly read
// at those times, since what one interval has too much the next has too little. Beyond it, or where the rate changes by more than 200 ppm
// (six times what the jitter explains, and twice the steps in which the stamps are written) from one sixteenth of the record to the next, it is
// `intervals`. A scatter below those steps is theirs. Not looked for: an even sensor behind a host's clock that is itself in steps; gaps within four
// rows of another one where stamps jitter by more than a third of the period.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace turncal {

// A row that comes so many periods after the one before. `anew`: and the clock was set, or stood for no whole number of them.
struct StampGap {
  std::size_t row = 0;
  std::int64_t periods = 0;
  bool anew = false;
  bool operator==(const StampGap&) const = default;
};

struct StampModel {
  double period = 0.0;         // 0: the times do not grow
  double scatter = 0.0;        // of a stamp, in periods
  double cost = 0.0;           // -log of the likelihood
  std::vector<StampGap> gaps;  // in order
};
// `gap`: an interval of fewer periods, less what stamps scatter by, is none.
StampModel fit_stamps(std::span<const double> times, double gap = 1.5);

// From each row's stamp to the next one's; of long records of some of them.
std::vector<double> intervals_of(std::span<const double> times, std::size_t most = std::size_t{1} << 17);

struct IncrementsChoice {
  bool even = true;  // the sampling is: `period` is right, else `intervals`
  std::string reason;
};
IncrementsChoice choose_increments(std::span<const double> times_s, const StampModel& model);

}  // namespace turncal
