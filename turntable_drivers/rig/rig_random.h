// The rig's random numbers: the same on every machine for the same seed.
//
// xoshiro256++ (Blackman and Vigna 2019) seeded through splitmix64; normal numbers by the ziggurat method (Marsaglia
// and Tsang 2000) with 256 layers whose tables come from rig_math. Each source of noise has its own stream of the seed,
// so that switching one off leaves the others as they were.
#pragma once

#include <array>
#include <cstdint>

namespace turncal::rig_model {

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
  double uniform() { return (static_cast<double>(next() >> 11) + 0.5) * 0x1p-53; }  // open interval (0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  // Mean 0, variance 1. Layer from the low 8 bits, abscissa from the high 53: they do not overlap.
  double normal() {
    const std::uint64_t bits = next();
    const std::size_t layer = bits & 255;
    const double z = static_cast<double>(static_cast<std::int64_t>(bits) >> 11) * 0x1p-52 * tables_->x[layer];
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
