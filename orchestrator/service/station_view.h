// What a station does, as its files say it: queue, outcomes, the journal of the run, and who holds their locks. Nothing is locked, written or
// asked of the run, so that looking on never holds it up. The states are those of docs/production.md; the headline of an unreadable station
// names the file. Times are by the clock of whoever looks; those of a run by its own, as its journal has them.
//
// Beside it: the configuration of `turncal serve`, what the stations of a results database did in the last 24 hours, and what an operator may do.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/text.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/records/unit_queue.h"
#include "orchestrator/report/document.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

// The password file has lines NAME:HASH, with a hash of crypt(5) (`openssl passwd -6`). It is read at every question, so that a name that is
// taken out is out at once; a file that others than its owner and group can read is refused.
Status check_operators(const std::string& path);
// The name in "Basic ..." (RFC 7617) when its password is right; an error when not, which does not say what was wrong.
Result<std::string> authorised_operator(const std::string& path, std::string_view authorization);

// The keys of docs/production.md. Relative names are those beside the file.
struct ServedStation {
  std::string name, queue, runs;
  std::string mounted;  // empty: a mounted unit is not announced by the page
};

struct AlertConfig {
  std::string command;  // empty: none
  std::string record;
  double time_s = 60.0;
  std::optional<double> least_yield;  // of 1
};

struct ServiceConfig {
  std::vector<ServedStation> stations;  // at least one, names differ
  std::string password_file;            // empty: read-only
  std::string database;                 // empty: no results are shown
  AlertConfig alert = {};
};

Result<ServiceConfig> read_service_config(const std::string& path);

// Of the attempts that say something of their unit (orchestrator/line/shift_report.h); others are in `attempts` alone. Simulated ones are counted
// apart. A database that cannot be read is said; whoever asks goes on.
struct StationResults {
  std::string station;
  bool simulated = false;
  std::size_t attempts = 0, judged = 0, passed = 0;
  std::string last_unit, last_outcome, last_time_utc;
};

struct ResultsView {
  std::string defect;     // why there are none
  std::string until_utc;  // of a day before, where no attempt has ended since; a dry run has a clock of its own
  std::vector<StationResults> stations;
};

// database: as results_database.h has it. Waits a few seconds for it at the most.
ResultsView look_at_results(const std::string& database, double now_utc_s);

std::string json_of(const ResultsView& view);

enum class StationState { running, results, mounting, stopped, idle, unreadable };
template <>
inline constexpr auto enum_words<StationState> = std::to_array({"running", "results", "mounting", "stopped", "idle",
                                                                "unreadable"});

struct StationView {
  std::string name;
  StationState state = StationState::idle;
  Tone tone = Tone::good;
  std::string headline;
  std::vector<std::string> units;  // of the run, or those to be mounted
  std::string folder;              // of the run
  std::string runs;                // where those of the station are
  bool simulated = false;
  bool pausing = false;                  // a pause of the run was asked for
  std::optional<pid_t> process;          // that works on the run, or on the queue
  std::string phase;                     // "step 3: roll from 0 to -90 deg at 20 deg/s"
  std::string began_utc, last_word_utc;  // of the run
  std::optional<double> fraction;        // of the planned time
  std::optional<double> run_end_utc_s, queue_end_utc_s;
  std::string known;                      // sigma against the one needed, of a run that ends when it knows enough
  std::vector<std::string> waiting;       // units to come, in their order
  std::vector<std::string> for_a_person;  // what waits for somebody, the most urgent first
  void urgent(std::string words) { for_a_person.insert(for_a_person.begin(), std::move(words)); }
  std::vector<UnitOutcome> outcomes;  // the newest first
  std::size_t done = 0, passed = 0;   // of the queue
  std::optional<double> unit_s;       // from one unit's end to the next one's
  std::optional<double> silent_s;     // a run that goes on has written nothing for so long: 10 min or more
};

// now_utc_s: by the clock of this machine.
StationView look_at(const ServedStation& station, double now_utc_s);

// Of the last run of a unit: NAME, NAME.2, NAME.3 ...; empty: there is none.
std::string last_folder(const std::string& runs, const std::string& unit);

std::string json_of(const StationView& view);

// The figures of stations and results in the text format 0.0.4 of Prometheus (docs/production.md).
std::string metrics_of(const std::vector<StationView>& stations, const ResultsView& results, double now_utc_s);

// All there is of a unit: what the database has or, without one, the queues. Links lead to what report_file() finds.
Document unit_document(const ServiceConfig& config, const std::string& unit);
// Where the page of a run lies that is served as "/report/STATION/FOLDER/FILE", stations counted from 1; nothing: there is none.
std::optional<std::string> report_file(const ServiceConfig& config, std::string_view path);

// What an operator may do to a station by the page (docs/production.md). Each is written down, with the name, before it is done: a line of
// QUEUE.actions, on disk: "2026-01-31T12:00:00Z NAME pause SN1"; what then fails has a second line, "NAME not done: remove SN1". A signal goes
// to the process that holds the run's lock at that moment, which the system names; no run, no signal.
struct StationAction {
  std::string action, unit;
};

// What was done, in a sentence.
Result<std::string> act(const ServedStation& station, const StationAction& wanted, const std::string& operator_name,
                        double now_utc_s);

}  // namespace turncal
