#include "imu_io/frames/frame_values.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace turncal {
namespace {

constexpr double largest_pulses = 2147483647.0;  // what a recording holds

// (now - before) modulo the modulus, as the nearest to 0.
double cumulative_step(std::uint64_t now, std::uint64_t before, std::uint64_t modulus) {
  if (modulus == 0) return static_cast<double>(static_cast<std::int64_t>(now - before));
  const std::uint64_t up = now >= before ? now - before : modulus - (before - now);
  if (up <= modulus / 2) return static_cast<double>(up);
  return -static_cast<double>(modulus - up);
}

}  // namespace

std::array<FrameElement, 6> frame_elements(const FrameVariant& variant, double sample_period_s) {
  std::array<FrameElement, 6> elements;
  for (std::size_t i = 0; i < 6; ++i) {
    const FrameTriad& triad = i < 3 ? variant.gyro : variant.accel;
    const auto place = static_cast<std::size_t>(triad.axes.from[i % 3]);
    FrameElement& element = elements[i];
    element.field = triad.element[place];
    if (triad.down) element.down = (*triad.down)[place];
    element.zero = triad.zero[place];
    element.factor =
        triad.axes.sign[i % 3] * triad.scale[place] * (triad.kind == FieldKind::rate ? sample_period_s : 1.0);
    element.low = triad.low;
    element.high = triad.high;
    element.cumulative = triad.kind == FieldKind::cumulative;
    element.modulus = triad.modulus;
    if (element.cumulative && element.modulus == 0 && element.field.bits() < 64)
      element.modulus = std::uint64_t{1} << element.field.bits();
    element.pulses = triad.pulses;
  }
  return elements;
}

FrameVariant joined(FrameVariant gyro, const FrameVariant& accel) {
  FrameVariant both = std::move(gyro);
  const std::size_t by = both.length;
  both.length += accel.length;
  both.accel = accel.accel;
  for (FrameField& field : both.accel.element) field.shift(by);
  if (both.accel.down)
    for (FrameField& field : *both.accel.down) field.shift(by);
  for (const FrameStatus& status : accel.status) {
    both.status.push_back(status);
    both.status.back().field.shift(by);
  }
  if (both.temperature || !accel.temperature) return both;
  both.temperature = accel.temperature;
  for (FrameField& field : both.temperature->places) field.shift(by);
  both.multiplexer = accel.multiplexer;
  if (both.multiplexer) both.multiplexer->shift(by);
  return both;
}

bool FrameValues::read(const std::byte* frame, const CumulativeBase& base, ImuSample& sample) const {
  for (std::size_t i = 0; i < 6; ++i) {
    const FrameElement& element = element_[i];
    double& value = i < 3 ? sample.gyro[i] : sample.accel[i - 3];
    if (element.cumulative) {
      const std::uint64_t now = element.field.bits_of(frame);
      if (element.modulus != 0 && now >= element.modulus) return false;
      double steps = cumulative_step(now, base.field[i], element.modulus);
      if (element.down) {
        const std::uint64_t down = element.down->bits_of(frame);
        if (element.modulus != 0 && down >= element.modulus) return false;
        steps -= cumulative_step(down, base.field[6 + i], element.modulus);
      }
      value = (base.known ? element.factor * steps : 0.0) + 0.0;
      continue;  // across a gap it may be anything
    }
    double raw = element.field.number(frame);
    if (element.down) raw -= element.down->number(frame);
    if (raw < element.low || raw > element.high) sample.flags |= sample_flag_invalid;
    value = element.factor * (raw - element.zero);
    value += 0.0;                             // -0 of a sign turned round
    if (!std::isfinite(value)) return false;  // of floats
    if (element.pulses && (std::abs(value) > largest_pulses || value != std::nearbyint(value))) return false;
  }
  for (const FrameStatus& status : from_.status)
    if ((status.field.bits_of(frame) & status.mask) != status.good) sample.flags |= sample_flag_invalid;
  return true;
}

bool FrameValues::any_cumulative() const {
  return std::any_of(element_.begin(), element_.end(), [](const FrameElement& element) { return element.cumulative; });
}

bool FrameValues::fits(const ImuSample& sample) const {
  for (std::size_t i = 0; i < 6; ++i) {
    const double value = i < 3 ? sample.gyro[i] : sample.accel[i - 3];
    if (element_[i].pulses && std::abs(value) > largest_pulses) return false;
  }
  return true;
}

void FrameValues::keep(const std::byte* frame, CumulativeBase& base) const {
  for (std::size_t i = 0; i < 6; ++i) {
    base.field[i] = element_[i].field.bits_of(frame);
    if (element_[i].down) base.field[6 + i] = element_[i].down->bits_of(frame);
  }
  base.known = true;
}

std::optional<float> FrameValues::temperature_c(const std::byte* frame) const {
  const std::optional<FrameScalar>& from = from_.temperature;
  if (!from || (from->when && from_.multiplexer->bits_of(frame) != *from->when)) return {};
  double sum = 0.0;
  for (const FrameField& field : from->places) sum += field.number(frame);
  const auto value = static_cast<float>((sum / static_cast<double>(from->places.size()) - from->zero) * from->scale);
  return std::isfinite(value) ? value : std::numeric_limits<float>::quiet_NaN();
}

}  // namespace turncal
