// What a run reports while it goes on: every transition, a unit that drops out, and a snapshot whenever something has changed.
// The progress line and the run's log listen here. Observers look; they cannot change anything.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "orchestrator/run/run_state_machine.h"
#include "sequences/sequence.h"
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
  std::string chamber;             // "chamber 35.2 of 40 C"; empty: there is none
  double phase_fraction = 0.0;     // of the move, dwell or rest that is going on
  double item_end_utc_s = 0.0;     // when that move or dwell will be over; 0: not known
  double run_fraction = 0.0;       // of the plan's time
  double eta_s = 0.0;              // what the plan says is left, a rest after an interruption included
  double end_utc_s = 0.0;          // civil time of that end
  std::size_t moves_left = 0;      // of the plan, the present one included
  int repeats = 0;                 // of the present dwell
  std::uint64_t lost_samples = 0;  // of all units
  std::vector<UnitSnapshot> units;
};

// Says what a requested pause waits for: "pause asked for: after this dwell, at 23:41:07Z".
std::string format_pause(const RunSnapshot& at);

struct TransitionRecord {
  RunSnapshot at;  // before the event was handled
  RunState from = RunState::idle;
  RunEvent event = RunEvent::start;
  RunState to = RunState::idle;
  RunAction action = RunAction::none;
  bool unexpected = false;
  std::string detail;  // details of the event; may be empty
};

// A unit that has left the run: gone, silent, refused, or its recording cannot be written.
struct Dropout {
  std::uint64_t place = 0;  // in the run, from 1
  std::string serial;
  Error why;  // "step 3 (3/14) dwelling at ...: ..."
  RunSnapshot at;
};
inline std::string dropout_words(const std::string& serial, const Error& why) {
  return "unit " + serial + " dropped out at " + why.message;
}

class RunObserver {
 public:
  virtual ~RunObserver() = default;
  virtual void on_transition(const TransitionRecord&) {}
  virtual void on_progress(const RunSnapshot&) {}
  virtual void on_dropout(const Dropout&) {}
};

// What a run must make durable before its consequence: every transition before its action (except a stop, which waits for nothing and is
// written down after it went out), every command before it is sent, every completed dwell before the next item, every dropout as it happens,
// the end of the recording before it is sealed.
//
// An error from any of these stops the run, like a full disk. On disk: journal.h.

// A command to the table, on the station's clock. No move: home.
struct TableCommand {
  double time_s = 0.0;
  std::optional<Move> move;
};

// How far the recording of one unit had come.
struct RecordingPoint {
  std::int64_t next_sample = 0;    // of the recording: where the segment ended
  std::int64_t first_counter = 0;  // the unit's own, of the recording's sample 0
  std::int64_t last_counter = 0;   // the unit's own, of the last recorded sample
  std::uint64_t lost_samples = 0;
  std::uint64_t duplicate_samples = 0;
  std::optional<std::uint32_t> written{};  // hash of the recording so far
  bool operator==(const RecordingPoint&) const = default;
};

// Everything that a run needs in order to go on after a completed dwell.
struct CompletedDwell {
  std::size_t item = 0;               // of the plan
  std::vector<RecordingPoint> units;  // in the order of the run; for a unit that dropped out, where it stopped
  int repeated_dwells = 0;
  double time_s = 0.0;  // station's clock at its completion
  double utc_s = 0.0;
  bool operator==(const CompletedDwell&) const = default;
};

// Where an interrupted run resumes: everything after this dwell is done again, and nothing before it.
struct ResumePoint {
  CompletedDwell after;
  // Only for simulated devices that were put back to the moment at which that dwell ended: no time has passed for them, and
  // the unit's next sample is the next of the recording. Otherwise there is a gap, a rest, and the chain is cut there.
  bool no_time_passed = false;
  std::vector<bool> dropped{};  // by unit; empty: none. A unit that had dropped out by then stays out
};

class RunJournal {
 public:
  virtual ~RunJournal() = default;
  virtual Status transition(const TransitionRecord& record) = 0;
  virtual Status command(const TableCommand& command) = 0;
  virtual Status dwell(const CompletedDwell& dwell) = 0;
  virtual Status dropout(const Dropout& dropout) = 0;
  // Called when the recordings are about to be finished. hashes: of their contents, by unit; empty for one that dropped out.
  virtual Status seal(double utc_s, const std::vector<std::string>& hashes) = 0;
};

// A receiver of what a run captures of a unit: its recording on disk, the check of its first step, the page; in a test, memory.
//
// Calls come in this order: start (or resume), then begin_segment / add... / end_segment over and over, sync after every step, and finish.
// Counters count from 0 at the first sample of the recording. Any error ends the run.
class RunSink {
 public:
  virtual ~RunSink() = default;
  virtual Status start(const RecordingInfo& info) = 0;
  // Instead of start: goes on after the segment that ended at end_sample; whatever came after it is dropped. An error when
  // the recording there is not of the same unit, site and kind, or, where `written` is given, not what written() said then.
  virtual Status resume(const RecordingInfo& info, std::int64_t /*end_sample*/,
                        std::optional<std::uint32_t> /*written*/) {
    return start(info);
  }
  virtual Status begin_segment(const Segment& segment) = 0;  // end_sample is not yet known
  virtual Status add(std::span<const ImuSample> samples) = 0;
  // `kind` is final: a dwell that does not count is closed as rotate.
  virtual Status end_segment(SegmentKind, std::int64_t /*end_sample*/, const AxisTriple& /*angles_deg*/) { return {}; }
  virtual Status sync() { return {}; }
  // Returns a hash of everything kept so far; empty when nothing is kept.
  virtual std::optional<std::uint32_t> written() const { return {}; }
  virtual Status finish() { return {}; }  // complete and durable
  // Returns what is wrong with the unit itself, not with storing it; called when a segment has ended.
  virtual Status unit_fits() const { return {}; }
};

}  // namespace turncal
