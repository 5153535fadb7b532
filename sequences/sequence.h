// A calibration sequence as plain data: what the parser makes of a .seq file and what the state machine walks.
//
// A step begins by moving to its initial position (roll first, then pitch, then heading, only the axes that differ),
// then does its items in order. Angles are absolute and cumulative in degrees: "roll +360" from 0 ends at 360. A dwell
// is counted in IMU samples. The state machine knows no step by heart.
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
  int line = 0;              // in the file, for messages; of a move to the initial position: that of `initial`
  bool positioning = false;  // a move to the step's initial position, put there by the parser
};

struct Step {
  int number = 0;
  std::string title;
  std::vector<std::string> determines;  // parameter keys
  AxisTriple initial_deg;
  std::vector<SequenceItem> items;  // the moves to the initial position are already in front
  int line = 0;
  std::string file;  // where it is another than the sequence's (append_steps)
};

struct Sequence {
  std::string name;
  std::string file;
  AxisTriple start_deg;     // where the table must stand before step 1 (its initial position)
  double rate_degps = 0.0;  // the file's defaults: for rotations that name none, for moves to initial positions,
  double acceleration_degps2 = 0.0;  // and for going to start_deg
  std::vector<Step> steps;
  std::string text;  // the file's bytes, for the hash that goes into records
};

// Grammar, worked example and every refusal: docs/sequences.md. An error is one line
// "file:line:column: found 'token', expected ...". The file name is used in messages only; nothing is read. `path`: a file, or the name of a shipped one.
Result<Sequence> parse_sequence(const std::string& text, const std::string& file_name);
Result<Sequence> read_sequence(const std::string& path);

// The steps of `more` after those of `sequence`, with numbers that go on; the table is turned to their start at their own rate.
void append_steps(const Sequence& more, Sequence& sequence);

// The moves to a step's initial position: the axes that stand elsewhere, the inner ones first.
std::vector<SequenceItem> approach(const AxisTriple& from_deg, const AxisTriple& to_deg, double rate_degps,
                                   double acceleration_degps2, int line);

}  // namespace turncal
