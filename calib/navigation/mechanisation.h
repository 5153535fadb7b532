// Free inertial navigation: attitude, velocity and position from intervals of motion, in the local-level frame.
//
// Source: Titterton and Weston (2004), 3.5.3 (local geographic mechanisation); Savage (1998), parts 1 and 2. With C = C_nb,
// z = (w_ie + w_en) T, rates and gravity at the middle of the interval:
//
//   v  += (I - [z x] / 2) C push + (g_n - (2 w_ie + w_en) x v) T
//   C   = Exp(-z) C turn,      L' = v_N / (R_N + h),  lon' = v_E / ((R_E + h) cos L),  h' = v_U
//
// Frames: n = north, up, east; b = x front, y up, z right; v_n = C_nb v_b. rad, m/s, m.
//
// Gravity is the site's where navigation begins and follows WGS-84 from there (the calibration knows the accelerometers in
// units of the site's gravity, so that nothing else would be consistent).
// The vertical channel of pure inertial navigation runs away within minutes; with hold_height it is shut: v_U = 0, or as given.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "calib/navigation/earth.h"
#include "calib/navigation/increments.h"

namespace turncal {

struct NavigationState {
  Eigen::Quaterniond q_nb = Eigen::Quaterniond::Identity();
  Eigen::Vector3d velocity_n_mps = Eigen::Vector3d::Zero();
  double latitude_rad = 0.0;
  double longitude_rad = 0.0;
  double height_m = 0.0;
};

class Navigator {
 public:
  // `gravity_mps2`: at the place of `start`.
  Navigator(const NavigationState& start, double gravity_mps2, bool hold_height);

  void advance(const MotionInterval& interval);
  const NavigationState& state() const { return state_; }

  // With hold_height: how fast it rises from here on.
  void set_climb(double up_mps) { climb_mps_ = up_mps; }

  // Estimated errors taken off: C_true = Exp(phi) C, v_true = v - dv (phi, dv as in drift.h).
  void correct(const Eigen::Vector3d& phi_rad, const Eigen::Vector3d& dv_mps);
  // Back to a place known, with the velocity left as it is.
  void set_position(double latitude_rad, double longitude_rad, double height_m);

 private:
  NavigationState state_;
  double gravity_offset_mps2_;  // of the site over WGS-84
  bool hold_height_;
  double climb_mps_ = 0.0;
  FrameRates rates_;  // of the interval before
};

// Heading (0 to 2 pi, clockwise from north), pitch and roll of C_nb = Ry(-H) Rz(P) Rx(R), rad.
struct AttitudeAngles {
  double heading_rad = 0.0, pitch_rad = 0.0, roll_rad = 0.0;
};
AttitudeAngles angles_of(const Eigen::Quaterniond& q_nb);

// Displacement from a reference place along the ellipsoid, m north and east. For distances far below the Earth's radius.
Eigen::Vector2d displacement_m(const NavigationState& state, double latitude_rad, double longitude_rad);

}  // namespace turncal
