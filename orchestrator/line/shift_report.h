// What a shift, a week or a month of the line comes to: made of the rows of a results database, for terminal, page and CSV.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "orchestrator/line/line_yield.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line/station_difference.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

// How well a unit repeats itself: consecutive calibrations of one unit at one station.
//
//   s_r = sqrt(mean d^2 / 2) over the differences d of pairs; its interval by chi-square of as many degrees as pairs, 95 %
//
// Turn-on: pairs at most three days apart, the unit having been switched off between them. Month to month: 20 to 45 days apart. Both
// hold the uncertainty of the calibrations themselves, which stands beside them: what the unit does is what is left of the squares.
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

struct StationFigures {
  std::string station;
  LineYield yield;
  double mean_residual = 0.0;  // of calibrations
  std::size_t calibrated = 0;
};

struct ShiftReport {
  std::string source;  // database and filter, in words
  bool simulated = false;
  std::size_t of_the_other_kind =
      0;  // attempts left out: simulated ones of a report of real units, and the other way round
  std::vector<AttemptRecord> attempts;  // those reported, oldest first
  std::vector<StoredCalibration> calibrations;
  std::size_t damaged = 0;  // rows left out
  LineYield yield;
  std::vector<StationFigures> stations;
  std::vector<ChartedQuantity> charts;  // residual, temperature, hours, then the parameters
  std::vector<Repeatability> turn_on, month;
  std::vector<StationDifference> differences;
};

// Real and simulated units are never in one report.
Result<ShiftReport> shift_report(const ResultsDatabase& database, const std::string& name, const RecordFilter& filter,
                                 bool simulated);

// A signal of a run rule, as people ask for it: which chart, which unit, when.
struct ChartSignal {
  const ChartedQuantity* chart = nullptr;
  RunSignal signal;
};
// The first of each stretch: a signal of the same rule at the next point is the same cause.
std::vector<ChartSignal> signals_of(const std::vector<ChartedQuantity>& charts);

}  // namespace turncal
