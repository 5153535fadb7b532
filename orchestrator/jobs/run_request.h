// What a run is asked to do, in words (from the command line, or from the first record of its journal), and what that means:
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
  bool until_sigma = false;  // end after the dwell at which enough is known (verdict.h)
  std::optional<double> settle_minutes;  // may be added to tell confounded effects apart; empty: what the station says
  bool partial = false;                  // estimate what the sequence determines: no verdict, and not put in use
  std::string continues;                 // folder of the run that this one continues; empty: none
  std::string verified;                  // the parameter file that is verified; empty: what the run estimates
  std::vector<std::string> units;        // serial numbers, by place on the table
  std::string began_utc;                 // empty: it has not begun
  std::vector<Settling> settled;         // what a run that goes on has done about its doubts
  std::string rig;                       // files, made absolute by plan_run(); empty: the built-in one
  std::string sequence;
  std::string station;
  // For the record (record_words); empty: not given.
  std::string operator_name, part, lot, revision, ambient;
  std::optional<double> temperature_c;  // of the chamber; empty: what the station says
  std::string overdue_reason;           // why a table whose calibration is overdue is used all the same
  // What is not of the run itself.
  struct Session {
    std::string listen;    // where the status page listens; empty: none
    double pace = 0.0;     // how many times as fast as the wall clock a dry run may go; 0: as it can
    std::string whole;     // of what the run is a part, beside its sequence on the page: "leg 2 of 9, ..."
    bool verbose = false;  // every transition on the terminal
    bool brief = false;    // neither transitions nor results on it: whoever began the run says how it ended
    bool part = false;     // of a batch or a campaign, whose command continues it
  } session;
  bool rehearsal() const { return dry_run && manual; }
};

// What the operator puts on record: its key in journal, parameter file and database, and its option.
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

struct FileHashes {                              // of the bytes that the files were read from
  std::string station, rig, sequence, verified;  // rig: of a dry run
};

// What was asked for, read and checked: nothing is made or moved yet.
struct RunPlan {
  RunRequest request;
  StationConfig station;
  RigConfig rig;
  Sequence sequence;
  Plan plan;            // of the sequence, at this station
  int verify_from = 0;  // number of the step where the north seeking begins; 0: none
  std::optional<ParameterFile> verified;
  FileHashes hashes;
  const std::string& unit() const { return request.units.front(); }  // of a run of one
  // The step where what is calibrated from ends; 0: with the recording.
  int calibration_ends_before() const { return request.capture_only ? 0 : verify_from; }
  // It has no outcome but the recording.
  bool only_captures() const { return request.capture_only && !request.verify; }
  // To which the chamber is brought; empty: the run leaves it alone.
  std::optional<double> temperature_c() const {
    if (request.temperature_c) return request.temperature_c;
    return station.chamber ? station.chamber->temperature_c : std::nullopt;
  }
  bool simulated() const { return request.dry_run || station.simulated(); }
  double sample_period_s() const { return request.dry_run ? rig.sample_period_s : station.imu->frame.sample_period_s; }
};

// Legs that a run adds to its plan, before the north seeking; of a journal, or as they are found. Steps of the plan that are there stay as
// they are. An error where the table may not run them.
inline constexpr const char* settling_name = "settling legs";  // the file of their steps
Status lengthen(RunPlan& run, const Settling& settling);
// How long a run may be made longer to settle what its diagnosis leaves open. 0 where it has none, or nothing turns by itself.
double settling_allowed_s(const RunPlan& run);

inline constexpr std::size_t most_units = 16;  // of a dry run, which has as many places as it is asked for
std::size_t places(const RunPlan& run);
// What a recording of the unit would say, as far as that is known before: of the rig, or (null) by the frame of the station's unit.
RecordingInfo planned_info(const StationConfig& station, const RigConfig* rig);
RecordingInfo planned_info(const RunPlan& run);

// Why no live command can open the station's devices; empty: it can.
std::vector<std::string> no_real_devices(const StationConfig& station);
Status check_real_devices(const StationConfig& station);  // the first of these as an error

// verify.seq after a calibration, and the number of its first step. An error where the latitude lets no gyro tell north.
Result<int> append_north_seeking(const StationConfig& station, Sequence& sequence);

// Everything that is checked before anything is made or moved, but for what check_sequence() looks at.
Result<RunPlan> plan_run(const RunRequest& request);

// The first record of the journal, and back. Files are named by absolute path.
JournalFields begin_fields(RunPlan run);
RunRequest request_of(const JournalContents& journal);
// What the journal says was asked for, with what is given `now`: where the files are now, the units expected, listen, pace, verbose.
Result<RunRequest> request_again(const JournalContents& journal, const RunRequest& now);
// `asked`, of `turncal run --continue DIR`, with unit, station, rig and what is on record of the run in asked.continues: a further recording
// of its unit, in a folder and with a journal of its own. An error where that is not a run of one unit that has
// a whole recording, or where something is asked for that a continuation does not do.
Result<RunRequest> continuing(const RunRequest& asked);
// An error that names the file whose hash is no longer the one of the journal.
Status check_unchanged(const RunPlan& run, const JournalContents& journal);

}  // namespace turncal
