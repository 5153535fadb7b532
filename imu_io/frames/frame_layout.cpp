#include "imu_io/frames/frame_layout.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "imu_io/frames/frame_field.h"
#include "imu_io/frames/frame_keys.h"

namespace turncal {
namespace {

// Everything inside its frame, and nothing contradicting.
void check_places(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  const auto inside = [&](const FrameField& field, const char* key) {
    if (field.offset + static_cast<std::size_t>(field.form.bytes) <= variant.length) return;
    const FrameKeys keys(file, variant.name);
    file.reject(keys.name(key), "a place inside the frame of " + std::to_string(variant.length) + " bytes");
  };
  const auto triad_inside = [&](const FrameTriad& triad, const char* key, const char* down) {
    for (const FrameField& field : triad.element) inside(field, key);
    if (!triad.down) return;
    for (const FrameField& field : *triad.down) inside(field, down);
  };
  if (variant.has_gyro) triad_inside(variant.gyro, "gyro.offset", "gyro.down");
  if (variant.has_accel) triad_inside(variant.accel, "accel.offset", "accel.down");
  if (variant.temperature) {
    for (const FrameField& field : variant.temperature->places) inside(field, "temperature.offset");
  }
  if (variant.counter) inside(variant.counter->field, "counter.offset");
  for (const FrameStatus& status : variant.status) inside(status.field, "status.offset");
  if (variant.multiplexer) inside(*variant.multiplexer, "mux.offset");
  if (frame.id) inside(*frame.id, "id.offset");
  if (frame.length) inside(*frame.length, "length.offset");
  if (frame.sync.size() + frame.tail.size() > variant.length) {
    file.reject("length", "room for sync and tail");
  }
  if (frame.check.kind != CheckKind::none) {
    const std::size_t place = check_offset(frame.check, variant.length);
    if (place + static_cast<std::size_t>(frame.check.bytes()) + frame.tail.size() > variant.length ||
        frame.check.start + frame.check.gap >= place) {
      file.reject("check.offset", "a place inside the frame, after what the check covers and before the tail");
    } else if (frame.check.of_words && frame.check.pad % 2 != 0 &&
               (place - frame.check.gap - frame.check.start) % 2 != 0) {
      file.reject("check.offset", "a whole number of 16-bit words covered, or check.pad = 2");
    }
  }
  const FrameVariant& first = frame.variants.front();
  if (!frame.split && (variant.gyro.pulses != first.gyro.pulses || variant.accel.pulses != first.accel.pulses)) {
    file.reject("variants", "variants of the same increments: pulses or not");
  }
  if (variant.counter.has_value() != first.counter.has_value()) file.reject("variants", "all with a counter or none");
  if (variant.counter &&
      (variant.counter->modulus != first.counter->modulus || variant.counter->step != first.counter->step)) {
    file.reject("variants", "variants that count alike");
  }
  for (const FrameVariant& other : frame.variants) {
    if (&other != &variant && other.id == variant.id) file.reject("variants", "a different id for each variant");
  }
}

// The bits of a frame that something takes.
struct Taken {
  std::string key;
  std::vector<std::byte> bits;
};
Taken taken_by(const std::string& key, const FrameField& field, std::size_t length,
               std::uint64_t some = ~std::uint64_t{0}) {
  Taken taken{key, std::vector<std::byte>(length)};
  FieldCodec(field).put_bits(taken.bits.data(), some);
  return taken;
}
Taken taken_by(const std::string& key, std::size_t offset, const std::vector<std::byte>& mask, std::size_t length) {
  Taken taken{key, std::vector<std::byte>(length)};
  std::copy(mask.begin(), mask.end(), taken.bits.begin() + static_cast<std::ptrdiff_t>(offset));
  return taken;
}
bool overlap(const Taken& one, const Taken& other) {
  for (std::size_t i = 0; i < one.bits.size(); ++i)
    if ((one.bits[i] & other.bits[i]) != std::byte{0}) return true;
  return false;
}

// REQUIRES: every place is inside the frame.
void check_overlaps(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  const std::size_t length = variant.length;
  std::vector<Taken> data;
  const auto add_triad = [&](const FrameTriad& triad, const std::string& name) {
    for (const FrameField& field : triad.element) data.push_back(taken_by(name + ".offset", field, length));
    if (!triad.down) return;
    for (const FrameField& field : *triad.down) data.push_back(taken_by(name + ".down", field, length));
  };
  if (variant.has_gyro) add_triad(variant.gyro, "gyro");
  if (variant.has_accel) add_triad(variant.accel, "accel");
  if (variant.temperature)
    for (const FrameField& field : variant.temperature->places)
      data.push_back(taken_by("temperature.offset", field, length));
  if (variant.counter) data.push_back(taken_by("counter.offset", variant.counter->field, length));

  std::vector<Taken> beside = {taken_by("sync", 0, frame.sync_mask, length)};
  if (!frame.tail.empty()) {
    const std::vector<std::byte> whole(frame.tail.size(), std::byte{0xFF});
    beside.push_back(taken_by("tail", length - whole.size(), whole, length));
  }
  if (frame.length) beside.push_back(taken_by("length.offset", *frame.length, length));
  if (frame.id) beside.push_back(taken_by("id.offset", *frame.id, length));
  for (const FrameStatus& status : variant.status)
    beside.push_back(taken_by("status.offset", status.field, length, status.mask));
  // A multiplexer may be the low bits of the counter.
  if (variant.multiplexer) beside.push_back(taken_by("mux.offset", *variant.multiplexer, length));

  const FrameKeys keys(file, variant.name);
  const auto reject = [&](const Taken& one, const Taken& other) {
    file.reject(keys.name(one.key), "a place of its own, not that of " + keys.name(other.key));
  };
  for (std::size_t i = 0; i < data.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j)
      if (overlap(data[i], data[j])) reject(data[i], data[j]);
    for (const Taken& other : beside)
      if (!(data[i].key == "counter.offset" && other.key == "mux.offset") && overlap(data[i], other))
        reject(data[i], other);
  }
  // An id may be a part of what a frame begins with.
  for (std::size_t i = 1; i < beside.size(); ++i)
    if (beside[i].key != "id.offset" && overlap(beside[i], beside[0])) reject(beside[i], beside[0]);
  if (frame.check.kind == CheckKind::none) return;
  const std::vector<std::byte> whole(static_cast<std::size_t>(frame.check.bytes()), std::byte{0xFF});
  const Taken check = taken_by("check.offset", check_offset(frame.check, length), whole, length);
  for (const std::vector<Taken>* const all : {&data, &beside})
    for (const Taken& other : *all)
      if (overlap(check, other)) reject(check, other);
}

std::uint64_t largest(const FrameField& field) { return FieldCodec(field).largest_bits(); }

// Numbers that their fields can show.
void check_values(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  const FrameKeys keys(file, variant.name);
  const auto fits = [&](const char* key, std::uint64_t value, const FrameField& field) {
    if (value > largest(field))
      file.reject(keys.name(key), "at most " + std::to_string(largest(field)) + ", which its field can hold");
  };
  if (frame.id) fits("id.value", variant.id, *frame.id);
  if (variant.temperature && variant.temperature->when && variant.multiplexer)
    fits("temperature.when", *variant.temperature->when, *variant.multiplexer);
  for (const FrameStatus& status : variant.status) {
    const std::uint64_t judged = status.mask & largest(status.field);
    if (judged == 0) file.reject(keys.name("status.bits"), "at least one bit of the field");
    if ((status.good & ~judged) != 0) file.reject(keys.name("status.good"), "a number of status.bits alone");
  }
  if (frame.length) {
    const std::int64_t said = static_cast<std::int64_t>(variant.length) - frame.length_add;
    if (said < 0 || said % frame.length_scale != 0 ||
        static_cast<std::uint64_t>(said / frame.length_scale) > largest(*frame.length))
      file.reject(keys.name("length"),
                  "a length that the field at length.offset can say: field x length.scale + length.add");
  }
}

constexpr int least_bits = 4;  // of a number that shows a motion

// The largest raw number; floating ones have none.
std::optional<double> full_scale(const FrameTriad& triad, std::size_t k) {
  const FrameField& field = triad.element[k];
  const int bits = used_bits(field.form);
  double low = 0.0, high = std::ldexp(1.0, bits) - 1.0;
  if (field.form.type == NumberType::floating) return {};
  if (field.form.type != NumberType::unsigned_integer) low = -(high = std::ldexp(1.0, bits - 1));
  if (triad.kind == FieldKind::cumulative || triad.down) {
    const double turn = triad.modulus != 0 ? static_cast<double>(triad.modulus) : std::ldexp(1.0, bits);
    low = -(high = 0.5 * turn);
  }
  return std::max(std::abs(low - triad.zero[k]), std::abs(high - triad.zero[k]));
}

// A unit shows what it is turned and what it weighs: its field ends beyond the one, and a count is less than the other.
struct Sensible {
  double reaches, count;
  const char *said_reaches, *said_count;
};
constexpr Sensible gyro_rate = {std::numbers::pi / 180.0, 1000.0 * std::numbers::pi / 180.0, "1 deg/s", "1000 deg/s"};
constexpr Sensible accel_force = {9.0, 1000.0, "gravity", "1000 m/s^2"};

void check_scale(KeyValueFile& file, const std::string& key, const FrameTriad& triad, double weight, double period_s,
                 const Sensible& sensible) {
  for (std::size_t k = 0; k < 3; ++k) {
    const std::optional<double> most = full_scale(triad, k);
    const double count = std::abs(triad.scale[k]) * weight / (triad.kind == FieldKind::rate ? 1.0 : period_s);
    if (!most) continue;
    if (count > sensible.count)
      file.reject(key, std::string("a scale with which a count is less than ") + sensible.said_count);
    if (*most * count < sensible.reaches)
      file.reject(key, std::string("a scale with which the field reaches ") + sensible.said_reaches);
  }
}

}  // namespace

void check_layout(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  check_places(file, frame, variant);
  if (!file.status()) return;
  check_overlaps(file, frame, variant);
  check_values(file, frame, variant);
  const FrameKeys keys(file, variant.name);
  for (const FrameTriad* const triad :
       {variant.has_gyro ? &variant.gyro : nullptr, variant.has_accel ? &variant.accel : nullptr})
    if (triad != nullptr && used_bits(triad->element[0].form) < least_bits)
      file.reject(keys.name(triad == &variant.gyro ? "gyro.mask" : "accel.mask"),
                  "a mask that leaves " + std::to_string(least_bits) + " bits or more");
  const auto key = [&](const std::string& name) {
    return keys.name(name + (keys.has(name + ".scale") ? ".scale" : ".unit"));
  };
  if (variant.has_gyro && !variant.gyro.pulses)
    check_scale(file, key("gyro"), variant.gyro, 1.0, frame.sample_period_s, gyro_rate);
  if (!variant.has_accel) return;
  const bool pulses = variant.accel.pulses;
  check_scale(file, pulses ? "accel.pulse_mps" : key("accel"), variant.accel, pulses ? frame.accel_pulse_mps : 1.0,
              frame.sample_period_s, accel_force);
}

}  // namespace turncal
