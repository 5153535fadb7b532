// A calibration sequence as plain data: the parser makes it of a .seq file, and the state machine executes it.
//
// A step begins with the moves to its initial position (roll first, then pitch, then heading, only the axes that differ).
// Then come its items in order. Angles are absolute and cumulative in degrees: "roll +360" from 0 ends at 360. Dwells
// are counted in IMU samples. The state machine has no built-in steps.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

struct Move {
  Axis axis = Axis::heading;
  double target_deg = 0.0;  // absolute, cumulative
  double rate_degps = 0.0;
  double acceleration_degps2 = 0.0;
};

struct Dwell {
  SegmentKind kind = SegmentKind::still;  // align or still
  std::int64_t samples = 0;
};

struct SequenceItem {
  using Kind = PlannedMotionItem::Kind;
  Kind kind = Kind::dwell;
  Move move;
  Dwell dwell;
  int line = 0;              // in the file, for messages; for a move to the initial position the line of `initial`
  bool positioning = false;  // a move to the step's initial position, inserted by the parser
};

struct Step {
  int number = 0;
  std::string title;
  std::vector<std::string> determines;  // parameter keys
  AxisTriple initial_deg;
  std::vector<SequenceItem> items;  // beginning with the moves to the initial position
  int line = 0;
  std::string file;  // if it differs from the sequence's (append_steps)
};

struct Sequence {
  std::string name;
  std::string file;
  AxisTriple start_deg;     // position of the table before step 1: its initial position
  double rate_degps = 0.0;  // the file's defaults for rotations without their own, for moves to initial positions,
  double acceleration_degps2 = 0.0;  // and for going to start_deg
  std::vector<Step> steps;
  std::string text;  // the bytes of the file, whose hash goes into records
};

// Parses a sequence. Grammar, worked example and every error: docs/sequences.md. An error is one line "file:line:column: found 'token',
// expected ...". `file_name` is for messages only; nothing is read. `path` is a file, or the name of a built-in sequence.
Result<Sequence> parse_sequence(const std::string& text, const std::string& file_name);
Result<Sequence> read_sequence(const std::string& path);

// Appends the steps of `more` and continues the numbering. The moves to their start have the rate of `more`.
void append_steps(const Sequence& more, Sequence& sequence);

// Returns the moves to a step's initial position: the axes that differ, inner ones first.
std::vector<SequenceItem> approach(const AxisTriple& from_deg, const AxisTriple& to_deg, double rate_degps,
                                   double acceleration_degps2, int line);

}  // namespace turncal
