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

// A row that comes so many periods after the one before, more than one.
struct StampGap {
  std::size_t row = 0;
  std::int64_t periods = 0;
  bool operator==(const StampGap&) const = default;
};
// A gap is a rise of the level of the stamps that lasts, whatever a single one does. `gap`: in periods, from which an interval is looked at.
std::vector<StampGap> find_gaps(std::span<const double> times, double period, double gap);

// From each row's stamp to that `span` rows later, over `span`; of long records of some of them.
std::vector<double> intervals_over(std::span<const double> times, std::size_t span,
                                   std::size_t most = std::size_t{1} << 17);

// The interval that most rows keep, whatever the gaps and the jitter: the mean over 16 of them, less those that are far from the median.
double typical_interval(std::span<const double> times);

struct IncrementsChoice {
  bool even = true;  // the sampling is: `period` is right, else `intervals`
  std::string reason;
};
IncrementsChoice choose_increments(std::span<const double> times_s);

}  // namespace turncal
