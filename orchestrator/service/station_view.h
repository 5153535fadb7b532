// The state of a station, read from its files: queue, outcomes, the journal of the run, and the holders of their locks. Nothing is locked, written or
// asked of the run, so that looking never delays it. The states are those of docs/production.md; the headline of an unreadable station
// names the file. Times are by this machine's clock; those of a run by its own, from its journal.
//
// Also here: the configuration of `turncal serve`, the results of the stations in the last 24 hours, and the actions of operators.
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

// Checks the password file. It has lines NAME:HASH, with a hash of crypt(5) (`openssl passwd -6`), and is read at every request, so that a
// removed name is out at once; a file that others than its owner and group can read is refused.
Status check_operators(const std::string& path);
// Returns the name in "Basic ..." (RFC 7617) when its password is right; otherwise an error that does not say what was wrong.
Result<std::string> authorised_operator(const std::string& path, std::string_view authorization);

// The keys of docs/production.md. Relative names are relative to the file.
struct ServedStation {
  std::string name, queue, runs;
  std::string mounted;  // empty: the page does not announce mounted units
};

struct AlertConfig {
  std::string command;  // empty: none
  std::string record;
  double time_s = 60.0;
  std::optional<double> least_yield;  // fraction
};

struct ServiceConfig {
  std::vector<ServedStation> stations;  // at least one, names differ
  std::string password_file;            // empty: read-only
  std::string database;                 // empty: no results are shown
  AlertConfig alert = {};
};

Result<ServiceConfig> read_service_config(const std::string& path);

// Counts of attempts that judge their unit (orchestrator/line/shift_report.h); `attempts` has the others, too. Simulated ones are counted
// separately. A database that cannot be read is reported, and is no error.
struct StationResults {
  std::string station;
  bool simulated = false;
  std::size_t attempts = 0, judged = 0, passed = 0;
  std::string last_unit, last_outcome, last_time_utc;
};

struct ResultsView {
  std::string defect;     // why there are no results
  std::string until_utc;  // end of the last attempt, when it is more than 24 h ago; empty: the 24 h end now
  std::vector<StationResults> stations;
};

// database: as in results_database.h. Waits a few seconds for it at most.
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
  std::vector<std::string> units;  // in the run, or to be mounted
  std::string folder;              // of the run
  std::string runs;                // where the station's runs are
  std::string table_warning;       // nobody saw the table at rest with its drives off
  bool simulated = false;
  bool pausing = false;                  // a pause of the run was requested
  std::optional<pid_t> process;          // process of the run, or of the queue
  std::string phase;                     // "step 3: roll from 0 to -90 deg at 20 deg/s"
  std::string began_utc, last_word_utc;  // of the run
  std::optional<double> fraction;        // of the planned time
  std::optional<double> run_end_utc_s, queue_end_utc_s;
  std::string known;                      // sigma against the needed one, in a run that may end early
  std::vector<std::string> waiting;       // units to come, in order
  std::vector<std::string> for_a_person;  // tasks for somebody, the most urgent first
  void urgent(std::string words) { for_a_person.insert(for_a_person.begin(), std::move(words)); }
  std::vector<UnitOutcome> outcomes;  // the last one recorded first
  std::size_t done = 0, passed = 0;   // in the queue
  std::optional<double> unit_s;       // from one run's end to the next one's, for each of its units
  std::size_t at_once = 1;            // units of a run
  std::optional<double> silent_s;     // time for which an active run has written nothing: 10 min or more
};

// now_utc_s: this machine's clock.
StationView look_at(const ServedStation& station, double now_utc_s);

// Returns the folder of a unit's last run: NAME, NAME.2, NAME.3 ...; empty: there is none.
std::string last_folder(const std::string& runs, const std::string& unit);

std::string json_of(const StationView& view);

// Returns figures of stations and results in the text format 0.0.4 of Prometheus (docs/production.md).
std::string metrics_of(const std::vector<StationView>& stations, const ResultsView& results, double now_utc_s);

// Returns everything about a unit: from the database or, without one, from the queues. Links lead to what report_file() finds.
Document unit_document(const ServiceConfig& config, const std::string& unit);
// Returns the path of the page that is served as "/report/STATION/FOLDER/FILE", stations counted from 1; nothing: there is none.
std::optional<std::string> report_file(const ServiceConfig& config, std::string_view path);

// An action of an operator on a station, by the page (docs/production.md). Each is recorded, with the name, before it is done: a line of
// QUEUE.actions, on disk: "2026-01-31T12:00:00Z NAME pause SN1"; a failure adds a second line, "NAME not done: remove SN1". A signal goes
// to the process that holds the run's lock at that moment, as the system tells; without a run there is no signal.
struct StationAction {
  std::string action, unit;
};

// Performs the action and returns what was done, in a sentence.
Result<std::string> act(const ServedStation& station, const StationAction& wanted, const std::string& operator_name,
                        double now_utc_s);

}  // namespace turncal
