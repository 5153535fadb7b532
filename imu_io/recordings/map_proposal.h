// A map for a table that comes without one: by what its header says, and by what its numbers can only be.
//
//   columns     three names that differ in x, y, z (or 1, 2, 3; 0, 1, 2) alone are a triad; "gyr", "omega", "w", "dtheta" ... are gyros, "acc",
//               "specific force", "dv" ... accelerometers. Seven columns without names: the one that only grows is the time, and of the
//               other two triads gravity tells which is the accelerometers'.
//   units       by the header ("[rad s^-1]", "_degps"), and by the numbers: the norm of the accelerometers is mostly gravity's; where the unit
//               turns, du/dt = -w x u of gravity's direction u in the body frame gives the gyros' scale as a regression.
//   time        s, ms, us or ns by the header, else the one in which the rate lies between 6 and 5000 Hz.
//
// What header and numbers do not agree on, or do not say, is in doubt. Not told: axes (as they are named), gravity and latitude of the
// site, scale factors of raw counts, what a rate was filtered with.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/csv_map_import.h"

namespace turncal {

struct ImportSite {
  double gravity_mps2 = 9.80665;
  double latitude_deg = 0.0;
  double rate_hz = 0.0;  // in place of a column of times; 0: that tells it
  std::string unit_serial;
};

inline constexpr std::string_view proposed_beginning = "# A map that turncal import proposed";

struct MapProposal {
  std::string text;                 // of the map, with remarks; what is in doubt stands in it as the likelier
  std::vector<std::string> doubts;  // one clause each
};

// Errors: the file cannot be read, or holds no columns that could be an IMU's.
Result<MapProposal> propose_map(const ColumnSource& source, const ImportSite& site);

}  // namespace turncal
