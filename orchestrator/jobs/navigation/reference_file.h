// The reference of `turncal navigate`: a table with the columns time_s, latitude_deg, longitude_deg and, where they are known, height_m,
// velocity_north_mps and velocity_east_mps. Text (CSV) or .mat; the names are those of track.csv.
#pragma once

#include <string>

#include "calib/navigation/reference_track.h"
#include "calib/types/status.h"

namespace turncal {

// Errors, kind input: file, line, and what was expected.
Result<ReferenceTrack> read_reference(const std::string& path);

}  // namespace turncal
