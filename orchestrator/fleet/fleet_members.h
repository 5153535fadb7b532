// Reads the statistics that calibrations have left, as members of a fleet.
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/fleet_diagnosis.h"
#include "calib/types/status.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/report/document.h"

namespace turncal {

// Factors by which members may be grouped: keys record.station, record.lot, record.part; version: software; month: of the measurement.
inline const std::vector<std::string> fleet_factors = {"station", "lot", "part", "version", "month"};

struct FleetSource {
  std::vector<FleetMember> members;
  double first_day = 0.0;            // since 1970-01-01 UTC; members count from it
  std::vector<std::string> skipped;  // files that could not be read, a line each
  bool simulated = false;
};

// Reads every statistics.tcs of a folder or a results database. Of one recording only the newest version counts. "?" is the level of an unknown
// factor. A member without a time has no day, and does not count for changes in time. Errors: no member; simulated and real ones mixed.
Result<FleetSource> read_fleet(const std::string& from, const std::vector<std::string>& factors);

// Returns the diagnosis of a fleet as a document: what is common, stations side by side, units as points over time, what to
// do next.
Document fleet_document(const FleetDiagnosis& diagnosis, const FleetSource& source,
                        const std::vector<std::string>& factors);
// Returns the diagnosis as a table for other programs: a row for each effect, then a row for each unit that stands out.
DataTable table_of(const FleetDiagnosis& diagnosis, const FleetSource& source);

// ---- earlier calibrations as a prior ----

// The prior from earlier calibrations of a fleet (calib/fleet/fleet_prior.h): every trusted parameters.conf without effects in which all 21
// parameters have a sigma. Of one recording only the newest version counts. Left out: the recording itself, files that already
// contain a prior, and simulated files beside real ones.

struct PriorSource {
  std::string from;  // a folder, or a results database (fleet_members.h)
  std::string part;  // record.part; empty: any
};

// Adds the prior to `output`, with keys quality.prior.* that say what came from it, and notes. Errors: a method other than joint, too few
// calibrations.
Status add_prior(const PriorSource& source, const LoadedRecording& recording, const CalibrationRequest& request,
                 CalibrationOutput& output);

}  // namespace turncal
