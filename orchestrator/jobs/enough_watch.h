// One policy: a run goes on while what a minute more is expected to tell is worth it (docs/sequences.md). With --until-sigma the units are calibrated
// after every completed dwell, by the same function and from the same samples as at the end; the rest of the plan is left out (but for its north seeking)
// when every unit is known well enough, its fit passes its tests, and half an hour is recorded where the whole plan would get a diagnosis.
//
// A dwell that disagrees with all the others (calib/evidence/evidence.h) is made once more, dwell.max_repeats times. When the last take
// agrees with all else, those that do not are set aside: they stay in the recording, marked, and no estimate uses them. Else all stay, and
// the run goes on. Its end is predicted (calib/prediction/predict.h): at the soonest with the noise as it is fitted, at the latest with what
// an instability that cannot be excluded yet adds, in proportion.
//
// At the end of what is calibrated from, a unit in doubt, or not known well enough, gets the shortest legs that are expected to settle it
// (find_settling), within what is left of settling_allowed_s(); at their end it is asked again. What was found is a record `settle`, durable
// before the plan is changed: a run that goes on after a kill walks the same legs.
//
// The estimate runs in a thread of its own and is waited for, so that the answer depends on the samples alone.
#pragma once

#include <deque>
#include <functional>
#include <future>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/run.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/run/background_queue.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

// What is known of a unit so far.
struct KnownSoFar {
  std::string unit;
  std::vector<NeededSigma> sigmas = {};   // empty: not determined yet
  std::string why_not = {};               // to end; empty: enough is known
  bool again = false;                     // its last dwell disagrees with the rest, and may be repeated
  Segments set_aside = {};                // takes of its last dwell that another stands in for
  std::optional<Settling> settling = {};  // at the end of the plan: of what is in doubt
  // Index of the item after which it is expected to be, as the sigmas are now and as the plan has them; empty: not by this plan.
  std::optional<std::size_t> end = {}, soonest = {};
  const NeededSigma* worst() const;  // null: there is none
};

// The takes of the last dwell of a recording, oldest first; `dwells` (1 or more) of the plan are in the last pose, one after the other.
Segments takes_of_last(const Segments& segments, std::size_t dwells);

// Of a run that came to its planned end: what is known less well than it had to be, as a line; empty: nothing.
std::string not_reached(const Run& run, const RunUnit& unit);

class EnoughWatch {
 public:
  // tell: a line for the log and the operator, and what is known of the unit of which least is known.
  using Tell = std::function<void(const std::string& line, const KnownSoFar& unit)>;
  // recordings: of the units, in their order. All outlive it.
  EnoughWatch(Run& run, std::deque<RecordingSink>& recordings, BackgroundQueue& storage, Tell tell);

  // For StationHooks::go_on_with. Waits a few milliseconds at most; what is decided is answered once it is durable.
  Result<std::optional<std::size_t>> go_on_with(std::size_t next_item);

 private:
  std::vector<KnownSoFar> estimate(std::size_t done_items);  // in the thread
  KnownSoFar estimate(const RunUnit& unit, std::size_t done_items);
  KnownSoFar settle(const RunUnit& unit);  // the same, where nothing but legs can come
  double settling_left_s() const;          // 0: nothing more is added
  struct Look {
    Result<LoadedRecording> loaded;
    Result<CalibrationOutput> output;  // it may leave parameters open, and its fit is not tested
  };
  Look look(const RunUnit& unit, const Segments& without) const;
  static bool disagrees(const Look& look);  // its last dwell, with the others
  Segments to_set_aside(const RunUnit& unit, const Segments& takes) const;
  // How the sigmas shrink with the plan: those of the items before each, for an ideal unit with this noise.
  const ParameterVector& planned_sigmas(std::size_t items, const JointResult& fit);
  std::optional<std::size_t> expected_end(const std::vector<NeededSigma>& sigmas, std::size_t done_items,
                                          const JointResult& fit, bool soonest);
  double length_s(std::size_t from, std::size_t to) const;  // of items of the plan
  JournalFields note(const std::vector<KnownSoFar>& units, std::size_t next_item, bool enough, bool again);
  void tell(const Settling& settling, const KnownSoFar& unit);

  Run& run_;
  std::deque<RecordingSink>& recordings_;
  BackgroundQueue& storage_;
  Tell tell_;
  std::size_t end_item_;   // of what is calibrated from, by the plan that the run began with
  std::size_t last_item_;  // the same with the legs that were added
  std::future<std::vector<KnownSoFar>> running_;
  struct Decided {
    std::size_t next_item;
    std::vector<Settling> settled;
    PendingWrite written;
  };
  std::optional<Decided> decided_;
  std::map<std::size_t, ParameterVector> planned_;
};

}  // namespace turncal
