// The Earth as free inertial navigation needs it: WGS-84 ellipsoid, normal gravity, Earth and transport rate.
//
// Source: NIMA TR8350.2 (2000), equations 4-1 (Somigliana) and 4-3 (height); radii of curvature: Titterton and Weston (2004),
// section 3.7. Frame n = north, up, east; latitude geodetic, rad; height above the ellipsoid, m.
//
//   g(L) = g_e (1 + k sin^2 L) / sqrt(1 - e^2 sin^2 L),   g(L, h) = g(L) (1 - 2 h / a (1 + f + m - 2 f sin^2 L) + 3 h^2 / a^2)
//   w_ie = W (cos L, sin L, 0),   w_en = (v_E / (R_E + h), v_E tan L / (R_E + h), -v_N / (R_N + h))
//
// Not modelled: deflection of the vertical, tides. REQUIRES: |L| below 90 deg, tan L is finite.
#pragma once

#include <Eigen/Core>

namespace turncal {

inline constexpr double wgs84_semi_major_m = 6378137.0;
inline constexpr double wgs84_flattening = 1.0 / 298.257223563;
inline constexpr double metres_per_nautical_mile = 1852.0;

double normal_gravity_mps2(double latitude_rad, double height_m);

struct RadiiOfCurvature {
  double north_m = 0.0;  // in the meridian
  double east_m = 0.0;   // in the prime vertical
};
RadiiOfCurvature radii_of_curvature(double latitude_rad);

// What turns the navigation frame: Earth rate and transport rate at one place and velocity, rad/s in n.
struct FrameRates {
  Eigen::Vector3d earth;
  Eigen::Vector3d transport;
};
FrameRates frame_rates(double latitude_rad, double height_m, const Eigen::Vector3d& velocity_n_mps);

// The latitude at which the earth turns as gyros feel it: from a fit (felt_latitude.h), or from calibrated rests alone (alignment.h).
struct FeltLatitude {
  double latitude_rad = 0.0;
  double sigma_rad = 0.0;
  // By more than its error (LatitudeLimits::sigmas) and by more than `least_deg`.
  bool speaks_against(double of_record_rad, double least_deg) const;
};

}  // namespace turncal
