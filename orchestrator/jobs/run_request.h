// The request for a run, as text from the command line or from the first record of its journal, and the plan made from it:
// station, sequence and rig read and checked, each with the hash of the bytes it was read from.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/station/station_config.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"
#include "turntable_drivers/rig/rig_config.h"

namespace turncal {

struct RunRequest {
  bool dry_run = false;
  bool manual = false;  // the table is turned by hand, whatever the station says
  bool capture_only = false;
  bool no_diagnosis = false;
  bool verify = false;       // seek north with the calibration, in the same walk of the table (docs/verification.md)
  bool until_sigma = false;  // end after the dwell after which enough is known (verdict.h)
  std::optional<double> settle_minutes;  // may be added to separate confounded effects; empty: the station's
  bool partial = false;                  // estimate what the sequence determines: no verdict, not put in use
  std::string continues;                 // folder of the run that this one continues; empty: none
  std::string verified;                  // parameter file to verify; empty: the run's own estimate
  std::vector<std::string> units;        // serial numbers, in order of place on the table
  std::string began_utc;                 // empty: it has not begun
  std::vector<Settling> settled;         // what a resumed run has done about its doubts
  std::string rig;                       // files, made absolute by plan_run(); empty: built in
  std::string sequence;
  std::string station;
  // For the record (record_words); empty: not given.
  std::string operator_name, part, lot, revision, ambient;
  std::optional<double> temperature_c;  // of the chamber; empty: the station's
  std::string overdue_reason;           // why a table with an overdue calibration is used
  // Settings of this session, not of the run.
  struct Session {
    std::string listen;    // address of the status page; empty: none
    double pace = 0.0;     // speed limit of a dry run, relative to the wall clock; 0: none
    std::string whole;     // what the run is a part of, for the page: "leg 2 of 9, ..."
    bool verbose = false;  // print every transition
    bool brief = false;    // print neither transitions nor results: the caller reports
    bool part = false;     // part of a batch or a campaign, whose command continues it
  } session;
  bool rehearsal() const { return dry_run && manual; }
};

// A word that the operator puts on record: its key in journal, parameter file and database, and its option.
struct RecordWord {
  const char* key;
  std::string RunRequest::*word;
  const char *option, *help;
};
inline constexpr RecordWord overdue_word = {"overdue_reason", &RunRequest::overdue_reason, "--override-due",
                                            "reason for using a table whose calibration is overdue, for the record"};
inline constexpr RecordWord record_words[] = {
    {"operator", &RunRequest::operator_name, "--operator", "name of the operator, for the record"},
    {"part", &RunRequest::part, "--part", "part number of the unit, for the record"},
    {"lot", &RunRequest::lot, "--lot", "lot of the unit, for the record and the fleet"},
    {"revision", &RunRequest::revision, "--revision", "revision of the unit, for the record"},
    {"ambient", &RunRequest::ambient, "--ambient", "ambient conditions, for the record (\"22.5 C, 45 %\")"},
    overdue_word};

struct FileHashes {                              // hashes of the files' bytes
  std::string station, rig, sequence, verified;  // rig: in a dry run
};

// A request, read and checked; nothing has been made or moved yet.
struct RunPlan {
  RunRequest request;
  StationConfig station;
  RigConfig rig;
  Sequence sequence;
  Plan plan;            // plan of the sequence at this station
  int verify_from = 0;  // number of the first step of the north seeking; 0: none
  std::optional<ParameterFile> verified;
  FileHashes hashes;
  const std::string& unit() const { return request.units.front(); }  // of a run of one unit
  // Returns the first step that is not used for calibration; 0: all are.
  int calibration_ends_before() const { return request.capture_only ? 0 : verify_from; }
  // Returns whether the recording is the only outcome.
  bool only_captures() const { return request.capture_only && !request.verify; }
  // Returns the chamber's set point; empty: the run leaves it alone.
  std::optional<double> temperature_c() const {
    if (request.temperature_c) return request.temperature_c;
    return station.chamber ? station.chamber->temperature_c : std::nullopt;
  }
  bool simulated() const { return request.dry_run || station.simulated(); }
  double sample_period_s() const { return request.dry_run ? rig.sample_period_s : station.imu->frame.sample_period_s; }
};

// Adds legs to the plan, before the north seeking: from a journal, or as they are found. The present steps of the plan stay as
// they are. An error when the table may not run them.
inline constexpr const char* settling_name = "settling legs";  // file name of their steps
Status lengthen(RunPlan& run, const Settling& settling);
// Returns the time that a run may add to settle doubts of its diagnosis. 0 without a diagnosis, or on a table turned by hand.
double settling_allowed_s(const RunPlan& run);

inline constexpr std::size_t most_units = 16;  // in a dry run, which has as many places as needed
std::size_t places(const RunPlan& run);
// Returns the header that a recording of the unit would have, as far as known: of the rig, or (null) by the frame of the station's unit.
RecordingInfo planned_info(const StationConfig& station, const RigConfig* rig);
RecordingInfo planned_info(const RunPlan& run);

// Returns why no live command can open the station's devices; empty: one can.
std::vector<std::string> no_real_devices(const StationConfig& station);
Status check_real_devices(const StationConfig& station);  // the first of these, as an error

// Appends verify.seq to a calibration and returns the number of its first step. An error at latitudes where gyros cannot find north.
Result<int> append_north_seeking(const StationConfig& station, Sequence& sequence);

// Reads what a request names and plans it.
Result<RunPlan> read_run(const RunRequest& request);
// Plans a run with every check that is made before anything is made or moved, except check_sequence().
Result<RunPlan> plan_run(const RunRequest& request);

// Convert the request to the first record of the journal, and back. Files are named by absolute path.
JournalFields begin_fields(RunPlan run);
RunRequest request_of(const JournalContents& journal);
// Returns the journal's request updated with `now`: where the files are now, overdue reason, no diagnosis, session. The units must agree.
Result<RunRequest> request_again(const JournalContents& journal, const RunRequest& now);
// Completes the request of `turncal run --continue DIR` with unit, station, rig and records of the run in asked.continues: a further recording
// of its unit, with its own folder and journal. An error when that is not a run of one unit with a complete recording, or when `asked`
// has an option that a continuation does not support.
Result<RunRequest> continuing(const RunRequest& asked);
// Returns an error that names a file whose hash differs from the journal's.
Status check_unchanged(const RunPlan& run, const JournalContents& journal);

}  // namespace turncal
