// The plan of a run: what a sequence will do, when, and whether the table may do it. Pure arithmetic on plain data.
//
// A move of angle A at rate r with acceleration a (trapezoidal profile, the same acceleration for braking) takes
//   A/r + r/a            when A >= r^2/a
//   2 sqrt(A/a)          otherwise (the rate is never reached: triangular profile)
// and then `settle_s` until it counts as arrived. Every duration is rounded up to whole IMU samples, because the
// recording is a contiguous stream of samples; dwells are counted in samples.
//
// Units: degrees, deg/s, deg/s^2, seconds. Times and samples count from the first sample of the recording, when the
// table is already at the sequence's start position.
//
// Not modelled: the move to the start position, homing, repeated dwells, a table slower than commanded, operators.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "sequences/sequence.h"

namespace turncal {

struct PlanLimits {
  std::array<AxisLimits, 3> axis{};  // indexed by Axis
  double settle_s = 1.0;
  double sample_period_s = 0.005;
  const AxisLimits& operator[](Axis which) const { return axis[std::size_t(which)]; }
};

// An item of the sequence with its place in time. Fields of the other kind of item keep their defaults.
struct PlannedItem : PlannedMotionItem {
  std::size_t step_index = 0;  // sequence.steps[step_index].items[item_index]
  std::size_t item_index = 0;
  int line = 0;              // in the sequence file
  bool positioning = false;  // a move to the step's initial position
  AxisTriple commanded_deg;  // at the end of the item
  std::int64_t start_sample = 0;
  double start_s = 0.0;
  double duration_s = 0.0;
};

struct Plan {
  std::vector<PlannedItem> items;  // in order, contiguous in time
  int moves = 0;
  int align_dwells = 0;
  int still_dwells = 0;
  std::int64_t samples = 0;   // of the whole run
  double station_s = 0.0;     // samples * sample_period_s
  double moving_s = 0.0;      // part of station_s, including settling
  AxisTriple travel_min_deg;  // cumulative angles reached, including the start position
  AxisTriple travel_max_deg;
  AxisTriple wrap_used_deg;  // travel_max - travel_min: cable winding
  AxisTriple turned_deg;     // sum of |angle| over all moves
  // Why the table must not run this, one line each: "file:line: step N: ...". Further lines with the same cause (the same axis
  // and value) are counted on the first line. Empty: the run may start.
  std::vector<std::string> violations;
  bool ok() const { return violations.empty(); }
};

// Returns the time of the motion without settling. The sign of the angle does not matter.
// REQUIRES: rate and acceleration > 0.
double move_duration_s(double angle_deg, double rate_degps, double acceleration_degps2);

// Returns the complete plan, even with violations. REQUIRES: sample_period_s > 0.
Plan make_plan(const Sequence& sequence, const PlanLimits& limits);

// Returns the segments of a perfect run: one per move (rotate, including settling), one per dwell.
Segments planned_segments(const Plan& plan);

}  // namespace turncal
