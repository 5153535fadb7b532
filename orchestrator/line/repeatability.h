// How well a unit repeats itself: consecutive calibrations of one unit at one station.
//
//   s_r = sqrt(mean d^2 / 2) over the differences d of pairs; its interval by chi-square of as many degrees as pairs, 95 %
//
// Turn-on: pairs at most three days apart, the unit having been switched off between them. Month to month: 20 to 45 days apart. Both
// hold the uncertainty of the calibrations themselves, which stands beside them: what the unit does is what is left of the squares.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/records/results_database.h"

namespace turncal {

struct Repeatability {
  std::string key;
  std::size_t pairs = 0;
  double spread = 0.0, low = 0.0, high = 0.0;  // s_r
  double calibration_sigma = 0.0;              // root mean square, of one calibration
  std::optional<double> of_unit() const;       // empty: no more than the calibrations' own
};

inline constexpr double turn_on_days = 3.0, month_from_days = 20.0, month_to_days = 45.0;

// all: oldest first. Of every parameter that is estimated; none where there is no pair.
std::vector<Repeatability> repeatability(const std::vector<StoredCalibration>& all, double from_days, double to_days);

}  // namespace turncal
