// Reads a frame description and rejects one that no unit can have.
#include "imu_io/frames/frame_description.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "calib/model/parameters.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {
namespace {

constexpr std::uint64_t all_bits = ~std::uint64_t{0};

// ---- keys ----
//
// Keys of a variant: `<variant>.<key>` if the file has it, else `<key>`, which then holds for all variants (KeyValueFile::set_scope).

template <class Value>
void chosen(KeyValueFile& file, const std::string& key, Value& value, const std::vector<std::string>& names) {
  KeyTable(file).chosen(key, value, names);
}

// Reads a decimal number, or a hexadecimal one after 0x. Without `otherwise` the key is required.
std::uint64_t read_bits(KeyValueFile& file, const std::string& key, std::optional<std::uint64_t> otherwise) {
  if (otherwise && !file.has(key)) return *otherwise;
  const auto value = parse_whole<std::uint64_t>(file.text(key));
  if (!value) file.reject(key, "a whole number, 0x before hexadecimal, at most 64 bits");
  return value.value_or(0);
}

// Reads hexadecimal bytes: "EB 90".
std::vector<std::byte> read_bytes(KeyValueFile& file, const std::string& key) {
  std::vector<std::byte> result;
  const std::string text = file.text_or(key, "");
  for (const std::string_view part : split_words(text)) {
    const auto value = parse_integer<unsigned>(part, 16);
    if (!value || part.size() != 2 || result.size() >= 16) {
      file.reject(key, "at most 16 bytes of two hexadecimal digits, with blanks between");
      return {};
    }
    result.push_back(static_cast<std::byte>(*value));
  }
  return result;
}

// Reads the keys prefix.type, .order, .word_order and .mask.
FieldForm read_form(KeyValueFile& file, const std::string& prefix, std::string_view default_type) {
  FieldForm form;
  std::string type = file.one_of_or(prefix + ".type", default_type,
                                    {"u8", "i8", "u16", "i16", "u24", "i24", "u32", "i32", "u64", "i64", "f32", "f64",
                                     "sm8", "sm16", "sm24", "sm32"});
  if (type.empty()) type = default_type;  // rejected above
  form.type = static_cast<NumberType>(std::string_view("uisf").find(type[0]));
  form.bytes = parse_integer<int>(std::string_view(type).substr(type[0] == 's' ? 2 : 1)).value_or(8) / 8;
  const auto own = [&](const std::string& key) { return file.has(prefix + "." + key) ? prefix + "." + key : key; };
  chosen(file, own("order"), form.big_endian, {"little", "big"});
  chosen(file, own("word_order"), form.swap_words, {"same", "swapped"});
  form.swap_words = form.swap_words && form.bytes >= 4;
  form.mask = read_bits(file, prefix + ".mask", all_bits);
  const std::uint64_t room = all_bits >> (64 - 8 * form.bytes);
  const std::uint64_t left = form.mask & room;
  const std::uint64_t run = left == 0 ? 0 : left >> std::countr_zero(left);
  const char* const expected = form.type == NumberType::floating && left != room ? "no mask on a floating field"
                               : left == 0              ? "a mask that leaves something of the field"
                               : (run & (run + 1)) != 0 ? "a mask of neighbouring bits"
                                                        : nullptr;
  if (expected == nullptr) return form;
  file.reject(prefix + ".mask", expected);
  form.mask = all_bits;
  return form;
}

// Reads the offsets at `key`, one or `wanted` (0: any number). If only one is given, the other fields follow it.
std::vector<FrameField> read_places(KeyValueFile& file, const std::string& key, const FieldForm& form,
                                    std::size_t wanted) {
  const std::vector<double> offsets = file.numbers(key, 0, between(0.0, double(longest_frame - 1)));
  std::vector<FrameField> result;
  const auto whole = [](double x) { return x >= 0.0 && x == std::floor(x); };
  if (!std::ranges::all_of(offsets, whole) || offsets.empty() || offsets.size() > 16 ||
      (wanted != 0 && offsets.size() != 1 && offsets.size() != wanted)) {
    file.reject(key, wanted > 1 ? fmt::format("1 or {} whole byte offsets", wanted) : "a whole byte offset");
    return std::vector(std::max<std::size_t>(wanted, 1), FrameField(0, form));
  }
  for (const double offset : offsets) result.emplace_back(std::size_t(offset), form);
  while (result.size() < wanted) result.emplace_back(result.back().end(), form);
  return result;
}
std::vector<FrameField> read_fields(KeyValueFile& file, const std::string& prefix, std::string_view default_type,
                                    std::size_t wanted) {
  return read_places(file, prefix + ".offset", read_form(file, prefix, default_type), wanted);
}
FrameField read_field(KeyValueFile& file, const std::string& prefix, std::string_view default_type) {
  return read_fields(file, prefix, default_type, 1)[0];
}

// ---- the parts of a description ----

// Reads three values, whose keys are in the order of the frame.
void read_triad(KeyValueFile& file, const std::string& prefix, const std::vector<std::string>& units,
                double sample_period_s, std::span<FrameValue, 3> values) {
  const std::vector<FrameField> fields = read_fields(file, prefix, "i32", 3);
  const FieldForm& form = fields[0].form();
  std::vector<FrameField> down;
  if (file.has(prefix + ".down")) down = read_places(file, prefix + ".down", form, 3);
  const AxisOrder axes = read_axes(file, prefix + ".axes", true, "three axes such as '+x, -z, +y', each letter once");
  const InertialUnit* const unit = read_unit(file, prefix + ".unit", units);
  const bool is_rate = unit != nullptr && unit->is_rate;
  FrameValue value;  // common to all three
  std::array<double, 3> zero{}, scale{1.0, 1.0, 1.0};
  value.pulses = file.text_or(prefix + ".unit", "") == "pulses";
  if (value.pulses) {
    for (const char* key : {".scale", ".zero"})
      if (file.has(prefix + key))
        file.reject(prefix + key, "no such key with unit = pulses: they are counted as they come");
  } else {
    zero = one_or_three(file, prefix + ".zero", 0.0, "one or three numbers");
    scale = one_or_three(file, prefix + ".scale", 1.0, "one or three numbers");
    for (double& one : scale) {
      if (!(std::abs(one) > 0.0)) file.reject(prefix + ".scale", "numbers other than 0");
      if (unit != nullptr) one *= unit->si;
    }
  }
  const bool wraps = form.type == NumberType::unsigned_integer || form.type == NumberType::signed_integer;
  if (!down.empty() && !wraps) file.reject(prefix + ".down", "no such key unless the field is a counter");
  chosen(file, prefix + ".kind", value.cumulative, {"each", "cumulative"});
  if (value.cumulative) {
    if (!wraps || is_rate) file.reject(prefix + ".kind", "'each' unless the field is a whole number of increments");
    const int bits = fields[0].bits();
    const std::uint64_t all = bits < 64 ? std::uint64_t{1} << bits : 0;
    value.modulus = read_bits(file, prefix + ".modulus", 0);
    if (value.modulus == 1 || (all != 0 && value.modulus > all))
      file.reject(prefix + ".modulus", "2 to 2^" + std::to_string(bits));
    if (value.modulus == 0) value.modulus = all;
  }
  read_range(file, prefix + ".range", value.low, value.high, "lowest, highest");
  for (std::size_t k = 0; k < 3; ++k) {
    const auto from = std::size_t(axes.from[k]);
    values[k] = value;
    values[k].field = fields[from];
    if (!down.empty()) values[k].down = down[from];
    values[k].zero = zero[from];
    values[k].factor = axes.sign[k] * scale[from] * (is_rate ? sample_period_s : 1.0);
  }
}

FrameCounter read_counter(KeyValueFile& file) {
  FrameCounter counter;
  counter.field = read_field(file, "counter", "u32");
  counter.step = file.number_or("counter.step", 1.0, between(1e-9, 1e12));
  counter.modulus = file.number_or("counter.modulus", 0.0, not_negative);
  const NumberType type = counter.field.type();
  const bool integer = type != NumberType::floating;
  const double all = integer ? std::ldexp(1.0, counter.field.bits()) : 0x1p53;
  if (type == NumberType::signed_integer || type == NumberType::sign_magnitude)
    file.reject("counter.type", "an unsigned or floating type");
  if (integer && counter.field.bits() > 53)
    file.reject("counter.type", "a counter of at most 53 bits: a mask can leave the upper ones out");
  if (counter.modulus == 0.0) counter.modulus = integer ? all : 0x1p53 * counter.step;
  const auto whole = [](double x) { return x == std::floor(x); };
  if (integer && (counter.modulus > all || !whole(counter.modulus) || !whole(counter.step)))
    file.reject("counter.offset", "a whole step and a whole modulus that fits the field");
  const double wrap = counter.modulus / counter.step;
  if (!(wrap >= 4.0) || std::abs(wrap - std::nearbyint(wrap)) > 1e-6 * std::max(1.0, 1e-6 * wrap))
    file.reject(file.has("counter.step") ? "counter.step" : "counter.offset",
                "a step that divides the modulus into 4 samples or more");
  return counter;
}

FrameScalar read_temperature(KeyValueFile& file, bool multiplexed) {
  FrameScalar scalar;
  scalar.places = read_fields(file, "temperature", "i16", 0);
  scalar.zero = file.number_or("temperature.zero", 0.0);
  scalar.scale = file.number_or("temperature.scale", 1.0, between(-100.0, 100.0));
  if (scalar.scale == 0.0) file.reject("temperature.scale", "a number other than 0");
  if (!file.has("temperature.when")) return scalar;
  scalar.when = read_bits(file, "temperature.when", std::nullopt);
  if (!multiplexed) file.reject("temperature.when", "a key mux.offset beside it");
  return scalar;
}

FrameVariant read_variant(KeyValueFile& file, const std::string& name, const FrameDescription& frame) {
  FrameVariant variant;
  variant.name = name;
  variant.length = std::size_t(std::max<std::int64_t>(file.integer("length", 2, std::int64_t(longest_frame)), 0));
  if (frame.id) variant.id = read_bits(file, "id.value", std::nullopt);
  int carries = 0;
  chosen(file, "carries", carries, {"both", "gyro", "accel"});
  variant.has_gyro = carries != 2;
  variant.has_accel = carries != 1;
  const std::span<FrameValue, 6> values = variant.values;
  if (variant.has_gyro)
    read_triad(file, "gyro", {"pulses", "rad", "deg", "arcsec", "rad/s", "deg/s", "deg/h"}, frame.sample_period_s,
               values.first<3>());
  if (variant.has_accel)
    read_triad(file, "accel", {"pulses", "m/s", "ft/s", "m/s^2", "g", "mg"}, frame.sample_period_s, values.last<3>());
  if (file.has("mux.offset")) variant.multiplexer = read_field(file, "mux", "u8");
  if (file.has("temperature.offset")) variant.temperature = read_temperature(file, variant.multiplexer.has_value());
  if (file.has("counter.offset")) variant.counter = read_counter(file);
  for (const std::string prefix : {"status", "status2", "status3"}) {
    if (!file.has(prefix + ".offset")) continue;
    FrameStatus status;
    // The status mask is not the field's own mask, since it may have holes.
    status.mask = read_bits(file, prefix + ".bits", all_bits);
    status.good = read_bits(file, prefix + ".good", 0);
    for (const FrameField& field : read_fields(file, prefix, "u8", 0)) {
      status.field = field;
      variant.status.push_back(status);
    }
  }
  return variant;
}

ByteStuffing read_stuffing(KeyValueFile& file, const FrameDescription& frame) {
  ByteStuffing stuffing;
  chosen(file, "stuffing", stuffing.kind, {"none", "escape", "slip", "repeat", "cobs"});
  const auto read_byte = [&](const std::string& key, std::byte& byte) {
    const std::vector<std::byte> given = read_bytes(file, key);
    if (given.size() == 1)
      byte = given[0];
    else if (file.has(key))
      file.reject(key, "one byte of two hexadecimal digits");
  };
  const bool escape = stuffing.kind == StuffingKind::escape, repeat = stuffing.kind == StuffingKind::repeat;
  if (escape || repeat) read_byte("stuffing.byte", stuffing.byte);
  if (escape) read_byte("stuffing.xor", stuffing.flip);
  const auto begins = [&](const std::vector<std::byte>& mark) { return mark.empty() || mark[0] == stuffing.byte; };
  if (repeat && !frame.sync.empty() && !(begins(frame.sync) && begins(frame.tail)))
    file.reject("stuffing", "a sync, and a tail if there is one, that begin with stuffing.byte");
  if (stuffing.kind == StuffingKind::cobs && !(frame.sync == std::vector{std::byte{0}} && frame.tail.empty()))
    file.reject("stuffing", "sync = 00 and no tail: a frame begins behind the 00 that ended the one before");
  return stuffing;
}

void read_crc(KeyValueFile& file, CrcParameters& crc) {
  int width = int(file.integer("crc.width", 8, 32));
  if (width % 8 != 0) file.reject("crc.width", "8, 16, 24 or 32");
  width = std::clamp(width / 8 * 8, 8, 32);
  const std::uint64_t most = (std::uint64_t{1} << width) - 1;
  const auto within = [&](const char* key, std::optional<std::uint64_t> otherwise) {
    const std::uint64_t value = read_bits(file, key, otherwise);
    if (value > most) file.reject(key, fmt::format("at most {} bits", width));
    return std::uint32_t(value & most);
  };
  crc.width = width;
  crc.polynomial = within("crc.polynomial", std::nullopt);
  if (crc.polynomial % 2 == 0) file.reject("crc.polynomial", "an odd number: the term 1 is in every polynomial");
  crc.initial = within("crc.initial", 0);
  crc.final_xor = within("crc.final_xor", 0);
  crc.reflect_input = file.boolean_or("crc.reflect_input", false);
  crc.reflect_output = file.boolean_or("crc.reflect_output", false);
}

FrameCheck read_check(KeyValueFile& file) {
  FrameCheck check;
  const std::string name =
      file.one_of("check", {"none", "sum8", "sum16", "sum32", "xor8", "xor16", "crc", "fletcher16", "fletcher32"});
  constexpr std::pair<std::string_view, CheckKind> kinds[] = {{"sum", CheckKind::sum},
                                                              {"xor", CheckKind::exclusive_or},
                                                              {"crc", CheckKind::crc},
                                                              {"fletcher", CheckKind::fletcher}};
  for (const auto& [beginning, kind] : kinds)
    if (name.starts_with(beginning)) check.kind = kind;
  if (check.kind == CheckKind::none) return check;
  if (check.kind == CheckKind::crc) read_crc(file, check.crc);
  const std::size_t digits = std::min(name.find_first_of("0123456789"), name.size());
  FieldForm form;
  form.bytes = parse_integer<int>(std::string_view(name).substr(digits)).value_or(check.crc.width) / 8;
  check.of_words = name == "xor16" || name == "fletcher32";
  chosen(file, file.has("check.order") ? "check.order" : "order", form.big_endian, {"little", "big"});
  if (check.kind == CheckKind::fletcher) {
    const std::int64_t most = check.of_words ? 65536 : 256;
    const std::int64_t modulus = file.integer_or("check.modulus", most - 1, most - 1, most);
    check.modulus = std::uint32_t(std::clamp(modulus, most - 1, most));
  } else if (check.kind != CheckKind::crc) {
    if (check.kind == CheckKind::sum && form.bytes > 1) chosen(file, "check.of", check.of_words, {"bytes", "words"});
    if (check.kind == CheckKind::sum) chosen(file, "check.carry", check.end_around, {"dropped", "end_around"});
    chosen(file, "check.complement", check.complement, {"none", "ones", "twos"});
  }
  check.words_big_endian = form.big_endian;
  if (check.of_words) chosen(file, "check.word_order", check.words_big_endian, {"little", "big"});
  constexpr auto far = std::int64_t(longest_frame);
  const std::int64_t offset = file.integer("check.offset", -far, far);
  check.from_end = offset < 0;
  check.field = FrameField(std::size_t(std::abs(offset)), form);
  check.start = std::size_t(file.integer_or("check.start", 0, 0, far));
  check.gap = std::size_t(file.integer_or("check.gap", 0, 0, far));
  check.pad = std::size_t(file.integer_or("check.pad", 1, 1, 64));
  return check;
}

// ---- checks of a description beyond those of each key ----

// The sensor triads that a variant has.
struct Triad {
  const char* name;
  std::span<const FrameValue, 3> values;
};
std::vector<Triad> triads_of(const FrameVariant& variant) {
  const std::span<const FrameValue, 6> values = variant.values;
  std::vector<Triad> triads;
  if (variant.has_gyro) triads.push_back({"gyro", values.first<3>()});
  if (variant.has_accel) triads.push_back({"accel", values.last<3>()});
  return triads;
}

// The bits of a frame that a key occupies, and the offset of their end.
struct Taken {
  std::string key;
  std::size_t end;
  std::vector<std::byte> bits = std::vector<std::byte>(longest_frame + sizeof(std::uint64_t));
};

Taken taken_by(std::string key, const FrameField& field, std::uint64_t used = all_bits) {
  Taken taken{std::move(key), field.end()};
  field.put_bits(taken.bits.data(), used);
  return taken;
}

Taken taken_by(std::string key, std::size_t offset, const std::vector<std::byte>& mask) {
  Taken taken{std::move(key), offset + mask.size()};
  std::ranges::copy(mask, taken.bits.begin() + std::ptrdiff_t(offset));
  return taken;
}

// The fields that make a sample, and the other parts of the frame.
struct TakenBits {
  std::vector<Taken> data, beside;
};

TakenBits taken_in(const FrameDescription& frame, const FrameVariant& variant) {
  TakenBits taken;
  for (const Triad& triad : triads_of(variant)) {
    const std::string name = triad.name;
    for (const FrameValue& value : triad.values) taken.data.push_back(taken_by(name + ".offset", value.field));
    for (const FrameValue& value : triad.values)
      if (value.down) taken.data.push_back(taken_by(name + ".down", *value.down));
  }
  if (variant.temperature)
    for (const FrameField& field : variant.temperature->places)
      taken.data.push_back(taken_by("temperature.offset", field));
  if (variant.counter) taken.data.push_back(taken_by("counter.offset", variant.counter->field));
  taken.beside.push_back(taken_by("sync", 0, frame.sync_mask));
  if (frame.length) taken.beside.push_back(taken_by("length.offset", *frame.length));
  if (frame.id) taken.beside.push_back(taken_by("id.offset", *frame.id));
  for (const FrameStatus& status : variant.status)
    taken.beside.push_back(taken_by("status.offset", status.field, status.mask));
  if (variant.multiplexer) taken.beside.push_back(taken_by("mux.offset", *variant.multiplexer));
  return taken;
}

// Checks that everything lies inside its frame without contradictions.
void check_places(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  const TakenBits places = taken_in(frame, variant);
  for (const auto* const some : {&places.data, &places.beside})
    for (const Taken& place : *some)
      if (place.end > variant.length && place.key != "sync")
        file.reject(place.key, fmt::format("a place inside the frame of {} bytes", variant.length));
  if (frame.sync.size() + frame.tail.size() > variant.length) file.reject("length", "room for sync and tail");
  const FrameCheck& check = frame.check;
  if (check.kind != CheckKind::none) {
    const std::size_t place = check_offset(check, variant.length);
    if (place + std::size_t(check.bytes()) + frame.tail.size() > variant.length || check.start + check.gap >= place)
      file.reject("check.offset", "a place inside the frame, after what the check covers and before the tail");
    else if (check.of_words && check.pad % 2 != 0 && (place - check.gap - check.start) % 2 != 0)
      file.reject("check.offset", "a whole number of 16-bit words covered, or check.pad = 2");
  }
  const FrameVariant& first = frame.variants.front();
  if (!frame.split &&
      (variant.values[0].pulses != first.values[0].pulses || variant.values[3].pulses != first.values[3].pulses))
    file.reject("variants", "variants of the same increments: pulses or not");
  if (variant.counter.has_value() != first.counter.has_value()) file.reject("variants", "all with a counter or none");
  if (variant.counter &&
      (variant.counter->modulus != first.counter->modulus || variant.counter->step != first.counter->step))
    file.reject("variants", "variants that count alike");
  for (const FrameVariant& other : frame.variants)
    if (&other != &variant && other.id == variant.id) file.reject("variants", "a different id for each variant");
}

// REQUIRES: every place is inside the frame.
void check_overlaps(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  const auto whole = [](std::size_t bytes) { return std::vector<std::byte>(bytes, std::byte{0xFF}); };
  auto [data, beside] = taken_in(frame, variant);
  if (!frame.tail.empty())
    beside.insert(beside.begin() + 1, taken_by("tail", variant.length - frame.tail.size(), whole(frame.tail.size())));

  const auto check_apart = [&](const Taken& one, const Taken& other) {
    for (std::size_t i = 0; i < one.bits.size(); ++i)
      if ((one.bits[i] & other.bits[i]) != std::byte{0})
        return file.reject(one.key, "a place of its own, not that of " + file.name_of(other.key));
  };
  for (std::size_t i = 0; i < data.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) check_apart(data[i], data[j]);
    // The multiplexer may be the low bits of the counter.
    for (const Taken& other : beside)
      if (!(data[i].key == "counter.offset" && other.key == "mux.offset")) check_apart(data[i], other);
  }
  // The id may be part of the sync.
  for (std::size_t i = 1; i < beside.size(); ++i)
    if (beside[i].key != "id.offset") check_apart(beside[i], beside[0]);
  if (frame.check.kind == CheckKind::none) return;
  const Taken check =
      taken_by("check.offset", check_offset(frame.check, variant.length), whole(std::size_t(frame.check.bytes())));
  for (const std::vector<Taken>* const all : {&data, &beside})
    for (const Taken& other : *all) check_apart(check, other);
}

// Checks that every expected value fits its field.
void check_values(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  const auto check_fits = [&](const char* key, std::uint64_t value, const FrameField& field) {
    if (value > field.largest_bits())
      file.reject(key, fmt::format("at most {}, which its field can hold", field.largest_bits()));
  };
  if (frame.id) check_fits("id.value", variant.id, *frame.id);
  if (variant.temperature && variant.temperature->when && variant.multiplexer)
    check_fits("temperature.when", *variant.temperature->when, *variant.multiplexer);
  for (const FrameStatus& status : variant.status) {
    const std::uint64_t judged = status.mask & status.field.largest_bits();
    if (judged == 0) file.reject("status.bits", "at least one bit of the field");
    if ((status.good & ~judged) != 0) file.reject("status.good", "a number of status.bits alone");
  }
  if (!frame.length) return;
  const std::int64_t said = std::int64_t(variant.length) - frame.length_add;
  if (said < 0 || said % frame.length_scale != 0 ||
      std::uint64_t(said / frame.length_scale) > frame.length->largest_bits())
    file.reject("length", "a length that the field at length.offset can say: field x length.scale + length.add");
}

constexpr int least_bits = 4;  // the fewest bits that can represent motion

// Returns the largest raw magnitude; none for floating fields.
std::optional<double> full_scale(const FrameValue& value) {
  const int bits = value.field.bits();
  double low = 0.0, high = std::ldexp(1.0, bits) - 1.0;
  if (value.field.type() == NumberType::floating) return {};
  if (value.field.type() != NumberType::unsigned_integer) low = -(high = std::ldexp(1.0, bits - 1));
  if (value.cumulative || value.down) {
    const double turn = value.modulus != 0 ? double(value.modulus) : std::ldexp(1.0, bits);
    low = -(high = 0.5 * turn);
  }
  return std::max(std::abs(low - value.zero), std::abs(high - value.zero));
}

// A plausible scale: the field must cover `reaches`, and one count must be less than `count` (rad/s or m/s^2).
struct Sensible {
  double reaches, count;
  const char *said_reaches, *said_count;
};
constexpr Sensible gyro_rate = {rad_per_deg, 1000.0 * pi / 180.0, "1 deg/s", "1000 deg/s"};
constexpr Sensible accel_force = {9.0, 1000.0, "gravity", "1000 m/s^2"};

// `weight`: SI value of one increment.
void check_scale(KeyValueFile& file, const std::string& key, const Triad& triad, double weight, double period_s,
                 const Sensible& sensible) {
  for (const FrameValue& value : triad.values) {
    const std::optional<double> most = full_scale(value);
    const double count = std::abs(value.factor) * weight / period_s;
    if (!most) continue;
    if (count > sensible.count)
      file.reject(key, fmt::format("a scale with which a count is less than {}", sensible.said_count));
    if (*most * count < sensible.reaches)
      file.reject(key, fmt::format("a scale with which the field reaches {}", sensible.said_reaches));
  }
}

// Rejects what no unit's frames can have.
void check_variant(KeyValueFile& file, const FrameDescription& frame, const FrameVariant& variant) {
  file.set_scope(variant.name);
  check_places(file, frame, variant);
  if (!file.status()) return;
  check_overlaps(file, frame, variant);
  check_values(file, frame, variant);
  for (const Triad& triad : triads_of(variant))
    if (triad.values[0].field.bits() < least_bits)
      file.reject(std::string(triad.name) + ".mask", fmt::format("a mask that leaves {} bits or more", least_bits));
  for (const Triad& triad : triads_of(variant)) {
    const std::string name = triad.name;
    const bool is_gyro = name == "gyro", pulses = triad.values[0].pulses;
    if (is_gyro && pulses) continue;
    const char* const key = pulses ? ".pulse_mps" : file.has(name + ".scale") ? ".scale" : ".unit";
    check_scale(file, name + key, triad, pulses ? frame.accel_pulse_mps : 1.0, frame.sample_period_s,
                is_gyro ? gyro_rate : accel_force);
  }
}

// ---- the whole description ----

void read_request(KeyValueFile& file, FrameDescription& frame) {
  frame.request = read_bytes(file, "request");
  if (frame.request.empty()) file.reject("request", "at least one byte");
  frame.request_period_s = file.number_or("request.period_s", 0.5 * frame.sample_period_s, sample_period_range);
  if (frame.request_period_s > 0.9 * frame.sample_period_s)
    file.reject("request.period_s", "at most 0.9 sample_period_s: unit and station have a clock each");
  if (!frame.variants.front().counter)
    file.reject("request", "a counter beside it: only it tells a new sample from one sent twice");
}

Result<FrameDescription> frame_from(KeyValueFile& file) {
  FrameDescription frame;
  frame.file = file.file_name();
  frame.lines = read_line_sources(file);
  file.integer("format", 1, 1);
  frame.name = file.text_or("name", frame.file);
  frame.sync = read_bytes(file, "sync");
  if (frame.sync.empty()) file.reject("sync", "at least one byte");
  frame.sync_mask = read_bytes(file, "sync.mask");
  if (!file.has("sync.mask")) frame.sync_mask.assign(frame.sync.size(), std::byte{0xFF});
  if (frame.sync_mask.size() != frame.sync.size()) file.reject("sync.mask", "as many bytes as sync");
  if (std::ranges::all_of(frame.sync_mask, [](std::byte b) { return b == std::byte{0}; }))
    file.reject("sync.mask", "at least one bit: without any every byte begins a frame");
  frame.tail = read_bytes(file, "tail");
  if (file.has("id.offset")) frame.id = read_field(file, "id", "u8");
  if (file.has("length.offset")) {
    frame.length = read_field(file, "length", "u8");
    frame.length_scale = file.integer_or("length.scale", 1, 1, 64);
    frame.length_add = file.integer_or("length.add", 0, -1024, 1024);
  }
  frame.sample_period_s = file.number("sample_period_s", sample_period_range);
  frame.stuffing = read_stuffing(file, frame);
  frame.check = read_check(file);
  KeyTable table(file);
  read_serial_keys(table, "line", frame.line);
  if (frame.line.data_bits != 8) file.reject("line.data_bits", "8: a frame is of whole bytes");
  for (const std::string& name : file.list_or("variants", {""})) {
    file.set_scope(name);
    frame.variants.push_back(read_variant(file, name, frame));
    if (frame.variants.size() > 16) file.reject("variants", "at most 16");
    if (!file.status()) break;
  }
  file.set_scope("");
  const std::vector<FrameVariant>& all = frame.variants;
  if (all.empty()) return file.error_at("variants", "names separated by commas");  // rejected above as an empty list
  frame.split = std::ranges::any_of(all, [](const FrameVariant& v) { return !(v.has_gyro && v.has_accel); });
  if (frame.split) {
    if (!(all.size() == 2 && !all[0].has_accel && !all[1].has_gyro)) {
      file.reject("variants", "two: the first carries = gyro, the second carries = accel");
      return file.status().error();
    }
    if (!all[0].counter) file.reject("variants", "a counter in both: it tells which two frames are one sample");
  }
  if (frame.accel().pulses)
    frame.accel_pulse_mps = file.number("accel.pulse_mps", positive);
  else if (file.has("accel.pulse_mps"))
    file.reject("accel.pulse_mps", "no such key unless accel.unit = pulses");
  if (file.has("request")) read_request(file, frame);
  if (all.size() > 1 && !frame.id) file.reject("variants", "a key id.offset beside it");
  TRY(file.check_all_used());
  for (const FrameVariant& variant : all) {
    check_variant(file, frame, variant);
    frame.longest = std::max(frame.longest, variant.length);
  }
  if (frame.length) frame.longest = longest_frame;
  TRY(file.status());
  return frame;
}

}  // namespace

bool FrameDescription::has_temperature() const {
  return std::ranges::any_of(variants, [](const FrameVariant& v) { return v.temperature.has_value(); });
}

void FrameDescription::describe(RecordingInfo& info) const {
  info.sample_period_s = sample_period_s;
  info.gyro_increment = gyro().pulses ? IncrementKind::pulses : IncrementKind::physical;
  info.accel_increment = accel().pulses ? IncrementKind::pulses : IncrementKind::physical;
  info.accel_pulse_mps = accel_pulse_mps;
  info.has_temperature = has_temperature();
}

Result<FrameDescription> read_frame_description(const std::string& path) {
  TRY(expect_file(path, FileKind::frame));
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return frame_from(file);
}

Result<FrameDescription> parse_frame_description(std::string_view text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return frame_from(file);
}

}  // namespace turncal
