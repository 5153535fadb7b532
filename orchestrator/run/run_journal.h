// What a run must make durable before its consequence: every transition before its action (but a stop, which waits for
// nothing and is written down after it went out), every command before it is sent, every completed dwell before the next item, every
// unit that drops out when it does, the end of the recording before it is sealed.
//
// An error from any of these stops the run like a disk that is full. On disk: journal_file.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/run/run_observer.h"
#include "sequences/sequence.h"

namespace turncal {

// Where the recording of one unit stood.
struct RecordingPoint {
  std::int64_t next_sample = 0;    // of the recording: where the segment ended
  std::int64_t first_counter = 0;  // the unit's own, of the recording's sample 0
  std::int64_t last_counter = 0;   // the unit's own, of the last recorded sample
  std::uint64_t lost_samples = 0;
  std::uint64_t duplicate_samples = 0;
  std::optional<std::uint32_t> written{};  // hash of the recording up to there (run_sink.h)
  bool operator==(const RecordingPoint&) const = default;
};

// All that a run needs to know in order to go on after a completed dwell.
struct CompletedDwell {
  std::size_t item = 0;               // of the plan
  std::vector<RecordingPoint> units;  // in the order of the run; of one that dropped out: where it stopped
  int repeated_dwells = 0;
  double time_s = 0.0;  // of the station's clock, when it was complete
  double utc_s = 0.0;
  bool operator==(const CompletedDwell&) const = default;
};

// Where an interrupted run goes on: everything after this dwell is done again, and nothing before it.
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
  virtual Status home(double time_s) = 0;
  virtual Status move(const Move& move, double time_s) = 0;
  virtual Status dwell(const CompletedDwell& dwell) = 0;
  virtual Status dropout(const Dropout& dropout) = 0;
  // The recordings are about to be finished. hashes: of their contents, by unit; empty for one that dropped out.
  virtual Status seal(double utc_s, const std::vector<std::string>& hashes) = 0;
};

}  // namespace turncal
