#include "imu_io/frames/frame_description.h"

#include "frame_streams.h"
#include "imu_io/frames/frame_field.h"
#include "tests/test.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

TEST(FrameDescription, EveryShippedOneIsReadAndKnownByName) {
  const auto names = builtin_frame_names();
  const std::vector<std::string_view> expected = {"f32_bddb0a",       "f64_55aa34",  "kvh1750", "laser_gyro",
                                                  "novatel_rawimusx", "pulses_9966", "stim300"};
  EXPECT_EQ(names, expected);
  for (const std::string_view name : names) {
    const auto frame = good(find_frame(std::string(name)));
    EXPECT_EQ(frame->name, name);
    // As the file says, so is what is compiled in.
    const std::string file = std::string(TURNCAL_SOURCE_DIR) + "/imu_io/frames/" + std::string(name) + ".frame";
    EXPECT_EQ(builtin_frame_text(name), file_text(file));
    ASSERT_OK(find_frame(file));
    // 10 bits a byte: the line carries the frames, with a tenth to spare.
    const double bits = 10.0 * double(frame->variants[0].length) / frame->sample_period_s;
    EXPECT_LT(bits * 1.1, frame->line.baud) << name;
  }
}

TEST(FrameDescription, UnitsOfRecordings) {
  RecordingInfo info;
  info.unit_serial = "kept";
  frame_named("stim300").describe(info);
  EXPECT_EQ(info.sample_period_s, 0.002);
  EXPECT_EQ(info.gyro_increment, IncrementKind::physical);
  EXPECT_EQ(info.accel_increment, IncrementKind::physical);
  EXPECT_FALSE(info.has_temperature);
  EXPECT_EQ(info.unit_serial, "kept");
  frame_named("pulses_9966").describe(info);
  EXPECT_EQ(info.gyro_increment, IncrementKind::pulses);
  EXPECT_EQ(info.accel_pulse_mps, 0.0005);
  EXPECT_TRUE(info.has_temperature);
}

// What is changed in laser_gyro.frame, and the whole line that comes of it. Lines that are added stand at the end.
struct BadDescription {
  std::string from;
  std::string to;
  std::string message;  // after "x.frame:LINE: "
};

TEST(FrameDescription, OneLineForEachMistake) {
  const BadDescription cases[] = {
      {"format = 1", "format = 2", "key 'format' = '2': expected a whole number between 1 and 1"},
      {"sync = EB 90", "sync = EB 9",
       "key 'sync' = 'EB 9': expected at most 16 bytes of two hexadecimal digits, with blanks between"},
      {"sync = EB 90", "sync =", "key 'sync' = '': expected at least one byte"},
      {"sync = EB 90", "aync = EB 90", "key 'aync' is unknown; did you mean 'sync'?"},
      {"sync = EB 90", "sync = EB 90\nsync.mask = FF", "key 'sync.mask' = 'FF': expected as many bytes as sync"},
      {"length = 36", "length = 35",
       "key 'check.offset' = '34': expected a place inside the frame, after what the check covers and before the tail"},
      {"length = 36", "length = 2000", "key 'length' = '2000': expected a whole number between 2 and 1024"},
      {"sample_period_s = 0.005", "sample_period_s = 0",
       "key 'sample_period_s' = '0': expected a number between 1e-05 and 10"},
      {"gyro.offset = 6", "gyro.offset = 30",
       "key 'gyro.offset' = '30': expected a place inside the frame of 36 bytes"},
      {"gyro.offset = 6", "gyro.offset = 6, 10", "key 'gyro.offset' = '6, 10': expected 1 or 3 whole byte offsets"},
      {"gyro.offset = 6", "gyro.offset = 6.5", "key 'gyro.offset' = '6.5': expected 1 or 3 whole byte offsets"},
      {"gyro.type = i32", "gyro.type = int",
       "key 'gyro.type' = 'int': expected u8, i8, u16, i16, u24, i24, u32, i32, u64, i64, f32, f64, sm8, sm16, sm24 or "
       "sm32"},
      {"gyro.unit = pulses", "gyro.unit = degrees",
       "key 'gyro.unit' = 'degrees': expected one of pulses, rad, deg, arcsec, rad/s, deg/s, deg/h"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.scale = 2",
       "key 'gyro.scale' = '2': expected no such key with unit = pulses: they are counted as they come"},
      {"gyro.unit = pulses", "gyro.unit = rad\ngyro.scale = 0",
       "key 'gyro.scale' = '0': expected numbers other than 0"},
      {"gyro.unit = pulses", "gyro.unit = deg/s\ngyro.kind = cumulative",
       "key 'gyro.kind' = 'cumulative': expected 'each' unless the field is a whole number of increments"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.kind = cumulative\ngyro.modulus = 4294967297",
       "key 'gyro.modulus' = '4294967297': expected 2 to 2^32"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.axes = +x, +x, -z",
       "key 'gyro.axes' = '+x, +x, -z': expected three axes such as '+x, -z, +y', each letter once"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 0",
       "key 'gyro.mask' = '0': expected a mask that leaves something of the field"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 0xF0F",
       "key 'gyro.mask' = '0xF0F': expected a mask of neighbouring bits"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 0xG",
       "key 'gyro.mask' = '0xG': expected a whole number, 0x before hexadecimal, at most 64 bits"},
      {"accel.unit = pulses", "accel.unit = m/s",
       "key 'accel.pulse_mps' = '0.0005': expected no such key unless accel.unit = pulses"},
      {"accel.pulse_mps = 0.0005", "accel.pulse_mps = -1", "key 'accel.pulse_mps' = '-1': expected a number > 0"},
      {"counter.type = u32", "counter.type = f64\ncounter.step = 1e-308",
       "key 'counter.step' = '1e-308': expected a number between 1e-09 and 1000000000000"},
      {"counter.type = u32", "counter.type = i32", "key 'counter.type' = 'i32': expected an unsigned or floating type"},
      {"counter.type = u32", "counter.type = u64",
       "key 'counter.type' = 'u64': expected a counter of at most 53 bits: a mask can leave the upper ones out"},
      {"counter.type = u32", "counter.type = u8\ncounter.step = 100",
       "key 'counter.step' = '100': expected a step that divides the modulus into 4 samples or more"},
      {"check = crc", "check = crc32",
       "key 'check' = 'crc32': expected none, sum8, sum16, sum32, xor8, xor16, crc, fletcher16 or fletcher32"},
      {"crc.width = 16", "crc.width = 12", "key 'crc.width' = '12': expected 8, 16, 24 or 32"},
      {"crc.width = 16", "crc.width = 8", "key 'crc.polynomial' = '0x1021': expected at most 8 bits"},
      {"line.baud = 115200", "line.baud = 7", "key 'line.baud' = '7': expected a whole number between 50 and 20000000"},
      {"line.baud = 115200", "line.speed = 7", "key 'line.speed' is unknown"},
      {"line.baud = 115200", "temperature.when = 1",
       "key 'temperature.when' = '1': expected a key mux.offset beside it"},
      {"sync = EB 90", "sync = EB 90\nsync.mask = 00 00",
       "key 'sync.mask' = '00 00': expected at least one bit: without any every byte begins a frame"},
      {"accel.offset = 18", "accel.offset = 16",
       "key 'accel.offset' = '16': expected a place of its own, not that of gyro.offset"},
      {"gyro.offset = 6", "gyro.offset = 6, 8, 14",
       "key 'gyro.offset' = '6, 8, 14': expected a place of its own, not that of gyro.offset"},
      {"gyro.offset = 6", "gyro.offset = 6\ngyro.down = 6",
       "key 'gyro.down' = '6': expected a place of its own, not that of gyro.offset"},
      {"counter.offset = 2", "counter.offset = 1",
       "key 'counter.offset' = '1': expected a place of its own, not that of sync"},
      {"temperature.offset = 30", "temperature.offset = 31",
       "key 'temperature.offset' = '31': expected a place of its own, not that of status.offset"},
      {"status.offset = 32", "status.offset = 34",
       "key 'check.offset' = '34': expected a place of its own, not that of status.offset"},
      {"check.offset = 34", "check.offset = 29",
       "key 'check.offset' = '29': expected a place of its own, not that of accel.offset"},
      {"status.offset = 32", "status.offset = 0",
       "key 'status.offset' = '0': expected a place of its own, not that of sync"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 7",
       "key 'gyro.mask' = '7': expected a mask that leaves 4 bits or more"},
      {"crc.polynomial = 0x1021", "crc.polynomial = 0x8408",
       "key 'crc.polynomial' = '0x8408': expected an odd number: the term 1 is in every polynomial"},
      {"temperature.scale = 0.01", "temperature.scale = 0",
       "key 'temperature.scale' = '0': expected a number other than 0"},
      {"status.bits = 0x0001", "status.bits = 0", "key 'status.bits' = '0': expected at least one bit of the field"},
      {"status.bits = 0x0001", "status.bits = 0x10000",
       "key 'status.bits' = '0x10000': expected at least one bit of the field"},
      {"status.good = 0", "status.good = 2", "key 'status.good' = '2': expected a number of status.bits alone"},
      {"line.baud = 115200", "id.offset = 33\nid.value = 300",
       "key 'id.value' = '300': expected at most 255, which its field can hold"},
      {"line.baud = 115200", "mux.offset = 33\ntemperature.when = 256",
       "key 'temperature.when' = '256': expected at most 255, which its field can hold"},
      {"line.baud = 115200", "length.offset = 33\nlength.scale = 16",
       "key 'length' = '36': expected a length that the field at length.offset can say: field x length.scale + "
       "length.add"},
      {"line.baud = 115200", "line.data_bits = 7", "key 'line.data_bits' = '7': expected 8: a frame is of whole bytes"},
      {"accel.pulse_mps = 0.0005", "accel.pulse_mps = 1e-12",
       "key 'accel.pulse_mps' = '1e-12': expected a scale with which the field reaches gravity"},
      {"accel.pulse_mps = 0.0005", "accel.pulse_mps = 1e300",
       "key 'accel.pulse_mps' = '1e300': expected a scale with which a count is less than 1000 m/s^2"},
      {"gyro.unit = pulses", "gyro.unit = deg/h\ngyro.scale = 1e-9",
       "key 'gyro.scale' = '1e-9': expected a scale with which the field reaches 1 deg/s"},
      {"gyro.unit = pulses", "gyro.unit = rad",
       "key 'gyro.unit' = 'rad': expected a scale with which a count is less than 1000 deg/s"},
      {"line.baud = 115200", "variants =", "key 'variants' = '': expected names separated by commas"},
      {"line.baud = 115200", "variants = a, b", "key 'variants' = 'a, b': expected a key id.offset beside it"},
      {"line.baud = 115200", "variants = a, b\nid.offset = 33\na.id.value = 1\nb.id.value = 1",
       "key 'variants' = 'a, b': expected a different id for each variant"},
  };
  for (const BadDescription& bad : cases) {
    const std::string text =
        replaced(unmarked(builtin_frame_text("laser_gyro")), "\n" + bad.from + "\n", "\n" + bad.to + "\n");
    const auto frame = parse_frame_description(text, "x.frame");
    ASSERT_TRUE(fails(frame, ErrorKind::input)) << bad.to;
    const std::string& message = frame.error().message;
    ASSERT_TRUE(message.starts_with("x.frame:")) << message;
    EXPECT_EQ(message.substr(message.find(' ') + 1), bad.message) << bad.to;
  }
}

TEST(FrameDescription, AMissingKeyIsNamed) {
  std::string text = unmarked(builtin_frame_text("laser_gyro"));
  text.erase(text.find("gyro.unit"), std::string("gyro.unit = pulses\n").size());
  EXPECT_ERROR(parse_frame_description(text, "x.frame"), "x.frame: key 'gyro.unit' is missing: expected a text");
}

TEST(FrameDescription, AnUnknownNameShowsTheKnownOnes) {
  EXPECT_ERROR(
      find_frame("stim"),
      "frame 'stim' is not known: expected one of f32_bddb0a, f64_55aa34, kvh1750, laser_gyro, novatel_rawimusx, "
      "pulses_9966, stim300, or a file (with '/' or '.frame' in its name)");
  EXPECT_FALSE(find_frame("./not-there.frame").ok());
}

// ---- frame forms ----

// Forms that units' frames take beside the shipped ones: sign and magnitude, up and down counters, sums of words, Fletcher, complements,
// stuffed bytes, gyros and accelerometers apart. Bytes made by hand or published, so that encoder and decoder cannot share a mistake.

using namespace test;  // NOLINT

Bytes text_bytes(const char* text) {
  Bytes bytes(std::strlen(text));
  std::memcpy(bytes.data(), text, bytes.size());
  return bytes;
}

// What comes out of a whole stream fed in pieces of this size.
std::vector<ImuSample> decoded(const FrameDescription& frame, const Bytes& stream, std::size_t piece) {
  Line line(frame);
  line.feed_pieces(stream, piece);
  return line.samples;
}

TEST(FrameForms, SignAndMagnitude) {
  FieldForm form;
  form.type = NumberType::sign_magnitude;
  form.bytes = 2;
  form.big_endian = true;
  const FrameField field(0, form);
  const std::pair<const char*, double> cases[] = {{"0005", 5.0},      {"8005", -5.0}, {"7FFF", 32767.0},
                                                  {"FFFF", -32767.0}, {"0000", 0.0},  {"8000", 0.0}};
  for (const auto& [hex, value] : cases) {
    EXPECT_EQ(field.number(from_hex(hex).data()), value) << hex;
    if (std::string_view(hex) == "8000") continue;  // minus nothing is not written
    Bytes bytes(2);
    ASSERT_TRUE(field.put_number(bytes.data(), value));
    EXPECT_EQ(bytes, from_hex(hex));
  }
  Bytes bytes(2);
  EXPECT_FALSE(field.put_number(bytes.data(), 32768.0));
  EXPECT_FALSE(field.put_number(bytes.data(), -32768.0));
}

// Up and down counters that run on, of 16 bits: what came is the difference of both steps.
TEST(FrameForms, CountersUpAndDown) {
  const std::vector<std::string> keys = {"gyro.type = u16", "gyro.down = 12", "gyro.kind = cumulative"};
  const FrameDescription frame = frame_with("laser_gyro", keys);
  const auto made = [&](std::uint32_t counter, std::array<std::uint16_t, 3> up, std::array<std::uint16_t, 3> down) {
    Bytes bytes = encode_all(frame_named("laser_gyro"), {ImuSample{}});
    const auto put = [&](std::size_t at, std::uint32_t value, std::size_t n) {
      for (std::size_t i = 0; i < n; ++i) bytes[at + i] = static_cast<std::byte>(value >> (8 * i) & 0xFFU);
    };
    put(2, counter, 4);
    for (std::size_t i = 0; i < 3; ++i) {
      put(6 + 2 * i, up[i], 2);
      put(12 + 2 * i, down[i], 2);
    }
    seal(frame, bytes);
    return bytes;
  };
  Line line(frame);
  line.feed(made(10, {100, 65530, 7}, {5, 0, 65535}));
  line.feed(made(11, {110, 4, 7}, {5, 3, 2}));
  ASSERT_EQ(line.samples.size(), 1U);
  EXPECT_EQ(line.samples[0].gyro, (std::array<double, 3>{10.0, 10.0 - 3.0, -3.0}));
  EXPECT_EQ(line.samples[0].counter, 11);
}

FrameCheck check_of(CheckKind kind, int bytes) {
  FrameCheck check;
  check.kind = kind;
  FieldForm form;
  form.bytes = bytes;
  check.from_end = true;
  check.field = FrameField(std::size_t(bytes), form);
  return check;
}

std::uint32_t value_over(FrameCheck check, Bytes covered) {
  const std::size_t n = covered.size();
  covered.resize(n + std::size_t(check.bytes()));
  return frame_check_value(check, Crc(check.crc), covered);
}

TEST(FrameForms, FletcherHasItsPublishedValues) {
  FrameCheck check = check_of(CheckKind::fletcher, 2);
  EXPECT_EQ(value_over(check, text_bytes("abcde")), 0xC8F0U);
  EXPECT_EQ(value_over(check, text_bytes("abcdef")), 0x2057U);
  EXPECT_EQ(value_over(check, text_bytes("abcdefgh")), 0x0627U);
  check.modulus = 256;  // B5 62 | 06 08 00 00 | 0E 30: a poll of a u-blox receiver
  EXPECT_EQ(value_over(check, from_hex("06080000")), 0x300EU);
  FrameCheck wide = check_of(CheckKind::fletcher, 4);
  wide.of_words = true;
  wide.modulus = 65535;
  EXPECT_EQ(value_over(wide, text_bytes("abcde")), 0xF04FC729U);
  EXPECT_EQ(value_over(wide, text_bytes("abcdef")), 0x56502D2AU);
  EXPECT_EQ(value_over(wide, text_bytes("abcdefgh")), 0xEBE19591U);
}

TEST(FrameForms, SumsOfWordsAndTheirComplements) {
  FrameCheck check = check_of(CheckKind::sum, 2);
  check.of_words = true;
  EXPECT_EQ(value_over(check, from_hex("0102FF00")), 0x0201U + 0x00FFU);
  check.words_big_endian = true;
  EXPECT_EQ(value_over(check, from_hex("0102FF00")), (0x0102U + 0xFF00U) & 0xFFFFU);
  check.complement = Complement::ones;
  EXPECT_EQ(value_over(check, from_hex("0102FF00")), 0xFFFFU - ((0x0102U + 0xFF00U) & 0xFFFFU));
  check.complement = Complement::twos;
  EXPECT_EQ((value_over(check, from_hex("0102FF00")) + 0x0102U + 0xFF00U) & 0xFFFFU, 0U);
  FrameCheck xored = check_of(CheckKind::exclusive_or, 2);
  xored.of_words = true;
  EXPECT_EQ(value_over(xored, from_hex("0102FF000400")), 0x0201U ^ 0x00FFU ^ 0x0004U);
  FrameCheck byte = check_of(CheckKind::sum, 1);
  byte.complement = Complement::twos;
  EXPECT_EQ(value_over(byte, from_hex("F00F01")), 0x00U);
  EXPECT_EQ(value_over(byte, from_hex("01")), 0xFFU);
}

TEST(FrameForms, SumsWithAnEndAroundCarry) {
  FrameCheck check = check_of(CheckKind::sum, 2);
  check.of_words = check.words_big_endian = check.end_around = true;
  EXPECT_EQ(value_over(check, from_hex("0001F203F4F5F6F7")), 0xDDF2U) << "RFC 1071";
  check.complement = Complement::ones;
  EXPECT_EQ(value_over(check, from_hex("0001F203F4F5F6F7")), 0x220DU);
  FrameCheck byte = check_of(CheckKind::sum, 1);
  EXPECT_EQ(value_over(byte, from_hex("FFFF02")), 0x00U);
  byte.end_around = true;
  EXPECT_EQ(value_over(byte, from_hex("FFFF02")), 0x02U) << "FF is nothing in ones' complement";
  byte.complement = Complement::ones;
  EXPECT_EQ(value_over(byte, from_hex("FFFF02")), 0xFDU);
}

struct Stuffed {
  std::string lines;
  const char* plain;  // sync, then contents
  const char* line;
  std::size_t sync;
};

TEST(FrameForms, StuffedAsTheStandardsSay) {
  const std::pair<ByteStuffing, Stuffed> cases[] = {
      {{StuffingKind::escape, std::byte{0x7D}, std::byte{0x20}}, {"", "7E017E7D02", "7E017D5E7D5D02", 1}},
      {{StuffingKind::slip, {}, {}}, {"", "C001C0DB02", "C001DBDCDBDD02", 1}},
      {{StuffingKind::repeat, std::byte{0x10}, {}}, {"", "1002011010021003", "1002011010101002101003", 2}},
      {{StuffingKind::cobs, {}, {}}, {"", "00000000", "0001010101", 1}},
      {{StuffingKind::cobs, {}, {}}, {"", "0011220033", "000311220233", 1}},
      {{StuffingKind::cobs, {}, {}}, {"", "0011000000", "000211010101", 1}}};
  for (const auto& [stuffing, example] : cases) {
    Bytes out;
    append_stuffed(stuffing, from_hex(example.plain), example.sync, 0, out);
    EXPECT_EQ(out, from_hex(example.line)) << example.line;
    for (std::size_t piece = 1; piece <= out.size(); ++piece) {
      Unstuffer unstuffer(stuffing);
      Bytes plain;
      for (std::size_t at = 0; at < out.size(); at += piece) {
        const std::size_t n = std::min(piece, out.size() - at);
        Bytes room(n + 1);
        std::copy_n(out.begin() + std::ptrdiff_t(at), n, room.begin() + 1);
        room.resize(unstuffer.unstuff(room.data(), n));
        plain.insert(plain.end(), room.begin(), room.end());
      }
      EXPECT_EQ(plain, from_hex(example.plain)) << "in pieces of " << piece;
    }
  }
}

// 253, 254 and 255 bytes that are no 00, and what follows them.
TEST(FrameForms, LongGroupsOfCobs) {
  for (const std::size_t length : {253U, 254U, 255U, 508U, 509U}) {
    for (const std::string after : {"", "00", "0001", "01"}) {
      Bytes plain(1 + length, std::byte{0x55});
      plain[0] = std::byte{0};
      const Bytes more = from_hex(after);
      plain.insert(plain.end(), more.begin(), more.end());
      Bytes line;
      append_stuffed({StuffingKind::cobs, {}, {}}, plain, 1, 0, line);
      EXPECT_EQ(std::ranges::count(line, std::byte{0}), 1) << length << " and " << after;
      EXPECT_LE(line.size(), plain.size() + (plain.size() + 253) / 254) << "the overhead has a limit";
      // Two frames, for the end of one is the sync of the next; a 00 too many in between says nothing.
      Bytes room(1);
      for (const Bytes& part : {line, Bytes{std::byte{0}}, line}) room.insert(room.end(), part.begin(), part.end());
      Unstuffer unstuffer({StuffingKind::cobs, {}, {}});
      room.resize(unstuffer.unstuff(room.data(), room.size() - 1));
      Bytes twice = plain;
      twice.insert(twice.end(), plain.begin(), plain.end());
      EXPECT_EQ(room, twice) << length << " and " << after;
    }
  }
}

TEST(FrameForms, StuffedStreamsLoseNothingButWhatIsHit) {
  for (const std::vector<std::string>& keys : {std::vector<std::string>{"stuffing = escape", "sync = 7E 90"},
                                               {"stuffing = slip", "sync = C0 01"},
                                               {"stuffing = repeat", "stuffing.byte = 10", "sync = 10 02"},
                                               {"stuffing = cobs", "sync = 00"}}) {
    const FrameDescription frame = frame_with("laser_gyro", keys);
    auto sent = pulse_samples(300);
    for (std::size_t i = 0; i < sent.size(); ++i)  // full of what has to be stuffed
      sent[i].gyro[i % 3] = double(std::int32_t(i % 2 == 0 ? 0x7E7D7E10 : 0x10C0DB10));
    const Bytes stream = on_the_line(frame, sent);
    EXPECT_GE(stream.size(), 37 * sent.size()) << keys[0];
    for (const std::size_t piece : {1U, 2U, 3U, 37U, 1000U, 100000U})
      EXPECT_EQ(expect_only_sent(decoded(frame, stream, piece), sent), 0U) << keys[0] << " in pieces of " << piece;
    for (std::size_t at = 2000; at < 2100; ++at) {
      Bytes shorter = stream;
      shorter.erase(shorter.begin() + std::ptrdiff_t(at));
      EXPECT_LE(expect_only_sent(decoded(frame, shorter, 100), sent), 2U) << keys[0] << ", byte " << at << " lost";
    }
  }
}

// Gyros in 20-byte frames of id 1, accelerometers in such of id 2; a counter in both.
constexpr const char* apart_text =
    "format = 1\nname = apart\nsync = A5 5A\nsample_period_s = 0.005\nid.offset = 2\nvariants = g, a\n"
    "length = 20\ncounter.offset = 3\ncounter.type = u8\ng.id.value = 1\ng.carries = gyro\na.id.value = 2\na.carries = "
    "accel\n"
    "g.gyro.offset = 4\ng.gyro.unit = pulses\na.accel.offset = 4\na.accel.unit = pulses\naccel.pulse_mps = 0.0005\n"
    "a.temperature.offset = 16\na.temperature.scale = 0.01\ncheck = sum16\ncheck.offset = -2\n";

TEST(FrameForms, GyrosAndAccelerometersApart) {
  const auto frame = good(parse_frame_description(apart_text, "x.frame"));
  RecordingInfo info;
  frame->describe(info);
  EXPECT_EQ(info.accel_pulse_mps, 0.0005);
  const auto sent = pulse_samples(400);
  const Bytes stream = on_the_line(*frame, sent);
  ASSERT_EQ(stream.size(), 40 * sent.size());
  Line line(*frame);
  line.feed_frames(*frame, sent);
  EXPECT_EQ(expect_only_sent(line.samples, sent), 0U);
  EXPECT_EQ(line.decoder.counters().lost_samples, 0U);

  // One of the two is missing, or comes twice: that sample is lost, and no other; halves of two samples are never put together.
  for (const std::size_t which : {20U, 21U}) {
    Line cut(*frame);
    for (std::size_t i = 0; 20 * i < stream.size(); ++i) {
      if (i % 2 == 0) cut.time_s += 0.005;
      if (i != which) cut.feed(std::span(stream).subspan(20 * i, 20));
    }
    EXPECT_EQ(expect_only_sent(cut.samples, sent), 1U);
    EXPECT_EQ(cut.decoder.counters().lost_samples, 1U);
    EXPECT_EQ(cut.decoder.counters().bad_frames, 1U);
  }
}

TEST(FrameForms, OneLineForEachMistakeInThem) {
  const auto refused = [](const std::string& text, const std::string& from, const std::string& to, const char* said) {
    EXPECT_TRUE(fails(parse_frame_description(replaced(text, from, to), "x.frame"), said)) << to;
  };
  const std::string own = unmarked(builtin_frame_text("laser_gyro"));
  refused(apart_text, "a.carries = accel", "a.carries = both\na.gyro.offset = 4\na.gyro.unit = pulses",
          "two: the first carries = gyro");
  refused(apart_text, "counter.offset = 3\ncounter.type = u8\n", "", "a counter in both");
  refused(own, "format = 1", "format = 1\nstuffing = bits", "none, escape, slip, repeat or cobs");
  refused(own, "format = 1", "format = 1\nstuffing = cobs", "sync = 00 and no tail");
  refused(apart_text, "check = sum16", "check = sum16\ncheck.carry = kept", "dropped or end_around");
  refused(own, "format = 1", "format = 1\ncheck.carry = end_around", "unknown");
  refused(own, "format = 1", "format = 1\nstuffing = repeat\nstuffing.byte = 10", "begin with stuffing.byte");
  refused(own, "format = 1", "format = 1\nstuffing = escape\nstuffing.byte = 7D 7D", "one byte");
  refused(own, "check = crc", "check = sum16\ncheck.of = words\ncheck.start = 1", "crc.width");
  refused(apart_text, "check = sum16", "check = sum16\ncheck.of = words\ncheck.start = 1",
          "whole number of 16-bit words");
  refused(apart_text, "check = sum16", "check = sum16\ncheck.complement = threes", "none, ones or twos");
  refused(apart_text, "check = sum16", "check = fletcher16\ncheck.modulus = 200", "between 255 and 256");
  refused(own, "gyro.unit = pulses", "gyro.unit = pulses\ngyro.down = 90", "a place inside the frame");
  refused(own, "gyro.type = i32", "gyro.type = sm32\ngyro.kind = cumulative", "'each' unless");
  refused(own, "gyro.type = i32", "gyro.type = sm32\ngyro.down = 18", "no such key unless the field is a counter");
  refused(own, "format = 1", "format = 1\nrequest =", "at least one byte");
  refused(own, "format = 1", "format = 1\nrequest = 05\nrequest.period_s = 0.005", "at most 0.9 sample_period_s");
  refused(own, "counter.offset = 2\ncounter.type = u32\n", "request = 05\n", "a counter beside it");
}

TEST(FrameForms, SignOf24BitsAndWrapOfCumulativeFields) {
  const FrameDescription frame =
      frame_with("laser_gyro", {"gyro.type = i24", "gyro.offset = 6, 9, 12", "gyro.kind = cumulative",
                                "accel.type = i24", "accel.offset = 18, 21, 24"});
  std::vector<ImuSample> sent = numbered(0, 200);
  for (std::size_t i = 0; i < sent.size(); ++i) {
    sent[i].gyro = {8388607.0, -8388607.0, double(i)};  // wraps every second frame, either way
    sent[i].accel = {8388607.0, -8388608.0, -1.0};
  }
  Line line(frame);
  line.feed_frames(frame, sent);
  // The first frame is only where the count begins.
  EXPECT_EQ(expect_only_sent(line.samples, sent), 1U);
  // After a gap the whole gap's pulses would be in one row: no sample, one more lost.
  line.time_s += 0.005;
  for (ImuSample& sample : sent) sample.counter += 201;
  line.feed_frames(frame, std::vector<ImuSample>(sent.begin(), sent.begin() + 3));
  ASSERT_EQ(line.samples.size(), 199U + 2U);
  EXPECT_EQ(line.samples[199].counter, 202);
  EXPECT_EQ(line.decoder.counters().lost_samples, 2U);
}

TEST(FrameForms, ACumulativeFieldMayWrapAtAModulusOfItsOwn) {
  const FrameDescription frame =
      frame_with("laser_gyro", {"gyro.type = u32", "gyro.kind = cumulative", "gyro.modulus = 1000000"});
  std::vector<ImuSample> sent = numbered(0, 50);
  for (ImuSample& sample : sent) sample.gyro = {400000.0, -400000.0, 1.0};
  Line line(frame);
  line.feed_frames(frame, sent);
  EXPECT_EQ(expect_only_sent(line.samples, sent), 1U);
}

}  // namespace
}  // namespace turncal
