// A walk: a rest, then turns of one axis at a time, each with a rest after it. What `turncal design` changes, and makes a sequence of.
//
// It is a sequence without its steps: angles are turned by, not turned to, and a turn need not have a rest (rest_samples = 0).
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
  double turn_deg = 0.0;  // with its sign
  double rate_degps = 0.0;
  std::int64_t rest_samples = 0;  // after it
};

struct Walk {
  AxisTriple start_deg;
  std::int64_t first_rest_samples = 0;
  std::vector<Leg> legs;
};

struct WalkHeader {
  std::string name;                   // letters, digits, _ - .
  std::vector<std::string> comments;  // lines above everything, without their #
  double rate_degps = 10.0;           // of the file: legs at another say so
  double acceleration_degps2 = 20.0;
};

// The sequence file of a walk, in steps of eight legs, so that a log says where a run stands.
std::string sequence_text(const Walk& walk, const WalkHeader& header);

// The turns and rests of a sequence; moves to initial positions are turns like the others.
Walk walk_of(const Sequence& sequence);

// Where an axis may stand, in whole degrees, and how far it may turn at once: travel and cable. 0: it cannot turn.
struct Travel {
  double low_deg = 0.0, high_deg = 0.0, longest_turn_deg = 0.0;
};
Travel travel_of(const AxisLimits& limits);

// As near to a walk as a table comes. It begins in the same pose, or the nearest that the travel allows; a turn that travel or cable forbid goes
// the other way, or as far as either way allows, or is left out, and its rest with it; none is faster than its axis.
Walk on_table(const Walk& walk, const PlanLimits& limits);

}  // namespace turncal
