// What a run tells the outside while it goes on: every transition, a unit that drops out, and a snapshot whenever something has moved on.
// The progress line and the run's log listen here. Observers look; they cannot change anything.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "orchestrator/run/run_state_machine.h"
#include "turntable_drivers/table/table_state.h"

namespace turncal {

struct UnitSnapshot {
  std::string serial;
  std::int64_t recorded_samples = 0;  // periods, lost ones included
  std::uint64_t lost_samples = 0;
  std::string dropped_out;  // why; empty: it is part of the run
};

// Degrees, seconds of the station's clock.
struct RunSnapshot {
  double time_s = 0.0;  // since the run began
  double utc_s = 0.0;
  RunState state = RunState::idle;
  int step = 0;                // number of the step; 0 before the first
  std::size_t step_place = 0;  // 1-based place in the sequence
  std::size_t step_count = 0;
  std::optional<SegmentKind> dwell_kind;  // while dwelling
  std::optional<Axis> axis;               // the one commanded
  double target_deg = 0.0;                // of that axis
  AxisTriple position_deg;
  AxisTriple rate_degps;
  TableState table = TableState::not_ready;
  double phase_fraction = 0.0;     // of the move, dwell or rest that is going on
  double item_end_utc_s = 0.0;     // when that move or dwell will be over; 0: not known
  double run_fraction = 0.0;       // of the plan's time
  double eta_s = 0.0;              // what the plan says is left, a rest after an interruption included
  double end_utc_s = 0.0;          // civil time of that end
  std::size_t moves_left = 0;      // of the plan, the one going on included
  int repeats = 0;                 // of the present dwell
  std::uint64_t lost_samples = 0;  // of all units
  std::vector<UnitSnapshot> units;
};

// What a pause that was asked for waits for: "pause asked for: after this dwell, at 23:41:07Z; Ctrl-C again stops now".
std::string format_pause(const RunSnapshot& at);

struct TransitionRecord {
  RunSnapshot at;  // as it was when the event came
  RunState from = RunState::idle;
  RunEvent event = RunEvent::start;
  RunState to = RunState::idle;
  RunAction action = RunAction::none;
  bool unexpected = false;
  std::string detail;  // what there is to say about the event; may be empty
};

// A unit that is no longer part of the run: gone, silent, refused, or its recording cannot be written.
struct Dropout {
  std::size_t unit = 0;  // place in the run, from 0
  std::string serial;
  Error why;  // "step 3 (3/14) dwelling at ...: ..."
  RunSnapshot at;
};

class RunObserver {
 public:
  virtual ~RunObserver() = default;
  virtual void on_transition(const TransitionRecord& record) = 0;
  virtual void on_progress(const RunSnapshot& snapshot) = 0;
  virtual void on_dropout(const Dropout&) {}
};

}  // namespace turncal
