// Decides what a run measures next: it goes on while what another minute is expected to tell is worth it (docs/sequences.md). With --until-sigma
// every unit is calibrated after every completed dwell, as at the end. The plan, except its north seeking, is cut short when every unit is known
// well enough, its fit passes its tests, and half an hour is recorded, if the whole plan would have been long enough for a diagnosis.
//
// A dwell that disagrees with all the others (calib/evidence/evidence.h) is repeated, at most dwell.max_repeats times. If the last take agrees
// with everything else, the takes that disagree are set aside: they stay in the recording, marked, and no estimate uses them. Otherwise all
// stay, and the run goes on. Its end is predicted (calib/prediction/predict.h): the earliest from the fitted noise, the latest with the sigmas
// scaled up by what a bias instability that cannot be excluded yet adds.
//
// At the end of the calibrating part a unit in doubt, or not known well enough, gets the shortest legs that are expected to settle it
// (find_settling), within the rest of settling_allowed_s(); it is judged again at their end. The finding is a journal record `settle`, durable
// before the plan is changed, so that a run resumed after a kill walks the same legs.
//
// The estimate runs in its own thread, and the run waits for it, so that the answer depends on the samples alone.
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
  std::string why_not = {};               // why the run cannot end; empty: enough is known
  bool again = false;                     // its last dwell disagrees with the rest, and may be repeated
  Segments set_aside = {};                // takes of its last dwell that a later one replaces
  std::optional<Settling> settling = {};  // at the end of the plan: how to settle a doubt
  // Index of the item after which enough is expected to be known, with the present sigmas and with the plan's; empty: not by this plan.
  std::optional<std::size_t> end = {}, soonest = {};
  const NeededSigma* worst() const;  // null when there is none
};

// Returns the takes of the last dwell, oldest first. `dwells` (1 or more): how many consecutive dwells of the plan are in the last pose.
Segments takes_of_last(const Segments& segments, std::size_t dwells);

// Returns, for a run that reached its planned end, a line about what is known less well than required; empty: nothing.
std::string not_reached(const Run& run, const RunUnit& unit);

class EnoughWatch {
 public:
  // Receives a line for the log and the operator, and the unit of which least is known.
  using Tell = std::function<void(const std::string& line, const KnownSoFar& unit)>;
  // recordings: one a unit, in their order. All references must outlive this object.
  EnoughWatch(Run& run, std::deque<RecordingSink>& recordings, BackgroundQueue& storage, Tell tell);

  // Answers StationHooks::go_on_with. Blocks for a few milliseconds at most; a decision is returned once it is durable.
  Result<std::optional<std::size_t>> go_on_with(std::size_t next_item);

 private:
  std::vector<KnownSoFar> estimate(std::size_t done_items);  // runs in the thread
  KnownSoFar estimate(const RunUnit& unit, std::size_t done_items);
  KnownSoFar settle(const RunUnit& unit);  // likewise, at the end, where only legs can be added
  double settling_left_s() const;          // 0: nothing more may be added
  struct Look {
    Result<LoadedRecording> loaded;
    Result<CalibrationOutput> output;  // may leave parameters undetermined; the fit is not tested
  };
  Look look(const RunUnit& unit, const Segments& without) const;
  static bool disagrees(const Look& look);  // whether its last dwell disagrees with the others
  Segments to_set_aside(const RunUnit& unit, const Segments& takes) const;
  // Returns the predicted sigmas after the first `items` of the plan, for an ideal unit with this noise.
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
  std::size_t end_item_;   // end of the calibrating part, in the plan that the run began with
  std::size_t last_item_;  // likewise, with the legs that were added
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
