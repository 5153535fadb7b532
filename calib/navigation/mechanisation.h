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
// The vertical channel of pure inertial navigation diverges within minutes; hold_height shuts it: v_U = 0, or as given.
#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace turncal {

// The Earth as free inertial navigation needs it: WGS-84 ellipsoid, normal gravity, Earth and transport rate.
//
// Source: NIMA TR8350.2 (2000), equations 4-1 (Somigliana) and 4-3 (height); radii of curvature: Titterton and Weston (2004),
// section 3.7. Frame n = north, up, east; latitude geodetic, rad; height above the ellipsoid, m.
//
//   g(L) = g_e (1 + k sin^2 L) / sqrt(1 - e^2 sin^2 L),   g(L, h) = g(L) (1 - 2 h / a (1 + f + m - 2 f sin^2 L) + 3 h^2 / a^2)
//   w_ie = W (cos L, sin L, 0),   w_en = (v_E / (R_E + h), v_E tan L / (R_E + h), -v_N / (R_N + h))
//
// Not modelled: deflection of the vertical, tides. REQUIRES: |L| below 90 deg, tan L is finite.
inline constexpr double wgs84_semi_major_m = 6378137.0;
inline constexpr double wgs84_flattening = 1.0 / 298.257223563;
inline constexpr double metres_per_nautical_mile = 1852.0;

double normal_gravity_mps2(double latitude_rad, double height_m);

struct RadiiOfCurvature {
  double north_m = 0.0;  // in the meridian
  double east_m = 0.0;   // in the prime vertical
};
RadiiOfCurvature radii_of_curvature(double latitude_rad);

// Rates of the navigation frame: Earth rate and transport rate at one place and velocity, rad/s in n.
struct FrameRates {
  Eigen::Vector3d earth;
  Eigen::Vector3d transport;
};
FrameRates frame_rates(double latitude_rad, double height_m, const Eigen::Vector3d& velocity_n_mps);

// The latitude implied by the Earth's rate that the gyros measure: from a fit (felt_latitude.h), or from calibrated rests alone (alignment.h).
struct FeltLatitude {
  double latitude_rad = 0.0;
  double sigma_rad = 0.0;
  // Does it differ by more than its error (LatitudeLimits::sigmas) and by more than `least_deg`?
  bool speaks_against(double of_record_rad, double least_deg) const;
};

// Calibrated increments into intervals of motion: coning and sculling, sample by sample, for any attitude.
//
// Source: Savage, "Strapdown Inertial Navigation Integration Algorithm Design", J. Guidance 21 (1998), part 1 eq. 33-39 and
// part 2 eq. 33-41, the two-sample form with the increment before; Titterton and Weston (2004), 11.2.3 and 11.3.3. With
// increments a (rad) and d (m/s) of a sample and a', d' of the one before:
//
//   rotation vector  phi = a + a' x a / 12
//   velocity, in the axes at the sample's start  u = d + a x d / 2 + a x (a x d) / 6 + (a' x d + d' x a) / 12
//
// An interval holds the product of the rotations and the sum of the velocities, in the axes at the interval's start. It does
// not depend on where navigation began: every branch uses the same intervals.
//
// Lost or bad samples count as the mean of their neighbours. That is good for one or two at rest; more lose the motion
// of the unit, and MotionInterval::missing says so.
// Errors: coning motion at frequency w leaves a share (w dt)^4 / 30 of its rate.
struct MotionInterval {
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();  // from body axes at the end to those at the start
  Eigen::Vector3d push_mps = Eigen::Vector3d::Zero();        // integral of specific force, body axes at the start
  Eigen::Vector3d gyro_rad = Eigen::Vector3d::Zero();        // plain sums of the increments, for sensitivities
  Eigen::Vector3d accel_mps = Eigen::Vector3d::Zero();
  double duration_s = 0.0;
  bool at_rest = false;  // all of it, and turning by less than 0.5 deg/s
  int missing = 0;       // filled-in samples
};

// A sum of durations. Equal ones are counted and multiplied, so that rounding does not add up.
struct Elapsed {
  double begin_s = 0.0, each_s = 0.0;
  std::int64_t count = 0;
  double now_s() const { return begin_s + double(count) * each_s; }
  void add(double duration_s) {
    if (duration_s != each_s) *this = {now_s(), duration_s};
    ++count;
  }
};

// Returns the quaternion of a rotation vector, by series below 0.1 rad (next term 1e-13 of the angle).
Eigen::Quaterniond quaternion_of(const Eigen::Vector3d& rotation_rad);

class IncrementIntegrator {
 public:
  IncrementIntegrator(double sample_period_s, int samples_per_interval)
      : period_s_(sample_period_s), samples_(samples_per_interval) {}

  // Reserves room for this many samples, so that add() does not allocate.
  void reserve(std::int64_t samples);

  // Adds calibrated increments, rad and m/s, of the sample that ends at `counter`. Counters not above the last one are dropped. A
  // bad sample is left out by the caller, and shows as a gap. `gap_at_rest`: samples filled in before this one may count as rest.
  void add(std::int64_t counter, const Eigen::Vector3d& gyro_rad, const Eigen::Vector3d& accel_mps, bool at_rest,
           bool gap_at_rest = true);

  int samples_per_interval() const { return samples_; }
  // Returns the intervals completed so far. A remainder shorter than an interval is never returned.
  const std::vector<MotionInterval>& intervals() const { return intervals_; }

 private:
  void add_one(const Eigen::Vector3d& gyro_rad, const Eigen::Vector3d& accel_mps, bool at_rest, bool filled);

  double period_s_;
  int samples_;
  std::vector<MotionInterval> intervals_;
  MotionInterval open_;
  int count_ = 0;
  bool started_ = false;
  std::int64_t last_counter_ = 0;
  Eigen::Vector3d gyro_before_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_before_ = Eigen::Vector3d::Zero();
};

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

  // Sets the climb rate from here on, with hold_height.
  void set_climb(double up_mps) { climb_mps_ = up_mps; }

  // Removes estimated errors: C_true = Exp(phi) C, v_true = v - dv (phi, dv as in drift.h).
  void correct(const Eigen::Vector3d& phi_rad, const Eigen::Vector3d& dv_mps);
  // Returns to a known place; the velocity stays.
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
