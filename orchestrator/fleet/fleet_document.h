// The diagnosis of a fleet as a document, and as a table for other programs: what is common, stations side by side, units as points over
// time, what to do next.
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/fleet_diagnosis.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/fleet/fleet_members.h"
#include "orchestrator/report/document.h"

namespace turncal {

// "ug/g^2"; of parameters that of the parameter file.
std::string unit_of_component(const std::string& component);
Document fleet_document(const FleetDiagnosis& diagnosis, const FleetSource& source,
                        const std::vector<std::string>& factors);
// A row an effect, then a row a unit that stands out.
DataTable table_of(const FleetDiagnosis& diagnosis, const FleetSource& source);

}  // namespace turncal
