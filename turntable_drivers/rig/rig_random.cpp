#include "turntable_drivers/rig/rig_random.h"

#include <cmath>

#include "turntable_drivers/rig/rig_math.h"

namespace turncal::rig_model {
namespace {

constexpr double tail_start = 3.6541528853610088;  // 256 layers of equal area
constexpr double layer_area = 0.00492867323399;

const RandomStream::Tables& shared_tables() {
  static const RandomStream::Tables tables;
  return tables;
}

}  // namespace

RandomStream::Tables::Tables() {
  const auto gauss = [](double value) { return exp_of(-0.5 * value * value); };
  x[0] = layer_area / gauss(tail_start);
  x[1] = tail_start;
  for (std::size_t i = 2; i < 256; ++i) x[i] = std::sqrt(-2.0 * log_of(layer_area / x[i - 1] + gauss(x[i - 1])));
  x[256] = 0.0;
  for (std::size_t i = 0; i <= 256; ++i) density[i] = gauss(x[i]);
}

RandomStream::RandomStream(std::uint64_t seed, std::uint64_t stream) : tables_(&shared_tables()) {
  std::uint64_t z = seed ^ (stream * 0xD1B54A32D192ED03ULL);
  for (std::uint64_t& word : state_) {  // splitmix64
    z += 0x9E3779B97F4A7C15ULL;
    std::uint64_t mixed = z;
    mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9ULL;
    mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EBULL;
    word = mixed ^ (mixed >> 31);
  }
}

RandomStream::RandomStream(const std::array<std::uint64_t, 4>& state) : state_(state), tables_(&shared_tables()) {}

double RandomStream::normal_slow(std::size_t layer, double z) {
  for (;;) {
    const double size = z < 0.0 ? -z : z;
    if (size < tables_->x[layer + 1]) return z;
    if (layer == 0) {  // the tail beyond the base layer
      double beyond = 0.0, height = 0.0;
      do {
        beyond = -log_of(uniform()) / tail_start;
        height = -log_of(uniform());
      } while (2.0 * height <= beyond * beyond);
      return z < 0.0 ? -(tail_start + beyond) : tail_start + beyond;
    }
    const double low = tables_->density[layer];
    const double high = tables_->density[layer + 1];
    if (low + uniform() * (high - low) < exp_of(-0.5 * z * z)) return z;
    const std::uint64_t bits = next();
    layer = bits & 255;
    z = static_cast<double>(static_cast<std::int64_t>(bits) >> 11) * 0x1p-52 * tables_->x[layer];
  }
}

}  // namespace turncal::rig_model
