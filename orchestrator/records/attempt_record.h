// An attempt to calibrate a unit as a row of the results database, whatever became of it; and which rows a reader wants.
//
// A run of several units is one attempt of each. Taken up again after an interruption it is the same attempt: its newest row counts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/station/fields.h"

namespace turncal {

// While it goes on, and for ever where the power failed and nobody took it up again.
inline constexpr const char* outcome_running = "running";

struct AttemptRecord {
  std::int64_t id = 0;
  std::string run;  // its beginning and folder, the same when it is taken up again; empty: refused before there was one
  std::string unit, began_utc, time_utc;  // time: of its end
  // A verdict (orchestrator/station/verdict.h), captured, dropped, refused, aborted, interrupted, failed (of the station), running.
  std::string outcome, reason;
  bool simulated = false;
  std::string station, operator_name, part, revision, ambient;
  std::optional<double> temperature_min_c, temperature_max_c;
  std::optional<double> residual;  // quality.normalised_rms
  std::string diagnosis;
  std::optional<double> recorded_s;
  int sessions = 1;
  std::int64_t repeated_dwells = 0, lost_samples = 0;
  std::string folder;
  std::optional<std::int64_t> calibration;  // its row
};

// Columns of the database, in their order; without id, which a row gets there.
Fields fields_of(AttemptRecord& attempt);

// Rows of calibrations or attempts. Empty: any.
struct RecordFilter {
  std::string unit = {}, station = {}, part = {}, verdict = {};
  std::string from = {},
              to = {};  // times of the end, or their beginning: 2026-01-31 as `to` is the whole of that day, UTC
  int newest = 0;       // of attempts: at most so many, the newest; 0: all
};

// An input error unless from and to are the beginning of a time as 2026-01-31T12:00:00Z, from not after to, and
// the verdict is a word that there is.
Status check(const RecordFilter& filter);

}  // namespace turncal
