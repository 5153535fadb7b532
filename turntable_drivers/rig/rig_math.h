// Elementary functions that give the same bits on every machine.
//
// The C library picks another sin, exp or log by the processor (with or without fused multiply-add), and one last bit
// decides now and then on which side of a pulse a sum falls. These use only + - * / and exact operations. Errors are
// below 2 units in the last place in the ranges the rig needs (tests hold them against the library).
#pragma once

namespace turncal::rig_model {

inline constexpr double pi = 3.14159265358979323846;

struct SinCos {
  double sin = 0.0;
  double cos = 1.0;
};
SinCos sin_cos_deg(double angle_deg);  // exact at multiples of 90 degrees; abs(angle) < 1e9
SinCos sin_cos(double angle_rad);      // abs(angle) < 1e5
double exp_of(double x);               // x <= 700; 0 below -700
double log_of(double x);               // REQUIRES: x > 0, normal

// Nearest integer not above x, as std::floor but inline. REQUIRES: abs(x) < 2^62
inline double floor_of(double x) {
  const double truncated = static_cast<double>(static_cast<long long>(x));
  return truncated > x ? truncated - 1.0 : truncated;
}

}  // namespace turncal::rig_model
