#include "imu_io/frames/frame_description.h"

#include "frame_streams.h"
#include "imu_io/frames/frame_field.h"
#include "tests/said.h"

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

TEST(FrameForms, SignAndMagnitude) {
  FieldForm form{.type = NumberType::sign_magnitude, .bytes = 2, .big_endian = true};
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

// Published: Fletcher of "abcde" and so on; of a poll of a u-blox receiver; the sum of RFC 1071. The others by hand.
TEST(FrameForms, ChecksHaveTheirValues) {
  const auto of = [](CheckKind kind, int bytes, bool words, const std::function<void(FrameCheck&)>& more = {}) {
    FrameCheck check;
    FieldForm form;
    form.bytes = bytes;
    check.kind = kind;
    check.of_words = words;
    check.from_end = true;
    check.field = FrameField(std::size_t(bytes), form);
    if (more) more(check);
    return check;
  };
  constexpr auto sum = CheckKind::sum, fletcher = CheckKind::fletcher;
  const auto ones = [](FrameCheck& check) { check.complement = Complement::ones; };
  const auto twos = [](FrameCheck& check) { check.complement = Complement::twos; };
  const auto big = [](FrameCheck& check) { check.words_big_endian = true; };
  const auto around = [](FrameCheck& check) { check.end_around = true; };
  const auto both = [](const auto& a, const auto& b) { return [&a, &b](FrameCheck& check) { a(check), b(check); }; };
  const auto big_around = both(big, around);
  const auto wide = [](FrameCheck& check) { check.modulus = 65535; };
  const struct {
    FrameCheck check;
    const char* covered;
    std::uint32_t value;
  } cases[] = {{of(fletcher, 2, false), "6162636465", 0xC8F0},
               {of(fletcher, 2, false), "616263646566", 0x2057},
               {of(fletcher, 2, false), "6162636465666768", 0x0627},
               {of(fletcher, 2, false, [](FrameCheck& check) { check.modulus = 256; }), "06080000", 0x300E},
               {of(fletcher, 4, true, wide), "6162636465", 0xF04FC729},
               {of(fletcher, 4, true, wide), "616263646566", 0x56502D2A},
               {of(fletcher, 4, true, wide), "6162636465666768", 0xEBE19591},
               {of(sum, 2, true), "0102FF00", 0x0201 + 0x00FF},
               {of(sum, 2, true, big), "0102FF00", 0x0002},
               {of(sum, 2, true, both(big, ones)), "0102FF00", 0xFFFD},
               {of(sum, 2, true, both(big, twos)), "0102FF00", 0xFFFE},
               {of(CheckKind::exclusive_or, 2, true), "0102FF000400", 0x0201 ^ 0x00FF ^ 0x0004},
               {of(sum, 1, false, twos), "F00F01", 0x00},
               {of(sum, 1, false, twos), "01", 0xFF},
               {of(sum, 2, true, big_around), "0001F203F4F5F6F7", 0xDDF2},
               {of(sum, 2, true, both(big_around, ones)), "0001F203F4F5F6F7", 0x220D},
               {of(sum, 1, false), "FFFF02", 0x00},
               {of(sum, 1, false, around), "FFFF02", 0x02},  // FF is nothing in ones' complement
               {of(sum, 1, false, both(around, ones)), "FFFF02", 0xFD}};
  for (const auto& [check, covered, value] : cases) {
    Bytes bytes = from_hex(covered);
    bytes.resize(bytes.size() + std::size_t(check.bytes()));
    EXPECT_EQ(frame_check_value(check, Crc(check.crc), bytes), value) << covered;
  }
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

// Of a line that is changed in laser_gyro.frame, or in that of gyros and accelerometers apart.
TEST(FrameDescription, OneLineForEachMistake) {
  expect_said("imu_io/frames.said", [](const std::string& name, const std::string& what, const std::string& with) {
    const std::string text = name == "apart" ? apart_text : unmarked(builtin_frame_text(name));
    return said_of(parse_frame_description(replaced(text, what, with), "x.frame"));
  });
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
  const auto frame = frame_with("laser_gyro", {"gyro.type = u32", "gyro.kind = cumulative", "gyro.modulus = 1000000"});
  std::vector<ImuSample> sent = numbered(0, 50);
  for (ImuSample& sample : sent) sample.gyro = {400000.0, -400000.0, 1.0};
  Line line(frame);
  line.feed_frames(frame, sent);
  EXPECT_EQ(expect_only_sent(line.samples, sent), 1U);
}

}  // namespace
}  // namespace turncal
