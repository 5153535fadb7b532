// The sensor effects of the rig beyond the 24 parameters: the catalogue of docs/diagnosis.md, and
// effects that no entry of the catalogue describes.
//
// Convention for every entry. The sensor's counts satisfy
//   n * counts - N0 = w + (sum of gyro effects)       a * counts - A0 = f + (sum of accelerometer effects)
// per unit time, where w = w_ib_b [rad/s] and f = f_b [m/s^2, or g where the table says so] are true and in body axes.
// A positive coefficient makes the calibrated sensor read high. Effects are first order: each is computed from the
// true f and w, never from the output of another effect. i is the sensor's own axis.
//
//   accel_second_order K       + K 1e-6 g0 f_i^2                    ug/g^2   f in g
//   accel_scale_asymmetry c    + c 1e-6 g0 abs(f_i)                 ppm
//   accel_odd_quadratic K      + K 1e-6 g0 f_i abs(f_i)             ug/g^2
//   accel_third_order K        + K 1e-6 g0 f_i^3                    ug/g^3
//   accel_cross_coupling K     + K 1e-6 g0 f_j f_k                  ug/g^2   columns: xy, xz, yz
//   accel_size_effect r_i      + row i of (w' x r_i + w x (w x r_i))   mm    row i of the matrix is the arm of sensor i
//   accel_delay tau            + tau (w x f)                        ms
//   accel_bias_temperature c   + c 1e-6 g0 (T - T_ref)              ug/C
//   accel_scale_temperature c  + c 1e-6 (T - T_ref) f_i             ppm/C
//   accel_bias_drift c         + c 1e-6 g0 t                        ug/h     t [h] from the rig's first sample
//   accel_bias_temperature_rate c  + c 1e-6 g0 dT/dt                ug/(C/h)
//   gyro_g_sensitivity G       + G f                                deg/h/g  row: gyro, column: component of f
//   gyro_scale_asymmetry c     + c 1e-6 abs(w_i)                    ppm
//   gyro_rate_nonlinearity c   + c 1e-6 abs(w_i) w_i / (10 deg/s)   ppm at 10 deg/s
//   gyro_bias_temperature c    + c (T - T_ref)                      deg/h/C
//   gyro_scale_temperature c   + c 1e-6 (T - T_ref) w_i             ppm/C
//   gyro_bias_drift c          + c t                                deg/h/h  t [h] from the rig's first sample
//   gyro_bias_temperature_rate c   + c dT/dt                        deg/h/(C/h)
//   gyro_warm_up c             + c exp(-t/tau_s)                    deg/h
//   gyro_magnetic M            + M B_b                              deg/h/G  B_b the site's field in body axes
//   earth_rate                 + C_bn (north, up, 0)                deg/h    error of the stated earth rate
//   post_rotation_relaxation c + c 1e-6 exp(-t/tau_s) f_i           ug/g     t from the true end of the last motion;
//                                                                            zero before the first, and moving
//   gyro_accel_flexure E       + (E f) x w                          arcsec/g row: component of the rotation vector E f
//
// g0 = 9.80665 m/s^2. T is the true temperature, T_ref is RigConfig::temperature.reference_c.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/types/axis.h"

namespace turncal {

using Triple = std::array<double, 3>;
using Nine = std::array<double, 9>;  // 3x3, row by row

struct RigEffects {
  Triple accel_second_order{};
  Triple accel_scale_asymmetry{};
  Triple accel_odd_quadratic{};
  Triple accel_third_order{};
  Nine accel_cross_coupling{};
  Nine accel_size_effect{};
  double accel_delay = 0.0;
  Triple accel_bias_temperature{};
  Triple accel_scale_temperature{};
  Triple accel_bias_drift{};
  Nine gyro_g_sensitivity{};
  Triple gyro_scale_asymmetry{};
  Triple gyro_rate_nonlinearity{};
  Triple gyro_bias_temperature{};
  Triple gyro_scale_temperature{};
  Triple gyro_bias_drift{};
  Triple gyro_warm_up{};
  double gyro_warm_up_tau_s = 1200.0;
  Nine gyro_magnetic{};
  std::array<double, 2> earth_rate{};  // north, up
  Triple post_rotation_relaxation{};
  double post_rotation_relaxation_tau_s = 5.0;
  Nine gyro_accel_flexure{};
  Triple gyro_bias_temperature_rate{};
  Triple accel_bias_temperature_rate{};
};

// Returns "accel_second_order.x" and so on: every coefficient in the order of the catalogue (tau_s is not a coefficient).
std::vector<std::string> rig_effect_keys();
// Returns the coefficient of a key, or nullptr if there is no such key. "gyro_warm_up.tau_s" and
// "post_rotation_relaxation.tau_s" are accepted, too.
double* find_effect(RigEffects& effects, std::string_view key);
// Returns the keys and values of all coefficients that are not zero.
std::vector<std::pair<std::string, double>> nonzero_effects(const RigEffects& effects);

// Effects outside the catalogue, one of each kind; a size of zero switches one off. axis: 0 x, 1 y, 2 z of the sensors.
struct RigOutsideEffects {
  struct Step {  // + size on the bias from time_s on
    int axis = 0;
    double time_s = 0.0;
    double size = 0.0;  // deg/h for the gyro, ug for the accelerometer
  } gyro_bias_step, accel_bias_step;
  struct AnglePeriodic {  // + size sin(order * true angle of the table axis + phase)
    int axis = 0;
    Axis table_axis = Axis::heading;
    int order = 1;
    double size_degph = 0.0;
    double phase_deg = 0.0;
  } gyro_angle_periodic;
  struct TimePeriodic {  // + size sin(2 pi t / period + phase)
    int axis = 0;
    double size_ug = 0.0;
    double period_s = 600.0;
    double phase_deg = 0.0;
  } accel_time_periodic;
  // + size * s, where s is the sign that f_i had when abs(f_i) last exceeded 0.5 g (0 before that): the sensor remembers which way
  // up it was. s changes only at the end of a sample.
  struct Hysteresis {
    int axis = 0;
    double size_ug = 0.0;
  } accel_hysteresis;
};

}  // namespace turncal
