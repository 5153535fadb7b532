// A walk: a rest, then turns of one axis at a time, each followed by a rest. `turncal design` varies it and makes a sequence of it.
//
// It is a sequence without steps: angles are relative, and a turn need not have a rest (rest_samples = 0).
// Units: degrees, deg/s; rests in samples of the unit.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"

namespace turncal {

struct Leg {
  Axis axis = Axis::heading;
  double turn_deg = 0.0;  // signed
  double rate_degps = 0.0;
  std::int64_t rest_samples = 0;  // after the turn
};

struct Walk {
  AxisTriple start_deg;
  std::int64_t first_rest_samples = 0;
  std::vector<Leg> legs;
};

struct WalkHeader {
  std::string name;                   // letters, digits, _ - .
  std::vector<std::string> comments;  // lines at the top, without their #
  double rate_degps = 10.0;           // default of the file; legs with another rate state it
  double acceleration_degps2 = 20.0;
};

// Returns the sequence file of a walk. Its steps have eight legs each, so that a log shows the progress of a run.
std::string sequence_text(const Walk& walk, const WalkHeader& header);

// Returns the turns and rests of a sequence; moves to initial positions are turns like others.
Walk walk_of(const Sequence& sequence);

// The range of positions of an axis in whole degrees, and its longest single turn, by travel and cable. 0: it cannot turn.
struct Travel {
  double low_deg = 0.0, high_deg = 0.0, longest_turn_deg = 0.0;
};
Travel travel_of(const AxisLimits& limits);

// Returns the walk nearest to `walk` that a table can do. It begins in the same pose, or the nearest one that the travel allows. A turn that travel
// or cable forbid is made the other way, or as far as either way allows, or is dropped with its rest. No turn exceeds the rate limit of its axis.
Walk on_table(const Walk& walk, const PlanLimits& limits);

}  // namespace turncal
