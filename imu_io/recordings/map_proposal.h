// Proposes a map for a table that comes without one, from what its header says and what its numbers can be.
//
//   columns     Three names that differ only in x, y, z (or 1, 2, 3; 0, 1, 2) are a triad. "gyr", "omega", "w", "dtheta" ... are gyros, "acc",
//               "specific force", "dv" ... accelerometers. Of seven columns without names the time is the one that only grows, and the
//               accelerometers are the triad that shows gravity.
//   units       The header tells ("[rad s^-1]", "_degps"), and so do the numbers: the norm of the accelerometers is mostly gravity's, and where the unit
//               turns, a regression of du/dt = -w x u, u being gravity's direction in the body frame, gives the gyros' scale.
//   time        The header tells s, ms, us or ns; otherwise it is the unit in which the rate lies between 6 and 5000 Hz.
//
// A thing is in doubt if header and numbers disagree, or if neither tells it. Not told: axes (taken by their names), gravity and latitude of the
// site, scale factors of raw counts, filters of a rate.
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
  double rate_hz = 0.0;  // replaces the column of times; 0: the column gives the rate
  std::string unit_serial;
};

inline constexpr std::string_view proposed_beginning = "# A map that turncal import proposed";

struct MapProposal {
  std::string text;                 // the map with remarks; what is in doubt has its likelier value
  std::vector<std::string> doubts;  // a clause each
};

// Returns an error if the file cannot be read, or has no columns that could be an IMU's.
Result<MapProposal> propose_map(const ColumnSource& source, const ImportSite& site);

}  // namespace turncal
