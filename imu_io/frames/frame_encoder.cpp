#include "imu_io/frames/frame_encoder.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <optional>

#include "imu_io/base/format_number.h"

namespace turncal {
namespace {

// Counters of samples before the unit's zero are negative.
double modulo(double value, double modulus) {
  const double remaining = std::fmod(value, modulus);
  return remaining < 0.0 ? remaining + modulus : remaining;
}

}  // namespace

FrameEncoder::FrameEncoder(const FrameDescription& frame) : frame_(frame), crc_(frame.check.crc), plain_(length()) {}

std::size_t FrameEncoder::length() const {
  return frame_.variants[0].length + (frame_.split ? frame_.variants[1].length : 0);
}

Status FrameEncoder::encode(const ImuSample& sample, std::span<std::byte> out) {
  assert(out.size() >= length());
  const FrameVariant& first = frame_.variants[0];
  if (Status status = encode_variant(first, sample, out.first(first.length)); !status || !frame_.split) return status;
  return encode_variant(frame_.variants[1], sample, out.subspan(first.length, frame_.variants[1].length));
}

Status FrameEncoder::append(const ImuSample& sample, std::vector<std::byte>& out) {
  TRY(encode(sample, plain_));
  std::span<const std::byte> remaining = plain_;
  for (std::size_t i = 0; i < (frame_.split ? 2U : 1U); ++i) {
    append_stuffed(frame_.stuffing, remaining.first(frame_.variants[i].length), frame_.sync.size(), frame_.tail.size(),
                   out);
    remaining = remaining.subspan(frame_.variants[i].length);
  }
  return {};
}

Status FrameEncoder::put_triad(const FrameTriad& triad, const std::array<double, 3>& value, std::size_t first,
                               const char* name, std::byte* out) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto element = static_cast<std::size_t>(triad.from[axis]);
    const FieldCodec field(triad.element[element]);
    std::optional<FieldCodec> down;
    if (triad.down) down.emplace((*triad.down)[element]);
    const double period = triad.kind == FieldKind::rate ? frame_.sample_period_s : 1.0;
    const double factor = triad.sign[axis] * triad.scale[element] * period;
    double& left = left_[first + element];
    const double exact = value[axis] / factor + triad.zero[element] + left;
    bool fits = std::isfinite(exact);
    if (fits && triad.kind == FieldKind::cumulative) {
      const double whole = std::nearbyint(exact);
      left = exact - whole;
      std::uint64_t& total = total_[first + element];
      const std::uint64_t modulus = triad.modulus != 0  ? triad.modulus
                                    : field.bits() < 64 ? std::uint64_t{1} << field.bits()
                                                        : 0;
      fits = std::abs(whole) < (modulus != 0 ? 0.5 * static_cast<double>(modulus) : 0x1p62);
      if (fits) {
        const auto step = static_cast<std::int64_t>(whole);
        std::uint64_t& turned = down && step < 0 ? total_[6 + first + element] : total;
        const std::int64_t by = down ? std::abs(step) : step;
        turned += static_cast<std::uint64_t>(by);
        if (modulus != 0 && turned >= modulus) turned = by >= 0 ? turned - modulus : turned + modulus;
        field.put_bits(out, total);
        if (down) down->put_bits(out, total_[6 + first + element]);
      }
    } else if (fits && down) {
      const double whole = std::nearbyint(exact);
      fits = field.put_number(out, std::max(whole, 0.0)) && down->put_number(out, std::max(-whole, 0.0));
      left = triad.pulses ? 0.0 : exact - whole;
    } else if (fits) {
      fits = field.put_number(out, exact);
      if (fits) left = field.type() == NumberType::floating || triad.pulses ? 0.0 : exact - std::nearbyint(exact);
    }
    if (!fits) {
      return input_error(frame_.name + ": " + name + " " + "xyz"[axis] + " of " + format_number(value[axis]) +
                         " does not fit the frame's field");
    }
  }
  return {};
}

Status FrameEncoder::encode_variant(const FrameVariant& variant, const ImuSample& sample, std::span<std::byte> out) {
  std::fill(out.begin(), out.end(), std::byte{0});
  if (variant.multiplexer && variant.temperature && variant.temperature->when) {
    FieldCodec(*variant.multiplexer).put_bits(out.data(), *variant.temperature->when);
  }
  for (const FrameStatus& status : variant.status) {
    const bool invalid = (sample.flags & sample_flag_invalid) != 0;
    const FieldCodec field(status.field);
    const std::uint64_t judged = status.mask & field.largest_bits();
    const std::uint64_t lowest = judged & (~judged + 1);
    field.put_bits(out.data(), field.bits_of(out.data()) | (invalid ? status.good ^ lowest : status.good));
  }
  Status put;
  if (variant.has_gyro) put = put_triad(variant.gyro, sample.gyro, 0, "gyro", out.data());
  if (put && variant.has_accel) put = put_triad(variant.accel, sample.accel, 3, "accelerometer", out.data());
  if (!put) return put;
  if (variant.temperature && std::isfinite(sample.temperature_c)) {
    const FrameScalar& scalar = *variant.temperature;
    const double raw = static_cast<double>(sample.temperature_c) / scalar.scale + scalar.zero;
    for (const FrameField& place : scalar.places) {
      if (!FieldCodec(place).put_number(out.data(), raw)) {
        return input_error(frame_.name + ": temperature of " + format_number(sample.temperature_c) +
                           " does not fit the frame's field");
      }
    }
  }
  if (variant.counter) {
    const FrameCounter& counter = *variant.counter;
    const double raw = modulo(static_cast<double>(sample.counter) * counter.step, counter.modulus);
    FieldCodec(counter.field).put_number(out.data(), raw);
  }
  if (frame_.id) FieldCodec(*frame_.id).put_bits(out.data(), variant.id);
  if (frame_.length) {
    const std::int64_t raw = (static_cast<std::int64_t>(variant.length) - frame_.length_add) / frame_.length_scale;
    FieldCodec(*frame_.length).put_bits(out.data(), static_cast<std::uint64_t>(raw));
  }
  // Last, so that nothing above can spoil what the search goes by.
  std::copy(frame_.sync.begin(), frame_.sync.end(), out.begin());
  std::copy(frame_.tail.begin(), frame_.tail.end(), out.end() - static_cast<std::ptrdiff_t>(frame_.tail.size()));
  if (frame_.check.kind != CheckKind::none) {
    const std::size_t place = check_offset(frame_.check, out.size());
    FieldCodec(frame_.check.field).put_bits_at(out.data() + place, frame_check_value(frame_.check, crc_, out));
  }
  return {};
}

}  // namespace turncal
