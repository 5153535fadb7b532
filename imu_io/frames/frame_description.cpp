#include "imu_io/frames/frame_description.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <span>

#include "imu_io/base/key_value.h"
#include "imu_io/frames/frame_keys.h"
#include "imu_io/frames/frame_layout.h"
#include "imu_io/lines/serial_port.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {
namespace {

constexpr double degree = std::numbers::pi / 180.0;
constexpr double standard_gravity = 9.80665;

struct Unit {
  std::string_view name;
  double si;
  bool is_rate;
};
constexpr Unit gyro_units[] = {{"rad", 1.0, false},  {"deg", degree, false},  {"arcsec", degree / 3600.0, false},
                               {"rad/s", 1.0, true}, {"deg/s", degree, true}, {"deg/h", degree / 3600.0, true}};
constexpr Unit accel_units[] = {{"m/s", 1.0, false},
                                {"ft/s", 0.3048, false},
                                {"m/s^2", 1.0, true},
                                {"g", standard_gravity, true},
                                {"mg", 1e-3 * standard_gravity, true}};

void read_axes(FrameKeys& keys, const std::string& key, FrameTriad& triad) {
  const std::vector<std::string> axes = keys.file().list_or(keys.name(key), {"+x", "+y", "+z"});
  bool good = axes.size() == 3;
  std::array<bool, 3> seen{};
  for (std::size_t k = 0; good && k < 3; ++k) {
    const std::string& axis = axes[k];
    good = axis.size() == 2 && (axis[0] == '+' || axis[0] == '-') && axis[1] >= 'x' && axis[1] <= 'z';
    if (!good) break;
    const int from = axis[1] - 'x';
    good = !seen[static_cast<std::size_t>(from)];
    seen[static_cast<std::size_t>(from)] = true;
    triad.from[k] = from;
    triad.sign[k] = axis[0] == '-' ? -1.0 : 1.0;
  }
  if (!good) keys.file().reject(keys.name(key), "three axes such as '+x, -z, +y', each letter once");
}

FrameTriad read_triad(FrameKeys& keys, const std::string& prefix, std::span<const Unit> units) {
  FrameTriad triad;
  const std::vector<FrameField> elements = keys.fields(prefix, "i32", 3);
  std::copy_n(elements.begin(), 3, triad.element.begin());
  if (keys.has(prefix + ".down")) {
    const std::vector<FrameField> down = keys.places(prefix + ".down", elements[0].form, 3);
    triad.down.emplace();
    std::copy_n(down.begin(), 3, triad.down->begin());
  }
  read_axes(keys, prefix + ".axes", triad);
  KeyValueFile& file = keys.file();
  const std::string unit_key = keys.name(prefix + ".unit");
  const std::string unit = file.text(unit_key);
  const auto known = std::find_if(units.begin(), units.end(), [&](const Unit& u) { return u.name == unit; });
  triad.pulses = unit == "pulses";
  if (!triad.pulses && known == units.end()) {
    std::string expected = "pulses";
    for (const Unit& u : units) expected += ", " + std::string(u.name);
    file.reject(unit_key, "one of " + expected);
  }
  if (triad.pulses) {
    for (const char* key : {".scale", ".zero"}) {
      if (keys.has(prefix + key))
        file.reject(keys.name(prefix + key), "no such key with unit = pulses: they are counted as they come");
    }
  } else {
    triad.zero = keys.three(prefix + ".zero", 0.0);
    triad.scale = keys.three(prefix + ".scale", 1.0);
    for (double& scale : triad.scale) {
      if (!(std::abs(scale) > 0.0)) file.reject(keys.name(prefix + ".scale"), "numbers other than 0");
      if (known != units.end()) scale *= known->si;
    }
    if (known != units.end() && known->is_rate) triad.kind = FieldKind::rate;
  }
  const NumberType type = triad.element[0].form.type;
  const bool integer = type != NumberType::floating;
  const bool wraps = integer && type != NumberType::sign_magnitude;
  if (triad.down && !wraps) file.reject(keys.name(prefix + ".down"), "no such key unless the field is a counter");
  if (file.one_of_or(keys.name(prefix + ".kind"), "each", {"each", "cumulative"}) == "cumulative") {
    if (!wraps || triad.kind == FieldKind::rate) {
      file.reject(keys.name(prefix + ".kind"), "'each' unless the field is a whole number of increments");
    }
    triad.kind = FieldKind::cumulative;
    triad.modulus = keys.bits(prefix + ".modulus", 0);
    const int bits = used_bits(triad.element[0].form);
    if (triad.modulus == 1 || (bits < 64 && triad.modulus > (std::uint64_t{1} << bits))) {
      file.reject(keys.name(prefix + ".modulus"), "2 to 2^" + std::to_string(bits));
    }
  }
  const std::vector<double> range = file.numbers_or(keys.name(prefix + ".range"), {-1e300, 1e300}, 2);
  triad.low = range[0];
  triad.high = range[1];
  if (!(triad.low < triad.high)) file.reject(keys.name(prefix + ".range"), "lowest, highest");
  return triad;
}

FrameCounter read_counter(FrameKeys& keys) {
  FrameCounter counter;
  KeyValueFile& file = keys.file();
  counter.field = keys.field("counter", "u32");
  counter.step = file.number_or(keys.name("counter.step"), 1.0, between(1e-9, 1e12));
  counter.modulus = file.number_or(keys.name("counter.modulus"), 0.0, not_negative);
  const bool integer = counter.field.form.type != NumberType::floating;
  const double all = integer ? std::ldexp(1.0, used_bits(counter.field.form)) : 0x1p53;
  if (counter.field.form.type == NumberType::signed_integer || counter.field.form.type == NumberType::sign_magnitude) {
    file.reject(keys.name("counter.type"), "an unsigned or floating type");
  }
  if (integer && used_bits(counter.field.form) > 53) {
    file.reject(keys.name("counter.type"), "a counter of at most 53 bits: a mask can leave the upper ones out");
  }
  if (counter.modulus == 0.0) counter.modulus = integer ? all : 0x1p53 * counter.step;
  if (integer && (counter.modulus > all || counter.modulus != std::floor(counter.modulus) ||
                  counter.step != std::floor(counter.step))) {
    file.reject(keys.name("counter.offset"), "a whole step and a whole modulus that fits the field");
  }
  const double wrap = counter.modulus / counter.step;
  if (!(wrap >= 4.0) || std::abs(wrap - std::nearbyint(wrap)) > 1e-6 * std::max(1.0, 1e-6 * wrap)) {
    file.reject(keys.name(keys.has("counter.step") ? "counter.step" : "counter.offset"),
                "a step that divides the modulus into 4 samples or more");
  }
  return counter;
}

FrameVariant read_variant(FrameKeys& keys, const std::string& name, const FrameDescription& frame) {
  KeyValueFile& file = keys.file();
  FrameVariant variant;
  variant.name = name;
  variant.length = static_cast<std::size_t>(
      std::max<std::int64_t>(file.integer(keys.name("length"), 2, static_cast<std::int64_t>(longest_frame)), 0));
  if (frame.id) variant.id = keys.bits("id.value", std::nullopt);
  const std::string carries = file.one_of_or(keys.name("carries"), "both", {"both", "gyro", "accel"});
  variant.has_gyro = carries != "accel";
  variant.has_accel = carries != "gyro";
  if (variant.has_gyro) variant.gyro = read_triad(keys, "gyro", gyro_units);
  if (variant.has_accel) variant.accel = read_triad(keys, "accel", accel_units);
  if (keys.has("mux.offset")) variant.multiplexer = keys.field("mux", "u8");
  if (keys.has("temperature.offset")) {
    FrameScalar scalar;
    scalar.places = keys.fields("temperature", "i16", 0);
    scalar.zero = file.number_or(keys.name("temperature.zero"), 0.0);
    scalar.scale = file.number_or(keys.name("temperature.scale"), 1.0, between(-100.0, 100.0));
    if (scalar.scale == 0.0) file.reject(keys.name("temperature.scale"), "a number other than 0");
    if (keys.has("temperature.when")) {
      scalar.when = keys.bits("temperature.when", std::nullopt);
      if (!variant.multiplexer) file.reject(keys.name("temperature.when"), "a key mux.offset beside it");
    }
    variant.temperature = scalar;
  }
  if (keys.has("counter.offset")) variant.counter = read_counter(keys);
  for (const std::string prefix : {"status", "status2", "status3"}) {
    if (!keys.has(prefix + ".offset")) continue;
    FrameStatus status;
    // Not the field's own mask: a status mask may have holes.
    status.mask = keys.bits(prefix + ".bits", ~std::uint64_t{0});
    status.good = keys.bits(prefix + ".good", 0);
    for (const FrameField& field : keys.fields(prefix, "u8", 0)) {
      status.field = field;
      variant.status.push_back(status);
    }
  }
  return variant;
}

ByteStuffing read_stuffing(FrameKeys& keys, const FrameDescription& frame) {
  ByteStuffing stuffing;
  KeyValueFile& file = keys.file();
  const std::string kind = file.one_of_or("stuffing", "none", {"none", "escape", "slip", "repeat", "cobs"});
  stuffing.kind = kind == "escape"   ? StuffingKind::escape
                  : kind == "slip"   ? StuffingKind::slip
                  : kind == "repeat" ? StuffingKind::repeat
                  : kind == "cobs"   ? StuffingKind::cobs
                                     : StuffingKind::none;
  const auto one_byte = [&](const std::string& key, std::byte otherwise) {
    const std::vector<std::byte> given = keys.bytes(key);
    if (file.has(key) && given.size() != 1) file.reject(key, "one byte of two hexadecimal digits");
    return given.size() == 1 ? given[0] : otherwise;
  };
  if (kind == "escape" || kind == "repeat") {
    stuffing.byte = one_byte("stuffing.byte", stuffing.byte);
    if (kind == "escape") stuffing.flip = one_byte("stuffing.xor", stuffing.flip);
  }
  const auto begins = [&](const std::vector<std::byte>& mark) { return mark.empty() || mark[0] == stuffing.byte; };
  if (kind == "repeat" && !frame.sync.empty() && !(begins(frame.sync) && begins(frame.tail))) {
    file.reject("stuffing", "a sync, and a tail if there is one, that begin with stuffing.byte");
  }
  if (kind == "cobs" && !(frame.sync == std::vector{std::byte{0}} && frame.tail.empty())) {
    file.reject("stuffing", "sync = 00 and no tail: a frame begins behind the 00 that ended the one before");
  }
  return stuffing;
}

Result<FrameDescription> frame_from(KeyValueFile& file) {
  FrameDescription frame;
  frame.file = file.file_name();
  frame.lines = read_line_sources(file);
  FrameKeys keys(file, "");
  file.integer("format", 1, 1);
  frame.name = file.text_or("name", frame.file);
  frame.sync = keys.bytes("sync");
  if (frame.sync.empty()) file.reject("sync", "at least one byte");
  if (!file.has("sync")) file.text("sync");
  frame.sync_mask = keys.bytes("sync.mask");
  if (!file.has("sync.mask")) frame.sync_mask.assign(frame.sync.size(), std::byte{0xFF});
  if (frame.sync_mask.size() != frame.sync.size()) file.reject("sync.mask", "as many bytes as sync");
  if (std::all_of(frame.sync_mask.begin(), frame.sync_mask.end(), [](std::byte b) { return b == std::byte{0}; }))
    file.reject("sync.mask", "at least one bit: without any every byte begins a frame");
  frame.tail = keys.bytes("tail");
  if (file.has("id.offset")) frame.id = keys.field("id", "u8");
  if (file.has("length.offset")) {
    frame.length = keys.field("length", "u8");
    frame.length_scale = file.integer_or("length.scale", 1, 1, 64);
    frame.length_add = file.integer_or("length.add", 0, -1024, 1024);
  }
  frame.sample_period_s = file.number("sample_period_s", sample_period_range);
  frame.stuffing = read_stuffing(keys, frame);
  frame.check = read_frame_check(keys);
  KeyTable table(file);
  read_serial_keys(table, "line", frame.line);
  if (frame.line.data_bits != 8) file.reject("line.data_bits", "8: a frame is of whole bytes");
  for (const std::string& name : file.list_or("variants", {""})) {
    FrameKeys own(file, name);
    frame.variants.push_back(read_variant(own, name, frame));
    if (frame.variants.size() > 16) file.reject("variants", "at most 16");
    if (!file.status()) break;
  }
  if (frame.variants.empty()) {  // refused already, as an empty list
    return file.error_at("variants", "names separated by commas");
  }
  frame.split = std::any_of(frame.variants.begin(), frame.variants.end(),
                            [](const FrameVariant& v) { return !(v.has_gyro && v.has_accel); });
  if (frame.split) {
    const auto& all = frame.variants;
    const bool pair = all.size() == 2 && !all[0].has_accel && !all[1].has_gyro;
    if (!pair) {
      file.reject("variants", "two: the first carries = gyro, the second carries = accel");
      return file.status().error();
    }
    if (!all[0].counter) file.reject("variants", "a counter in both: it tells which two frames are one sample");
  }
  if (!frame.accel().pulses && file.has("accel.pulse_mps")) {
    file.reject("accel.pulse_mps", "no such key unless accel.unit = pulses");
  }
  if (frame.accel().pulses) frame.accel_pulse_mps = file.number("accel.pulse_mps", positive);
  if (file.has("request")) {
    frame.request = keys.bytes("request");
    if (frame.request.empty()) file.reject("request", "at least one byte");
    frame.request_period_s = file.number_or("request.period_s", 0.5 * frame.sample_period_s, sample_period_range);
    if (frame.request_period_s > 0.9 * frame.sample_period_s) {
      file.reject("request.period_s", "at most 0.9 sample_period_s: unit and station have a clock each");
    }
    if (!frame.variants.front().counter) {
      file.reject("request", "a counter beside it: only it tells a new sample from one sent twice");
    }
  }
  if (frame.variants.size() > 1 && !frame.id) file.reject("variants", "a key id.offset beside it");
  TRY(file.check_all_used());
  for (const FrameVariant& variant : frame.variants) {
    check_layout(file, frame, variant);
    frame.longest = std::max(frame.longest, variant.length);
  }
  if (frame.length) frame.longest = longest_frame;
  TRY(file.status());
  return frame;
}

}  // namespace

bool FrameDescription::has_temperature() const {
  return std::any_of(variants.begin(), variants.end(), [](const FrameVariant& v) { return v.temperature.has_value(); });
}

void FrameDescription::describe(RecordingInfo& info) const {
  info.sample_period_s = sample_period_s;
  info.gyro_increment = gyro().pulses ? IncrementKind::pulses : IncrementKind::physical;
  info.accel_increment = accel().pulses ? IncrementKind::pulses : IncrementKind::physical;
  info.accel_pulse_mps = accel_pulse_mps;
  info.has_temperature = has_temperature();
}

Result<FrameDescription> read_frame_description(const std::string& path) {
  auto file = KeyValueFile::read(path);
  if (!file) return file.error();
  return frame_from(*file);
}

Result<FrameDescription> parse_frame_description(std::string_view text, const std::string& file_name) {
  auto file = KeyValueFile::parse(text, file_name);
  if (!file) return file.error();
  return frame_from(*file);
}

}  // namespace turncal
