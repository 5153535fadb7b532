// The diagnosis of a fleet in words, and as a table for other programs.
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/fleet_diagnosis.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/fleet/fleet_members.h"

namespace turncal {

// "ug/g^2"; of parameters that of the parameter file.
std::string unit_of_component(const std::string& component);
// "station line 3: accel_second_order.x 4.1 +- 0.6 ug/g^2 (6.8 sigma, 50 recordings), growing since 2026-04-02 (...)".
std::string describe(const FleetEffect& effect, double first_day);
// What somebody should do about it; empty: nothing that is known.
std::string what_to_do(const FleetEffect& effect);
std::vector<std::string> describe(const FleetDiagnosis& diagnosis, const FleetSource& source,
                                  const std::vector<std::string>& factors);
// A row an effect, then a row a unit that stands out.
DataTable table_of(const FleetDiagnosis& diagnosis, const FleetSource& source);

}  // namespace turncal
