// Draws what the configuration leaves open: the 24 parameters of the unit and the errors of the table.
//
// Every number is drawn whether or not it is used, so that setting one key leaves the others of the same seed
// unchanged. Standard deviations: N0 0.08 deg/h, A0 4e-3 g, off-diagonal n 2e-3 arcsec/pulse, diagonal n 3e-4 of its nominal
// value, diagonal a 3 % (7.5 % at most), off-diagonal a 7e-4; normal, truncated at 2.5 sigma. a21 = a31 = a32 = 0
// unless set.
#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "turntable_drivers/rig/rig_config.h"
#include "turntable_drivers/rig/rig_geometry.h"

namespace turncal::rig_model {

std::array<double, 24> draw_truth(const RigConfig& config);

struct TableErrorsInForce {
  double tilt_north_arcmin = 0.0, tilt_east_arcmin = 0.0, north_arcmin = 0.0;
  double heading_pitch_arcmin = 0.0, pitch_roll_arcmin = 0.0;
  Triple mounting_arcmin{};
  struct Encoder {
    double offset_arcsec = 0.0, scale_ppm = 0.0, harmonic_arcsec = 0.0, phase_deg = 0.0;
    int order = 2;
  };
  std::array<Encoder, 3> encoder;

  GeometryAngles geometry_angles() const;
  std::vector<std::pair<std::string, double>> named() const;
};
TableErrorsInForce draw_table_errors(const RigConfig& config);

}  // namespace turncal::rig_model
