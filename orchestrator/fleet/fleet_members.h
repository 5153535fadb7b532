// The statistics that calibrations have left, as members of a fleet.
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/fleet_diagnosis.h"
#include "calib/types/status.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/report/document.h"

namespace turncal {

// What members may be grouped by: keys record.station, record.lot, record.part; version: software; month: of the measurement.
inline const std::vector<std::string> fleet_factors = {"station", "lot", "part", "version", "month"};

struct FleetSource {
  std::vector<FleetMember> members;
  double first_day = 0.0;            // since 1970-01-01 UTC; members count from it
  std::vector<std::string> skipped;  // a line each: what could not be read
  bool simulated = false;
};

// Every statistics.tcs of a folder or a results database. The same recording counts once: the newest version of it. Level of what is not known: "?". A member
// whose time is not known has no day, and does not count where changes in time are looked for. Errors: not one; simulated and real together.
Result<FleetSource> read_fleet(const std::string& from, const std::vector<std::string>& factors);

// The diagnosis of a fleet as a document, and as a table for other programs: what is common, stations side by side, units as points over
// time, what to do next.
Document fleet_document(const FleetDiagnosis& diagnosis, const FleetSource& source,
                        const std::vector<std::string>& factors);
// A row an effect, then a row a unit that stands out.
DataTable table_of(const FleetDiagnosis& diagnosis, const FleetSource& source);

// ---- earlier calibrations as a prior ----

// Parameter files of earlier calibrations as what was known of a fleet before (calib/fleet/fleet_prior.h): every parameters.conf whose 21
// parameters are all known, that is trusted and without effects. The same recording counts once: the newest version of it. Left out: the
// recording itself, what has a prior in it already, simulated ones beside real ones.

struct PriorSource {
  std::string from;  // a folder, or a results database (fleet_members.h)
  std::string part;  // record.part; empty: any
};

// `output` with the prior in it, and what came from it in keys quality.prior.*; notes say so. Errors: a method other than joint, too few
// calibrations.
Status add_prior(const PriorSource& source, const LoadedRecording& recording, const CalibrationRequest& request,
                 CalibrationOutput& output);

}  // namespace turncal
