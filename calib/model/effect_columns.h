// Effects beyond the 24 parameters, as the filter sees them: what one unit of each component adds to the calibrated reading.
//
// A component c with value p adds p * rate_b (rad/s) to the gyros and p * force_b (m/s^2) to the accelerometers; the model
// takes it off again: corrected = calibrated - p * regressor. Which effects exist is the catalogue's affair (effects.h).
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace turncal {

// What a regressor may look at: the motion over one block for the present parameters, SI units.
struct BlockState {
  Eigen::Vector3d f_b;      // specific force in the middle of the block, m/s^2
  Eigen::Vector3d w_b;      // rate, rad/s
  Eigen::Vector3d w_dot_b;  // angular acceleration, rad/s^2
  Eigen::Matrix3d C_nb;     // attitude in the middle of the block
  double duration_s = 0.0;
  int recording = 0;                                    // of several recordings of a unit: which, from 0
  double time_s = 0.0;                                  // middle of the block, from that recording's first sample
  double since_rotation_s = 0.0;                        // from the end of the last rotation; large before the first
  double temperature_c = 0.0;                           // minus the reference; 0 when not measured
  Eigen::Vector3d table_rad = Eigen::Vector3d::Zero();  // commanded heading, pitch, roll (half way in a rotation)
  Eigen::Vector3d last_up = Eigen::Vector3d::Zero();    // sign of each f_i when it was last above half a g
  // Filled by make_effect_model(), from the blocks before: what followed f_b and temperature with the effect's time constant,
  // both taken as settled at the first sample; and the temperature's rate over the last minute.
  Eigen::Vector3d lagged_f_b = Eigen::Vector3d::Zero();
  double lagged_temperature_c = 0.0;
  double temperature_rate_c_per_h = 0.0;
};

// Writes the regressors of all components: column k of gyro (rad/s) and accel (m/s^2) is one unit of component k.
struct EffectRegressors {
  Eigen::Matrix<double, 3, Eigen::Dynamic> gyro;
  Eigen::Matrix<double, 3, Eigen::Dynamic> accel;
};

struct EffectModel {
  int columns = 0;                                                       // number of components
  std::function<void(const BlockState&, EffectRegressors&)> regressors;  // fills all columns
  Eigen::VectorXd values;  // value of each component in the present model (zero: tested, not used)
  double reference_temperature_c = 0.0;
};

}  // namespace turncal
