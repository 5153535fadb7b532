// What a shift, a week or a month of the line comes to: made of the rows of a results database, for terminal, page and CSV.
#pragma once

#include <string>
#include <vector>

#include "orchestrator/line/line_yield.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line/repeatability.h"
#include "orchestrator/line/station_difference.h"

namespace turncal {

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
