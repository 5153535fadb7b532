// `turncal allan`: the noise of a unit at rest (docs/allan.md). SI throughout: rad/s and m/s^2.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <turncal/recording.h>
#include <turncal/report.h>

namespace turncal::v0 {

struct AllanPoint {
  double tau_s = 0.0;
  double deviation = 0.0;        // rad/s or m/s^2
  double low = 0.0, high = 0.0;  // 68.3 % interval
  double degrees = 0.0;          // degrees of freedom
};

// Units: rad or m/s, then per sqrt(s), per s, per s^1.5, per s^2.
struct AllanCoefficient {
  double value = 0.0;  // 0: not seen
  double sigma = 0.0;
  double limit = 0.0;  // 95 % upper limit of a coefficient that is not seen
};

struct AllanAxis {
  std::vector<AllanPoint> points;
  std::array<AllanCoefficient, 5>
      coefficients;  // Q N B K R: quantisation, random walk, bias instability, rate random walk, rate ramp
};

struct Allan {
  std::array<AllanAxis, 6> axes;  // gyro x y z, accelerometer x y z
  double rest_s = 0.0;            // time at rest
  std::string csv;                // allan.csv
  std::string imu_yaml;           // for Kalibr
  Report report;
};

TURNCAL_API Allan allan(const Recording& recording);

}  // namespace turncal::v0
