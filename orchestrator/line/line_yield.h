// What became of the units that came to the line, and what the table's hours went into.
//
// A visit of a unit is its attempts up to and with the first that passes: passed before, it comes anew. Only an attempt that says
// something of the unit counts for a yield: a verdict, or that it dropped out. One that was refused, aborted, interrupted, or failed by
// the station's fault costs hours and has its place among the reasons.
//
//   first pass yield = visits whose first attempt passed / visits
//   final yield      = visits that have ended in a pass / the same visits
//
// A visit is counted where its first attempt is: in that shift, at that station, wherever and whenever it passes. So every visit is in one report
// of a series and in one row of a table, and the final yield is never the lower one.
//
// The interval is Wilson's, 95 %.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "orchestrator/records/results_database.h"

namespace turncal {

struct Share {
  std::size_t part = 0, all = 0;
  double value() const { return all > 0 ? static_cast<double>(part) / static_cast<double>(all) : 0.0; }
  std::pair<double, double> interval() const;
};

// Attempts that did not pass, by what they have in common.
struct LossReason {
  std::string reason;
  std::size_t attempts = 0;
  double hours = 0.0;
  double share = 0.0, cumulated = 0.0;  // of the attempts that did not pass
  std::string last_unit;
};

struct LineYield {
  std::size_t attempts = 0, running = 0, units = 0;
  Share first_pass, final_pass;
  double hours = 0.0;               // of all attempts
  double hours_lost = 0.0;          // of those that did not pass
  std::vector<LossReason> reasons;  // the most frequent first
};

enum class AttemptKind { passed, failed, says_nothing };  // of the unit
AttemptKind kind_of(const AttemptRecord& attempt);
double hours_of(const AttemptRecord& attempt);
// The reason without what differs from unit to unit: its serial number and figures.
std::string reason_class(const AttemptRecord& attempt);

// all: oldest first, with what came before, from which it is known whether an attempt is a unit's first. chosen: ids of those reported.
LineYield line_yield(const std::vector<AttemptRecord>& all, const std::set<std::int64_t>& chosen);

}  // namespace turncal
