// One unit's part of a run: its folder, its recording and what is made of it. A run of one unit has them in its own folder, a
// run of several in FOLDER/SERIAL (name_of_unit) each, with journal.tcj and run.log in FOLDER.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/run_results.h"
#include "orchestrator/records/journal_file.h"
#include "orchestrator/run/station_run.h"

namespace turncal {

struct UnitRun {
  PreparedRun run;  // of this unit alone: its serial number and its rig
  std::string folder;
  JournalFields mark;  // "unit", of a run of several: which unit a record of the journal is about
  RunCounts counts{};
  std::optional<LoadedRecording> recording{};  // as it was, or is, sealed
  RunResults results{};
  bool dropped = false;
  Status status{};  // how it ended
};

std::vector<UnitRun> units_of(const PreparedRun& run, const std::string& folder);

// Parameters and verdict of every unit that is left, from sealed recordings; counts as they are. One that cannot be calibrated
// leaves the others running. An error when there is none that can be.
Status calibrate_units(std::vector<UnitRun>& units, double utc_s, JournalFile& journal);
// Prints the results and sets the status of every unit that is left and was calibrated.
void conclude_units(std::vector<UnitRun>& units, double wall_s, const std::string& log, std::ostream& out);

// What became of a unit, in one word: its verdict; captured, dropped, fail (measured, but no parameters came of it), refused
// (nothing was measured). Empty: it has no outcome yet, a fault of the station stopped it.
std::string outcome_of(const UnitRun& unit);

// Of the whole run: success, or the worst kind and a line that names every unit that has something to say.
Status status_of(const std::vector<UnitRun>& units);

// Recordings that were complete when the run was interrupted, one that had no time to be finished among them. False: they are
// not, and the run has to go on with devices.
Result<bool> sealed_recordings(const std::vector<UnitRun>& units);
// Reads every recording once, before it is sealed: what the journal keeps of its contents, by unit. An error when one is damaged.
Result<std::vector<std::string>> read_recordings(std::vector<UnitRun>& units);
// An error when it is damaged, or not the one that the run of this journal sealed for that unit: nothing may be made of it.
Status check_sealed(const LoadedRecording& loaded, const JournalContents& contents, std::size_t unit);
// What the journal says about sealed recordings. An error as above.
Status verify_recordings(std::vector<UnitRun>& units, const JournalContents& contents);
// Of a run that is over: its parameter files are those it made; its recordings are there as they were sealed, or were pruned, and none
// goes on.
Status check_what_is_over(const std::vector<UnitRun>& units, const std::string& folder,
                          const JournalContents& contents);

}  // namespace turncal
