#include "imu_io/frames/frame_encoder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <optional>

#include "imu_io/base/text.h"

namespace turncal {
namespace {

// Returns a value in [0, modulus), also for the negative counters of samples before the unit's zero.
double modulo(double value, double modulus) {
  const double remaining = std::fmod(value, modulus);
  return remaining < 0.0 ? remaining + modulus : remaining;
}

}  // namespace

FrameEncoder::FrameEncoder(const FrameDescription& frame) : frame_(frame), crc_(frame.check.crc), plain_(length()) {}

std::span<const FrameVariant> FrameEncoder::used() const {
  return std::span(frame_.variants).first(frame_.split ? 2 : 1);
}

std::size_t FrameEncoder::length() const {
  std::size_t bytes = 0;
  for (const FrameVariant& variant : used()) bytes += variant.length;
  return bytes;
}

Status FrameEncoder::encode(const ImuSample& sample, std::span<std::byte> out) {
  assert(out.size() >= length());
  for (const FrameVariant& variant : used()) {
    TRY(encode_variant(variant, sample, out.first(variant.length)));
    out = out.subspan(variant.length);
  }
  return {};
}

Status FrameEncoder::append(const ImuSample& sample, std::vector<std::byte>& out) {
  TRY(encode(sample, plain_));
  std::span<const std::byte> remaining = plain_;
  for (const FrameVariant& variant : used()) {
    append_stuffed(frame_.stuffing, remaining.first(variant.length), frame_.sync.size(), frame_.tail.size(), out);
    remaining = remaining.subspan(variant.length);
  }
  return {};
}

// Returns false when the value does not fit the field.
bool FrameEncoder::put(const FrameValue& element, std::size_t i, double value, std::byte* out) {
  const FrameField& field = element.field;
  const std::optional<FrameField>& down = element.down;
  const double exact = value / element.factor + element.zero + left_[i];
  if (!std::isfinite(exact)) return false;
  const double whole = std::nearbyint(exact);
  if (element.cumulative) {
    left_[i] = exact - whole;
    const std::uint64_t modulus = element.modulus;
    if (!(std::abs(whole) < (modulus != 0 ? 0.5 * double(modulus) : 0x1p62))) return false;
    const auto step = std::int64_t(whole);
    std::uint64_t& turned = total_[down && step < 0 ? 6 + i : i];
    const std::int64_t by = down ? std::abs(step) : step;
    turned += std::uint64_t(by);
    if (modulus != 0 && turned >= modulus) turned = by >= 0 ? turned - modulus : turned + modulus;
    field.put_bits(out, total_[i]);
    if (down) down->put_bits(out, total_[6 + i]);
    return true;
  }
  const bool fits = down ? field.put_number(out, std::max(whole, 0.0)) && down->put_number(out, std::max(-whole, 0.0))
                         : field.put_number(out, exact);
  const bool exactly = element.pulses || (!down && field.type() == NumberType::floating);
  if (fits || down) left_[i] = exactly ? 0.0 : exact - whole;
  return fits;
}

Status FrameEncoder::encode_variant(const FrameVariant& variant, const ImuSample& sample, std::span<std::byte> out) {
  std::ranges::fill(out, std::byte{0});
  if (variant.multiplexer && variant.temperature && variant.temperature->when)
    variant.multiplexer->put_bits(out.data(), *variant.temperature->when);
  for (const FrameStatus& status : variant.status) {
    const bool invalid = (sample.flags & sample_flag_invalid) != 0;
    const FrameField& field = status.field;
    const std::uint64_t judged = status.mask & field.largest_bits();
    const std::uint64_t lowest = judged & (~judged + 1);
    field.put_bits(out.data(), field.bits_of(out.data()) | (invalid ? status.good ^ lowest : status.good));
  }
  const auto refuse = [&](const std::string& what, auto value) {
    return input_error("{}: {} of {} does not fit the frame's field", frame_.name, what, format_number(value));
  };
  for (std::size_t i = variant.has_gyro ? 0 : 3; i < (variant.has_accel ? 6U : 3U); ++i) {
    const double value = channel_of(sample, i);
    if (!put(variant.values[i], i, value, out.data()))
      return refuse(fmt::format("{} {}", i < 3 ? "gyro" : "accelerometer", "xyz"[i % 3]), value);
  }
  if (variant.temperature && std::isfinite(sample.temperature_c)) {
    const FrameScalar& scalar = *variant.temperature;
    const double raw = double(sample.temperature_c) / scalar.scale + scalar.zero;
    for (const FrameField& place : scalar.places)
      if (!place.put_number(out.data(), raw)) return refuse("temperature", sample.temperature_c);
  }
  if (variant.counter) {
    const FrameCounter& counter = *variant.counter;
    const double raw = modulo(double(sample.counter) * counter.step, counter.modulus);
    counter.field.put_number(out.data(), raw);
  }
  if (frame_.id) frame_.id->put_bits(out.data(), variant.id);
  if (frame_.length) {
    const std::int64_t raw = (std::int64_t(variant.length) - frame_.length_add) / frame_.length_scale;
    frame_.length->put_bits(out.data(), std::uint64_t(raw));
  }
  // Written last, so that no field can overwrite what the decoder searches for.
  std::ranges::copy(frame_.sync, out.begin());
  std::ranges::copy(frame_.tail, out.end() - std::ptrdiff_t(frame_.tail.size()));
  if (frame_.check.kind != CheckKind::none) {
    const std::size_t place = check_offset(frame_.check, out.size());
    frame_.check.field.put_bits_at(out.data() + place, frame_check_value(frame_.check, crc_, out));
  }
  return {};
}

}  // namespace turncal
