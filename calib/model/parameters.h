// The 24 parameters of Wang (2020) (equations 1, 2 and Table 1) and their names.
//
//   w_b = n * counts_gyro  - N0        f_b = a * counts_accel - A0
//
// n  3x3  diagonal: scale factor, off-diagonal: misalignment (installation error in Wang 2020); arcsec per pulse when the gyros count
//         pulses, dimensionless (start value 1) when the recording holds rad
// N0 3    gyro bias, deg/h
// a  3x3  dimensionless, times the nominal accelerometer pulse weight (or times 1 when the recording holds m/s)
// A0 3    accelerometer bias, g, 1 g = 9.80665 m/s^2 (not the site's gravity)
// a21 = a31 = a32 = 0: the accelerometers define the body frame b (x front, y up, z right), so 21 numbers are free.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "calib/types/recording_types.h"

namespace turncal {

inline constexpr double standard_gravity_mps2 = 9.80665;
inline constexpr double pi = 3.14159265358979323846;
inline constexpr double rad_per_deg = pi / 180.0;
inline constexpr double rad_per_arcsec = pi / 180.0 / 3600.0;
inline constexpr double radps_per_degph = pi / 180.0 / 3600.0;  // deg/h to rad/s
inline constexpr double earth_rate_radps = 7.292115e-5;

inline constexpr int parameter_count = 24;
// The order of Table 1, which is the order of the parameter file and of every 24-vector in this project.
inline constexpr std::array<std::string_view, parameter_count> parameter_keys = {
    "N01", "N02", "N03", "A01", "A02", "A03", "n11", "n12", "n13", "n21", "n22", "n23",
    "n31", "n32", "n33", "a11", "a12", "a13", "a21", "a22", "a23", "a31", "a32", "a33"};
template <class Index>
std::string parameter_key(Index k) {
  return std::string(parameter_keys[std::size_t(k)]);
}
inline constexpr std::array<bool, parameter_count> parameter_is_free = {
    true, true, true, true, true, true, true,  true, true, true,  true,  true,
    true, true, true, true, true, true, false, true, true, false, false, true};

const std::vector<int>& free_parameters();  // the 21

using ParameterVector = Eigen::Matrix<double, parameter_count, 1>;
using ParameterCovariance = Eigen::Matrix<double, parameter_count, parameter_count>;

struct Parameters {
  Eigen::Vector3d N0_degph = Eigen::Vector3d::Zero();
  Eigen::Vector3d A0_g = Eigen::Vector3d::Zero();
  Eigen::Matrix3d n = Eigen::Matrix3d::Identity() * 0.932920;
  Eigen::Matrix3d a = Eigen::Matrix3d::Identity();
};

ParameterVector to_vector(const Parameters& parameters);
Parameters from_vector(const ParameterVector& vector);

// The start values of Wang (2020) for a unit that counts pulses; n = 1 for a recording in rad.
Parameters start_parameters(const RecordingInfo& info);

// SI form for computation: increments of one interval of length dt_s are
//   dtheta_b [rad] = gyro_scale * counts - gyro_bias_radps * dt_s,  dv_b [m/s] = accel_scale * counts - accel_bias_mps2 * dt_s
struct SensorModel {
  Eigen::Matrix3d gyro_scale;  // rad per count
  Eigen::Vector3d gyro_bias_radps;
  Eigen::Matrix3d accel_scale;  // m/s per count
  Eigen::Vector3d accel_bias_mps2;
};
SensorModel sensor_model(const Parameters& parameters, const RecordingInfo& info);
// SI value of one unit of each parameter: rad/s per deg/h, m/s^2 per g, rad per count per unit n, m/s per count per unit a.
ParameterVector si_per_unit(const RecordingInfo& info);
// Returns the nominal angle of one gyro increment, by the start values.
double nominal_gyro_rad(const RecordingInfo& info);

// The random errors of the sensors as the joint estimator weighs them (names of IEEE 952 and 1293).
//
// Angle random walk N_g: white noise of the rate, variance N_g^2 dt of the angle over dt. Velocity random walk N_a likewise.
// Bias instability: a first-order Gauss-Markov process on each axis with standard deviation sigma_b and correlation time
// tau_b, the usual state-space stand-in for flicker noise. With tau_b = 300 s a run of two hours that holds 1/f noise gets
// biases whose sigma is their spread (docs/accuracy.md: 100 s gives 0.6 of it, 600 s 1.4 times).
// Quantisation: the cumulative count is short of the true angle or velocity by an error of up to one pulse, variance q^2/12.
// Not modelled: rate ramps (they are effects: drift, warm-up), noise that depends on rate or specific force.
struct NoiseModel {
  Eigen::Vector3d angle_random_walk = Eigen::Vector3d::Constant(5.8e-7);     // rad/sqrt(s)
  Eigen::Vector3d velocity_random_walk = Eigen::Vector3d::Constant(7.8e-5);  // m/s/sqrt(s)
  double gyro_bias_instability_radps = 0.0;  // sigma_b of the Gauss-Markov process; 0 switches it off
  double accel_bias_instability_mps2 = 0.0;
  Eigen::Matrix<double, 6, 1> unstable =
      Eigen::Matrix<double, 6, 1>::Ones();  // factors of them: gyros x y z, accelerometers x y z
  double bias_correlation_s = 300.0;        // tau_b
  Eigen::Matrix<double, 6, 1> bias_instability() const {
    const double g = gyro_bias_instability_radps, a = accel_bias_instability_mps2;
    return unstable.cwiseProduct((Eigen::Matrix<double, 6, 1>() << g, g, g, a, a, a).finished());
  }
  bool has_bias_instability() const { return bias_instability().maxCoeff() > 0.0; }
  double gyro_pulse_rad = 0.0;  // one-pulse quantisation; 0 for data that are not counted
  double accel_pulse_mps = 0.0;
};

// 1 deg/sqrt(h) in rad/sqrt(s); 1 ug/sqrt(Hz) in m/s/sqrt(s)
inline constexpr double radprs_per_degprh = 3.14159265358979323846 / 180.0 / 60.0;
inline constexpr double mpsprs_per_ugprHz = 9.80665e-6;

}  // namespace turncal
