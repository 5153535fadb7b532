// A run from beginning to end: `begin_run` in a new folder, `resume_run` where one was interrupted.
//
// The folder holds journal.tcj and run.log; there, or below it for each of several units (run.h), are recording.partial.tcr
// (recording.tcr once sealed), parameters.conf, and after a dry run truth.conf. A run that failed before it moved the table leaves
// nothing; one that failed later leaves its log and journal, and can be taken up.
#pragma once

#include <string>
#include <vector>

#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/records/journal.h"

namespace turncal {

struct RunEnd {
  Status status;  // of the whole run: what the command returns
  struct Unit {
    std::string serial, folder;
    std::string outcome;  // in one word (outcome_of, run.h)
    Status status;
  };
  std::vector<Unit> units;  // none: refused before anything was made
  bool moved = false;       // the table was homed or sent somewhere: there is something to tell
  bool to_the_end = false;  // whatever became of single units, the table and the run are in order

  RunEnd(Status how) : status(std::move(how)) {}
  RunEnd(Error why) : status(std::move(why)) {}
  static RunEnd of_all(Status how) {
    RunEnd end(std::move(how));
    end.to_the_end = true;
    return end;
  }
};

// Every unit that is left has its verdict: nothing to resume.
bool is_over(const JournalContents& journal);

// That the station can run the sequence, and that what it is for can come of it. Part of begin_run; a batch asks before its first unit.
Status check_sequence(const RunPlan& run);

RunEnd begin_run(const RunRequest& request, const std::string& folder, CommandContext& context);

// `now`: where the files are now that the journal names (station, sequence, rig); empty: where they were; and listen and pace.
// The devices must be the same kind (simulated or not), the units and every hash those of the journal.
RunEnd resume_run(const std::string& folder, const RunRequest& now, CommandContext& context);

}  // namespace turncal
