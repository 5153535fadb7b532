#include "turntable_drivers/rig/rig_math.h"

#include <cmath>

namespace turncal::rig_model {

namespace {

// Taylor series for abs(x) <= pi/4; the first omitted term is below 1e-17 of the result.
SinCos kernel(double x) {
  const double z = x * x;
  double s = 1.0 / 355687428096000.0;  // 1/17!
  s = s * z - 1.0 / 1307674368000.0;
  s = s * z + 1.0 / 6227020800.0;
  s = s * z - 1.0 / 39916800.0;
  s = s * z + 1.0 / 362880.0;
  s = s * z - 1.0 / 5040.0;
  s = s * z + 1.0 / 120.0;
  s = s * z - 1.0 / 6.0;
  double c = 1.0 / 20922789888000.0;  // 1/16!
  c = c * z - 1.0 / 87178291200.0;
  c = c * z + 1.0 / 479001600.0;
  c = c * z - 1.0 / 3628800.0;
  c = c * z + 1.0 / 40320.0;
  c = c * z - 1.0 / 720.0;
  c = c * z + 1.0 / 24.0;
  return {x + x * z * s, 1.0 - (0.5 * z - z * z * c)};
}

SinCos turn(const SinCos& value, long long quarter_turns) {
  switch (quarter_turns & 3) {
    case 0: return value;
    case 1: return {value.cos, -value.sin};
    case 2: return {-value.sin, -value.cos};
    default: return {-value.cos, value.sin};
  }
}

}  // namespace

SinCos sin_cos_deg(double angle_deg) {
  const double quarter = floor_of(angle_deg * (1.0 / 90.0) + 0.5);
  const double remainder_deg = angle_deg - 90.0 * quarter;  // exact
  return turn(kernel(remainder_deg * (pi / 180.0)), static_cast<long long>(quarter));
}

SinCos sin_cos(double angle_rad) {
  // pi/2 in three parts (33 bits, 33 bits, rest), so that quarter * part is exact.
  constexpr double part1 = 1.57079632673412561417e+00;
  constexpr double part2 = 6.07710050630396597660e-11;
  constexpr double part3 = 2.02226624879595063154e-21;
  const double quarter = floor_of(angle_rad * (2.0 / pi) + 0.5);
  const double remainder = ((angle_rad - quarter * part1) - quarter * part2) - quarter * part3;
  return turn(kernel(remainder), static_cast<long long>(quarter));
}

double exp_of(double x) {
  if (x < -700.0) return 0.0;
  constexpr double ln2_high = 6.93147180369123816490e-01;  // 33 bits
  constexpr double ln2_low = 1.90821492927058770002e-10;
  const double k = floor_of(x * 1.44269504088896338700 + 0.5);
  const double r = (x - k * ln2_high) - k * ln2_low;  // abs(r) <= 0.347
  double p = 1.0 / 6227020800.0;                      // 1/13!
  p = p * r + 1.0 / 479001600.0;
  p = p * r + 1.0 / 39916800.0;
  p = p * r + 1.0 / 3628800.0;
  p = p * r + 1.0 / 362880.0;
  p = p * r + 1.0 / 40320.0;
  p = p * r + 1.0 / 5040.0;
  p = p * r + 1.0 / 720.0;
  p = p * r + 1.0 / 120.0;
  p = p * r + 1.0 / 24.0;
  p = p * r + 1.0 / 6.0;
  p = p * r + 0.5;
  p = p * r * r + r;  // exp(r) - 1
  return std::ldexp(1.0 + p, int(k));
}

double log_of(double x) {
  int exponent = 0;
  double m = std::frexp(x, &exponent);  // [0.5, 1)
  if (m < 0.70710678118654752440) {
    m *= 2.0;
    --exponent;
  }
  const double s = (m - 1.0) / (m + 1.0);  // log m = 2 artanh s, abs(s) <= 0.172
  const double z = s * s;
  double p = 0.0;
  for (int i = 21; i >= 1; i -= 2) p = p * z + 1.0 / i;
  constexpr double ln2_high = 6.93147180369123816490e-01;
  constexpr double ln2_low = 1.90821492927058770002e-10;
  return exponent * ln2_high + (2.0 * s * p + exponent * ln2_low);
}

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
    z = double(std::int64_t(bits) >> 11) * 0x1p-52 * tables_->x[layer];
  }
}

}  // namespace turncal::rig_model
