// Overlapping Allan deviation of the static dwells, and the noise coefficients read off it (IEEE 952, annex C).
//
// From prefix sums of whole counts (int64, so nothing is lost in 10^9 of them): theta_k = sum of counts up to second k,
//   avar(tau = m tau0) = 1 / (2 tau^2 M) sum over k of (theta_{k+2m} - 2 theta_{k+m} + theta_k)^2
// over every static dwell that is long enough, dwells pooled; tau0 is one second. Model fitted, weighted by the number of
// independent clusters:   avar = 3 Q^2/tau^2 + N^2/tau + (0.664 B)^2 + K^2 tau/3
// Q quantisation, N random walk coefficient, B bias instability, K rate random walk. Coefficients are not negative.
// What it cannot see: anything slower than half the longest dwell.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct AllanPoint {
  double tau_s = 0.0;
  double deviation = 0.0;  // rad/s or m/s^2
  double clusters = 0.0;   // independent ones, about
};

struct AllanFit {                 // SI: rad or m/s, per sqrt(s), per s, per s^1.5
  double quantisation = 0.0;      // Q
  double random_walk = 0.0;       // N
  double bias_instability = 0.0;  // B
  double rate_random_walk = 0.0;  // K
  double longest_tau_s = 0.0;
};

struct AllanAxis {
  std::vector<AllanPoint> points;
  AllanFit fit;
};

// Axes in the order gyro x y z, accelerometer x y z. Dwells shorter than `min_dwell_s` are left out.
struct AllanResult {
  std::array<AllanAxis, 6> axes;
  double total_s = 0.0;  // static time used
};
AllanResult allan_deviation(const CompressedRecording& recording, const Parameters& parameters,
                            double min_dwell_s = 50.0);

}  // namespace turncal
