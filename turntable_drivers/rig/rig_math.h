// Elementary functions and random numbers that give the same bits on every machine.
#pragma once

#include <array>
#include <cstdint>

namespace turncal::rig_model {

// The C library picks another sin, exp or log by the processor (with or without fused multiply-add), and one last bit
// decides now and then on which side of a pulse a sum falls. These use only + - * / and exact operations. Errors are
// below 2 units in the last place in the ranges the rig needs (tests hold them against the library).
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
  const double truncated = double(static_cast<long long>(x));
  return truncated > x ? truncated - 1.0 : truncated;
}

// The rig's random numbers: the same on every machine for the same seed.
//
// xoshiro256++ (Blackman and Vigna 2019) seeded through splitmix64; normal numbers by the ziggurat method (Marsaglia
// and Tsang 2000) with 256 layers whose tables come from rig_math. Each source of noise has its own stream of the seed,
// so that switching one off leaves the others as they were.
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, std::uint64_t stream);
  explicit RandomStream(const std::array<std::uint64_t, 4>& state);  // for the published check values; not all zero

  std::uint64_t next() {
    const std::uint64_t result = rotate(state_[0] + state_[3], 23) + state_[0];
    const std::uint64_t shifted = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= shifted;
    state_[3] = rotate(state_[3], 45);
    return result;
  }
  double uniform() { return (double(next() >> 11) + 0.5) * 0x1p-53; }  // open interval (0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  // Mean 0, variance 1. Layer from the low 8 bits, abscissa from the high 53: they do not overlap.
  double normal() {
    const std::uint64_t bits = next();
    const std::size_t layer = bits & 255;
    const double z = double(std::int64_t(bits) >> 11) * 0x1p-52 * tables_->x[layer];
    const double size = z < 0.0 ? -z : z;
    if (size < tables_->x[layer + 1]) return z;
    return normal_slow(layer, z);
  }

  struct Tables {
    std::array<double, 257> x;        // layer edges, falling; x[0] is the width of the base layer
    std::array<double, 257> density;  // exp(-x^2/2)
    Tables();
  };

 private:
  static std::uint64_t rotate(std::uint64_t value, int by) { return (value << by) | (value >> (64 - by)); }
  double normal_slow(std::size_t layer, double z);

  std::array<std::uint64_t, 4> state_;
  const Tables* tables_;
};

}  // namespace turncal::rig_model
