// What a run is asked to do, in words (from the command line, or from the first record of its journal), and what that means:
// station, sequence and rig read and checked, each with the hash of the bytes it was read from.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/records/journal_contents.h"
#include "orchestrator/station/station_config.h"
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
  std::string continues;     // folder of the run that this one continues (continued_run.h); empty: none
  std::string verified;      // the parameter file that is verified; empty: what the run estimates
  std::vector<std::string> units;  // serial numbers, by place on the table
  std::string began_utc;           // of the journal of a run that goes on
  std::string rig;                 // files, made absolute by prepare(); empty: the built-in one
  std::string sequence;
  std::string station;
  // For the record; empty: not given.
  std::string operator_name;
  bool partial = false;  // estimate what the sequence determines: no verdict, and not put in use
  std::string part, lot;
  std::string revision;
  std::string ambient;
  std::string overdue_reason;  // why a table whose calibration is overdue is used all the same
  // Of this attempt only, not of the run: where the status page listens (empty: none), and how many times as fast as the wall
  // clock a dry run may go (0: as it can).
  std::string listen;
  double pace = 0.0;
  bool verbose = false;  // every transition on the terminal
  bool rehearsal() const { return dry_run && manual; }
};

struct PreparedRun {
  RunRequest request;
  StationConfig station;
  RigConfig rig;
  Sequence sequence;
  int verify_from = 0;  // number of the step where the north seeking begins; 0: none
  std::optional<ParameterFile> verified;
  std::string station_hash, rig_hash, sequence_hash, verified_hash;  // rig_hash: of a dry run
  std::string began_utc;                                             // set when the run begins, or that of the journal
  const std::string& unit() const { return request.units.front(); }  // of a run of one
  // The step where what is calibrated from ends; 0: with the recording.
  int calibration_ends_before() const { return request.capture_only ? 0 : verify_from; }
  // It has no outcome but the recording.
  bool only_captures() const { return request.capture_only && !request.verify; }
  bool simulated() const { return request.dry_run || station.simulated(); }
  double sample_period_s() const { return request.dry_run ? rig.sample_period_s : station.imu->frame.sample_period_s; }
};

inline constexpr std::size_t most_units = 16;  // of a dry run, which has as many places as it is asked for
std::size_t places(const PreparedRun& run);
// What a recording of the unit would say, as far as that is known before: of the rig, or (null) by the frame of the station's unit.
RecordingInfo planned_info(const StationConfig& station, const RigConfig* rig);
RecordingInfo planned_info(const PreparedRun& run);

// An error unless table and unit are both ones that a live command can open.
Status check_real_devices(const StationConfig& station);

// verify.seq after a calibration, and the number of its first step. An error where the latitude lets no gyro tell north.
Result<int> append_north_seeking(const StationConfig& station, Sequence& sequence);

// Everything that is checked before anything is made or moved.
Result<PreparedRun> prepare(const RunRequest& request);

// The first record of the journal, and back. Files are named by absolute path.
JournalFields begin_fields(const PreparedRun& run);
RunRequest request_of(const JournalContents& journal);
// An error that names the file whose hash is no longer the one of the journal.
Status check_unchanged(const PreparedRun& run, const JournalContents& journal);

}  // namespace turncal
