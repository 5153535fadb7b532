// Elementary functions and random numbers that give the same bits on every machine.
#pragma once

#include <array>
#include <cstdint>

namespace turncal::rig_model {

// The C library chooses its sin, exp or log by the processor (with or without fused multiply-add), and a difference in the last bit
// occasionally changes the pulse in which a sum falls. These functions use only + - * / and exact operations. Errors are
// below 2 units in the last place in the ranges that the rig needs (tests compare them with the library).
inline constexpr double pi = 3.14159265358979323846;

struct SinCos {
  double sin = 0.0;
  double cos = 1.0;
};
SinCos sin_cos_deg(double angle_deg);  // exact at multiples of 90 degrees; abs(angle) < 1e9
SinCos sin_cos(double angle_rad);      // abs(angle) < 1e5
double exp_of(double x);               // x <= 700; 0 below -700
double log_of(double x);               // REQUIRES: x > 0, normal

// Returns the largest integer not above x, like std::floor but inline. REQUIRES: abs(x) < 2^62
inline double floor_of(double x) {
  const double truncated = double(static_cast<long long>(x));
  return truncated > x ? truncated - 1.0 : truncated;
}

// The random numbers of the rig: for a given seed the same on every machine.
//
// xoshiro256++ (Blackman and Vigna 2019) seeded by splitmix64; normal numbers by the ziggurat method (Marsaglia
// and Tsang 2000) with 256 layers, whose tables are computed with rig_math. Each noise source has its own stream of the seed,
// so that switching one off leaves the others unchanged.
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
  // Mean 0, variance 1. The low 8 bits give the layer, the high 53 the abscissa; they do not overlap.
  double normal() {
    const std::uint64_t bits = next();
    const std::size_t layer = bits & 255;
    const double z = double(std::int64_t(bits) >> 11) * 0x1p-52 * tables_->x[layer];
    const double size = z < 0.0 ? -z : z;
    if (size < tables_->x[layer + 1]) return z;
    return normal_slow(layer, z);
  }

  struct Tables {
    std::array<double, 257> x;        // edges of the layers, decreasing; x[0] is the width of the base layer
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
