#include "calib/joint/start_noise.h"

#include <algorithm>
#include <cmath>

namespace turncal {

NoiseModel start_noise(const CompressedRecording& recording, const AllanResult& allan, const Parameters& from) {
  NoiseModel noise;
  const SensorModel model = sensor_model(from, recording.info);
  const bool gyro_pulses = recording.info.gyro_increment == IncrementKind::pulses;
  const bool accel_pulses = recording.info.accel_increment == IncrementKind::pulses;
  if (gyro_pulses) noise.gyro_pulse_rad = model.gyro_scale(0, 0);
  if (accel_pulses) noise.accel_pulse_mps = recording.info.accel_pulse_mps;
  // Of the axes of a triad the noisiest stands for all three: in dwells of 100 s an axis that counts close to a whole number
  // of pulses a sample can look three times too quiet, and what follows would be taken for faults.
  double gyro = gyro_pulses ? 0.02 * noise.gyro_pulse_rad : 1e-9;
  double accel = accel_pulses ? 0.02 * noise.accel_pulse_mps : 1e-8;
  // Where no dwell is long enough for the fit, what neighbouring seconds differ by, quantisation included.
  constexpr double shortest_dwell_s = 3.0;
  const bool fitted = allan.total_s > 0.0;
  const AllanResult brief = fitted ? allan : allan_deviation(recording, from, shortest_dwell_s);
  const auto random_walk = [&](const AllanAxis& axis) {
    if (fitted || axis.points.empty()) return axis.fit.random_walk;
    return axis.points.front().deviation * std::sqrt(axis.points.front().tau_s);
  };
  for (std::size_t k = 0; k < 3; ++k) {
    gyro = std::max(gyro, random_walk(brief.axes[k]));
    accel = std::max(accel, random_walk(brief.axes[k + 3]));
  }
  noise.angle_random_walk.setConstant(gyro);
  noise.velocity_random_walk.setConstant(accel);
  return noise;
}

}  // namespace turncal
