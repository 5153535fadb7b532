// The report of a shift, a week or a month of the line, from the rows of a results database, for terminal, page and CSV. Also the other
// documents of a database: control charts, and everything about a unit.
#pragma once

#include <cmath>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "orchestrator/line/parameter_history.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/report/document.h"

namespace turncal {

// Yield: what became of the units on the line, and how the table's hours were spent.
//
// A visit of a unit is its attempts up to the first that passes; a unit that has passed begins a new visit. Only an attempt that judges
// the unit counts for a yield: one with a verdict, or in which it dropped out. One that was refused, aborted, interrupted, or failed by
// the station's fault costs hours and counts among the reasons.
//
//   first pass yield = visits whose first attempt passed / visits
//   final yield      = visits that have ended in a pass / the same visits
//
// A visit is counted where its first attempt is, in that shift and at that station, wherever and whenever it passes. So every visit is in one
// report of a series and in one row of a table, and the final yield is never the lower one.
//
// The interval is Wilson's, 95 %.

struct Share {
  std::size_t part = 0, all = 0;
  double value() const { return all > 0 ? double(part) / double(all) : 0.0; }
  bool reaches(double of_1) const { return double(part) >= of_1 * double(all) - 1e-9; }  // 38 of 40 are 95 %
  std::pair<double, double> interval() const;
};

// Attempts that did not pass, grouped by reason.
struct LossReason {
  std::string reason;
  std::size_t attempts = 0;
  double hours = 0.0;
  double share = 0.0, cumulated = 0.0;  // among the attempts that did not pass
  std::string last_unit;
};

struct LineYield {
  std::size_t attempts = 0, running = 0, units = 0;
  Share first_pass, final_pass;
  double hours = 0.0;               // of all attempts
  double hours_lost = 0.0;          // of those that did not pass
  std::vector<LossReason> reasons;  // the most frequent first
};

enum class AttemptKind { passed, failed, says_nothing };  // what an attempt says of the unit
AttemptKind kind_of(const AttemptRecord& attempt);
double hours_of(const AttemptRecord& attempt);  // on the table; those of a run are shared by its units
// Returns the reason without the parts that differ from unit to unit: serial number and figures.
std::string reason_class(const AttemptRecord& attempt);

// all: oldest first, with earlier attempts, which tell whether an attempt is a unit's first. chosen: ids of those reported.
LineYield line_yield(const std::vector<AttemptRecord>& all, const std::set<std::int64_t>& chosen);

// ---- the report ----

// Repeatability of a unit: consecutive calibrations of one unit at one station.
//
//   s_r = sqrt(mean d^2 / 2) over the differences d of pairs; 95 % interval by chi-square, one degree of freedom a pair
//
// Turn-on: pairs at most three days apart, the unit having been switched off between them. Month to month: 20 to 45 days apart. Both
// contain the uncertainty of the calibrations, which is listed beside them.
struct Repeatability {
  std::string key;
  std::size_t pairs = 0;
  double spread = 0.0, low = 0.0, high = 0.0;  // s_r
  double calibration_sigma = 0.0;              // root mean square, of one calibration
  std::optional<double> of_unit() const;       // empty: not above the calibrations' own
};

inline constexpr double turn_on_days = 3.0, month_from_days = 20.0, month_to_days = 45.0;

// Returns every estimated parameter that has a pair. all: oldest first.
std::vector<Repeatability> repeatability(const std::vector<StoredCalibration>& all, double from_days, double to_days);

// Compares two stations: every parameter of units calibrated at both or, failing that, of the units of each; and whether the stations drift apart.
//
//   both     d_u = mean of unit u at b - mean at a; difference = mean d_u, sigma = s(d) / sqrt(n)
//   each     difference = mean of b - mean of a, sigma = sqrt(s_a^2 / n_a + s_b^2 / n_b) (Welch): the units' own spread is in it
//   drift    slope of a straight line over time at b, minus that at a, for 30 days
//
// `stands_out` allows for testing 21 parameters: 0.05 / 21, two-sided.
struct StationDifference {
  std::string a, b, key;
  bool of_the_same_units = false;
  std::size_t count_a = 0, count_b = 0;  // units at both: the same number twice
  double difference = 0.0, sigma = 0.0;
  std::optional<double> drift, drift_sigma;  // for 30 days; empty: less than a day, or too few
  static constexpr double limit_sigmas = 3.04;
  bool stands_out() const { return std::abs(difference) > limit_sigmas * sigma; }
  bool drifts() const { return drift && std::abs(*drift) > limit_sigmas * *drift_sigma; }
};

inline constexpr std::size_t least_units = 5;  // at both, or at each of the two

// Returns every pair of stations and every estimated parameter with enough units.
std::vector<StationDifference> station_differences(const std::vector<StoredCalibration>& all);

// The yield of a station or of a period.
struct YieldOf {
  std::string name;
  LineYield yield;
  double mean_residual = 0.0;  // over the calibrations
  std::size_t calibrated = 0;
};

struct ShiftReport {
  std::string source;  // database and filter, in words
  bool simulated = false;
  std::size_t of_the_other_kind = 0;    // attempts left out: simulated ones, or real ones in a simulated report
  std::vector<AttemptRecord> attempts;  // those reported, oldest first
  std::vector<StoredCalibration> calibrations;
  std::size_t damaged = 0;  // rows left out
  YieldOf whole;
  std::vector<YieldOf> stations;
  std::vector<YieldOf> periods;         // by day; of a single day by hour, of more than 31 days by month
  double target = 0.0;                  // target of the first-pass yield; 0: none
  std::vector<ChartedQuantity> charts;  // residual, temperature, hours, then the parameters
  std::vector<Repeatability> turn_on, month;
  std::vector<StationDifference> differences;
};

// Makes the report. Real and simulated units are never in one report.
Result<ShiftReport> shift_report(const ResultsDatabase& database, const std::string& name, const RecordFilter& filter,
                                 bool simulated);

// A signal of a run rule on one of the charts.
struct ChartSignal {
  const ChartedQuantity* chart = nullptr;
  RunSignal signal;
};
// Returns the first signal of each stretch, because a signal of the same rule at the next point has the same cause.
std::vector<ChartSignal> signals_of(const std::vector<ChartedQuantity>& charts);

// ---- documents (shift_document.cpp) ----

Document shift_document(const ShiftReport& report);
std::string shift_csv(const ShiftReport& report);  // table,item,quantity,value: the document's tables
std::string signals_csv(const ShiftReport& report);

// Adds mean, limits and capability, one row for each quantity that has values.
void add_control_table(const std::vector<ChartedQuantity>& quantities, Document& document);
// Adds that table, and charts in groups of one unit, three to a row: every point with its sigma, the control limits, the limits in force, and
// the signals of the run rules. A quantity in no group has no chart.
void add_control_charts(const std::vector<ChartedQuantity>& quantities, Document& document);

// Returns the link to the report or certificate of a run; empty: there is none.
using RunLink = std::function<std::string(const std::string& folder, const std::string& file)>;

// Charts every parameter over the calibrations. `all`: oldest first, either real or simulated. `source`: where they come from, in words.
Document history_document(const std::vector<StoredCalibration>& all, const std::string& source,
                          const RunLink& link = {});

// Everything on record about a serial number.
struct UnitRecord {
  std::string unit;
  std::vector<AttemptRecord> attempts;          // oldest first
  std::vector<StoredCalibration> calibrations;  // oldest first, with all values
  RunLink link;
};
// Shows its runs, its parameters now and over time, and its certificates. Real and simulated ones are not mixed: those of the newest count.
Document unit_document(const UnitRecord& record);

}  // namespace turncal
