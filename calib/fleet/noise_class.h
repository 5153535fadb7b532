// The noise of a part, as the calibrations of its units have measured it, and what it makes of a recording's own.
//
// Of each random walk the logarithm r_u of its rms over the axes, units u scatter: r_u ~ N(r, t^2), mean and variance of U units, the variance
// times (1 + 1/U)(U-1)/(U-3) as in fleet_prior.h; errors of the r_u are part of it. A recording has measured r_0 with sigma_0 (noise_fit.h):
//   r = (r_0 / sigma_0^2 + r_class / t^2) / (1 / sigma_0^2 + 1 / t^2),   share of the class = sigma_0^2 / (sigma_0^2 + t^2)
// and all axes of the triad go with it. A recording whose noise differs by more than chance allows keeps its own, and is named.
// A bias instability that the recording cannot see, and most units of the part have, is the median of theirs.
//
// Not modelled: axes of a triad that differ in all units of the part; noise that grows with age.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

struct NoiseClass {
  // Of the logarithm, of a unit to come: angle, velocity random walk.
  double mean[2] = {0.0, 0.0}, sigma[2] = {0.0, 0.0};
  double gyro_bias_instability_radps = 0.0, accel_bias_instability_mps2 = 0.0;  // 0: most units show none
  std::size_t units = 0;
};

// One of each unit. Empty with fewer than least_prior_units (limits.h).
std::optional<NoiseClass> noise_class(const std::vector<NoiseModel>& units);

struct NoiseOfClass {
  NoiseModel noise;
  double share[2] = {0.0, 0.0};  // of the class: angle, velocity random walk
  double z[2] = {0.0, 0.0};      // of the recording's own from the class
  std::vector<int> changed;      // 0, 1: those whose z is beyond chance, `false_alarm` of both together
};
NoiseOfClass noise_of_class(const NoiseClass& of_part, const NoiseFit& own, double false_alarm = 0.01);

// `estimate` again with that noise: one step beside it. What an instability too small to be seen adds to its covariance stays.
// REQUIRES: an estimate of this recording that leaves no direction open.
JointResult estimate_with_noise(const CompressedRecording& recording, const JointResult& estimate,
                                const NoiseModel& noise);

}  // namespace turncal
