// Check vectors of real units, and rapid random round trips through encoder and decoder.
#include "imu_io/frames/frame_decoder.h"

#include <rapidcheck.h>
#include "tests/test.h"

#include "tests/imu_io/frame_streams.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

constexpr const char* rawimusx =
    "AA441328B6059C0678B9E21C000B9C060B9755A832941D4103158000EBD09102A687F3FF38EAFCFF66B7FCFF1C5FFFFF59D9FFFF475FAFBA";

// Numbers of a frame in its own unit, to as many digits as are given.
struct Raw {
  std::array<double, 3> numbers;
  double unit, digits;
};
const ImuSample& expect_vector(Line& line, const char* hex, const Raw& gyro, const Raw& accel) {
  line.feed(from_hex(hex));
  EXPECT_EQ(line.samples.size(), 1U);
  static const ImuSample none;
  const ImuSample& sample = line.samples.empty() ? none : line.samples[0];
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(sample.gyro[i] / gyro.unit, gyro.numbers[i], gyro.digits) << i;
    EXPECT_NEAR(sample.accel[i] / accel.unit, accel.numbers[i], accel.digits) << i;
  }
  EXPECT_EQ(sample.flags, 0U);
  return sample;
}

// Published with the units.
TEST(FrameDecoder, ReadsTheVectorsOfRealUnits) {
  const double g = 9.80665;
  Line stim(frame_named("stim300")), kvh(frame_named("kvh1750")), novatel(frame_named("novatel_rawimusx"));
  const ImuSample& tactical =
      expect_vector(stim, "93FFFBDB00007CFFFCC4000005CE0001F6040E540000539DFFB2B7402D99004101FB6073E3DE0D0A",
                    {{-1061, 124, -828}, std::ldexp(M_PI / 180.0, -14) * 0.002, 1e-6},
                    {{1486, 502, 265812}, std::ldexp(g, -19) * 0.002, 1e-6});
  EXPECT_EQ(tactical.counter, 16);  // 65 / 4; status 0x40 and 0x00 at the inclinometer's place are not judged
  EXPECT_TRUE(std::isnan(tactical.temperature_c));
  const ImuSample& fibre = expect_vector(
      kvh, "FE81FF5537A96A6E38586C1FB75BF862BF803E78BB650D283B0A37AC773D00284BFA34D8",
      {{2.01959e-5, 5.15991e-5, -1.31112e-5}, 1.0, 5e-11}, {{-1.00190639, -0.00349505, 0.00210903}, 0.001 * g, 5e-9});
  EXPECT_EQ(fibre.counter, 61);
  EXPECT_EQ(fibre.temperature_c, 40.0F);
  // In the frame: az 43110635, -ay -817242, ax -202184; gz -215194, -gy -41188, gx -9895. 9.79 m/s^2 at 100 Hz.
  expect_vector(novatel, rawimusx, {{-9895, 41188, -215194}, std::ldexp(1.0, -33), 1e-6},
                {{-202184, 817242, 43110635}, std::ldexp(0.3048, -27), 1e-6});
}

// A laser-gyro frame put together here by hand from the description's table, so that encoder and decoder cannot agree on a mistake.
TEST(FrameDecoder, ReadsALaserGyroFrameMadeByHand) {
  // Counter 42; gyro 1, -1, -2147483648, which is beyond what a recording holds; accel 1000, -1000, 2147483647; 23.50 C; a status bit that
  // is not judged.
  const std::string hex = "EB902A00000001000000FFFFFFFF00000080E803000018FCFFFFFFFFFF7F2E0902000000";
  Bytes frame = from_hex(hex);
  const auto seal = [](Bytes& bytes) {
    unsigned crc = 0;  // CRC-16/XMODEM, bit by bit
    for (std::size_t i = 0; i < 34; ++i) {
      crc ^= std::to_integer<unsigned>(bytes[i]) << 8;
      for (int bit = 0; bit < 8; ++bit)
        crc = (crc & 0x8000U) != 0 ? (crc << 1 ^ 0x1021U) & 0xFFFFU : crc << 1 & 0xFFFFU;
    }
    bytes[34] = static_cast<std::byte>(crc & 0xFFU);
    bytes[35] = static_cast<std::byte>(crc >> 8);
  };
  seal(frame);
  Line refused(frame_named("laser_gyro"));
  refused.feed(frame);
  EXPECT_TRUE(refused.samples.empty());
  EXPECT_EQ(refused.decoder.counters().bad_frames, 1U);

  frame[14] = std::byte{1};  // -2147483647
  seal(frame);
  Line line(frame_named("laser_gyro"));
  line.feed(frame);
  ASSERT_EQ(line.samples.size(), 1U);
  const ImuSample& sample = line.samples[0];
  EXPECT_EQ(sample.counter, 42);
  EXPECT_EQ(sample.gyro, (std::array<double, 3>{1.0, -1.0, -2147483647.0}));
  EXPECT_EQ(sample.accel, (std::array<double, 3>{1000.0, -1000.0, 2147483647.0}));
  EXPECT_NEAR(sample.temperature_c, 23.5F, 1e-5F);
  EXPECT_EQ(sample.flags, 0U);
  frame[32] = std::byte{1};
  frame[2] = std::byte{43};
  seal(frame);
  line.time_s += 0.005;
  line.feed(frame);
  ASSERT_EQ(line.samples.size(), 2U);
  EXPECT_EQ(line.samples[1].flags, sample_flag_invalid);  // kept, and flagged
}

// A layout of laser_gyro's fields in any width, order, axes, form, check and stuffing.
std::vector<std::string> draw_layout() {
  const auto below = [](std::size_t end) {
    return *rc::gen::resize(rc::kNominalSize, rc::gen::inRange<std::size_t>(0, end));
  };
  const auto one_of = [&](std::initializer_list<std::string> choices) {
    return choices.begin()[below(choices.size())];
  };
  const std::string stuffing = one_of({"none", "escape", "slip", "repeat", "cobs"});
  const std::string kind = one_of({"each", "cumulative"});
  const bool down = below(3) == 0;
  std::vector<std::string> lines = {
      "length = 120",
      "sync = " + std::string(stuffing == "cobs"     ? "00"
                              : stuffing == "slip"   ? "C0 01"
                              : stuffing == "repeat" ? "10 02"
                                                     : "7E 90"),
      "stuffing = " + stuffing,
      "order = " + one_of({"little", "big"}),
      "word_order = " + one_of({"same", "swapped"}),
      "gyro.offset = 6",
      "gyro.type = " + (down ? one_of({"u16", "u24", "u32"}) : one_of({"i16", "i24", "i32", "i64"})),
      "gyro.axes = " + one_of({"+x, +y, +z", "-z, +x, -y", "+y, -x, +z"}),
      "gyro.kind = " + kind,
      "accel.offset = 74, 54, 64",
      "accel.type = " + one_of({"i32", "i64", "sm32"}),
      "status.offset = 82",
      "temperature.offset = 84",
      "counter.type = " + one_of({"u8", "u16", "u24", "u32"}),
      "check.offset = -6",
      "check.start = 2"};
  if (stuffing == "repeat") lines.push_back("stuffing.byte = 10");
  if (down) lines.push_back("gyro.down = 30");
  if (stuffing != "cobs" && stuffing != "repeat" && below(2) == 0) lines.push_back("tail = 0D");
  const std::string check =
      one_of({"none", "sum8", "sum16", "sum32", "xor8", "xor16", "crc", "fletcher16", "fletcher32"});
  lines.push_back("check = " + check);
  if (check.starts_with("sum") || check.starts_with("xor"))
    lines.push_back("check.complement = " + one_of({"none", "ones", "twos"}));
  if (check.starts_with("sum")) lines.push_back("check.carry = " + one_of({"dropped", "end_around"}));
  if (check == "sum16" || check == "sum32") lines.push_back("check.of = " + one_of({"bytes", "words"}));
  return lines;
}

// laser_gyro with these lines, and without those of its check that another one does not have.
FrameDescription laid_out(std::vector<std::string> lines) {
  const bool crc = std::ranges::find(lines, "check = crc") != lines.end();
  const bool none = std::ranges::find(lines, "check = none") != lines.end();
  std::string text = unmarked(builtin_frame_text("laser_gyro"));
  const auto erase = [&text](const std::string& key) {
    for (std::size_t at; (at = text.find("\n" + key)) != std::string::npos;)
      text.erase(at, text.find('\n', at + 1) - at);
  };
  for (const std::string& line : lines) erase(line.substr(0, line.find(' ') + 1));
  if (!crc) erase("crc.");
  if (none) erase("check.");
  for (const std::string& line : lines)
    if (!none || !line.starts_with("check.")) text += "\n" + line;
  const auto frame = parse_frame_description(text + "\n", "drawn");
  EXPECT_OK(frame) << text;
  return frame.ok() ? *frame : FrameDescription{};
}

// Whatever the layout: what was encoded comes back; a byte that changes costs its frame and no other, whatever the check.
TEST(FrameDecoder, GivesBackWhatWasEncodedInAnyLayout) {
  ::setenv("RC_PARAMS", "seed=20260101", 0);  // another seed may be given from outside
  EXPECT_TRUE(rc::check("what was encoded comes back", [] {
    const auto below = [](int end) { return *rc::gen::resize(rc::kNominalSize, rc::gen::inRange(0, end)); };
    const FrameDescription frame = laid_out(draw_layout());
    const FrameValue& gyro = frame.gyro();
    const int bits = std::min(gyro.field.bits(), 32) - 1;
    std::vector<ImuSample> sent = pulse_samples(60, unsigned(below(1000)));
    for (std::size_t i = 0; i < sent.size(); ++i) {
      for (double& g : sent[i].gyro) g = std::trunc(g / std::ldexp(1.0, 32 - bits));  // half the width, either sign
      sent[i].flags = i % 7 == 0 ? sample_flag_invalid : 0;
      if (i % 5 == 0) sent[i].accel[i % 3] = i % 2 == 0 ? 0x7E7D7E10 : 0x10C00D00;  // full of what has to be stuffed
    }
    Line line(frame);
    if (const auto piece = std::size_t(below(300)); piece == 0)
      line.feed_frames(frame, sent);
    else
      line.feed_pieces(on_the_line(frame, sent), piece);
    // A weak check waits for the next sync; a cumulative field needs a first frame to begin from.
    const std::size_t first = gyro.cumulative ? 1 : 0;
    const std::size_t held = frame.check.weak() || frame.stuffing.kind == StuffingKind::cobs ? 1 : 0;
    RC_ASSERT(line.samples.size() + first + held >= sent.size());
    RC_ASSERT(line.samples.size() + first <= sent.size());
    RC_ASSERT(expect_only_sent(line.samples, sent) <= first + held);
    RC_ASSERT(line.decoder.counters().bad_frames == 0U);

    if (frame.check.weak()) return;
    Bytes stream = on_the_line(frame, sent);
    const auto at = std::ptrdiff_t(stream.size()) / 2 + below(120);
    const bool stuffed = frame.stuffing.kind != StuffingKind::none;
    Line hit(frame);
    if (stuffed) {  // what is lost there may be a mark
      stream.erase(stream.begin() + at);
      hit.feed_pieces(stream, std::size_t(1 + below(300)));
    } else {
      stream[std::size_t(at)] ^= static_cast<std::byte>(1 + below(255));
      hit.feed_paced(stream, 120);
    }
    // Of a cumulative field the row after a gap would hold two periods.
    RC_ASSERT(expect_only_sent(hit.samples, sent) <= 2 * first + (stuffed ? 2U + held : 1U));
  }));
}

TEST(FrameDecoder, RoundingIsCarriedOnSoThatNoAngleIsLost) {
  const FrameDescription frame = frame_named("stim300");
  std::vector<ImuSample> sent = numbered(0, 5000);
  double turned = 0.0;
  for (ImuSample& sample : sent) {
    sample.gyro = {3.3e-9, -1e-6, 1e-4};
    sample.accel = {0.0, 1e-7, 9.8 * 0.002};
    turned += sample.gyro[0];
  }
  Line line(frame);
  line.feed_frames(frame, sent);
  ASSERT_EQ(line.samples.size(), sent.size());
  double got = 0.0;
  for (const ImuSample& sample : line.samples) got += sample.gyro[0];
  EXPECT_NEAR(got, turned, std::ldexp(M_PI / 180.0, -14) * 0.002);  // one raw number, not 5000 of them
}

TEST(FrameDecoder, AMultiplexedTemperatureIsHeld) {
  const FrameDescription frame =
      frame_with("laser_gyro", {"mux.offset = 32", "mux.mask = 0xF0", "temperature.when = 3", "status.bits = 0x0001"});
  std::vector<ImuSample> sent = pulse_samples(3);
  FrameEncoder encoder(frame);
  Line line(frame);
  for (std::size_t i = 0; i < 3; ++i) {
    Bytes bytes(encoder.length());
    sent[i].temperature_c = i == 1 ? 30.0F : 99.0F;
    ASSERT_TRUE(encoder.encode(sent[i], bytes).ok());
    bytes[32] = std::byte{static_cast<unsigned char>(i == 1 ? 0x30 : 0x20)};
    seal(frame, bytes);
    line.time_s += 0.005;
    line.feed(bytes);
  }
  ASSERT_EQ(line.samples.size(), 3U);
  EXPECT_TRUE(std::isnan(line.samples[0].temperature_c));
  EXPECT_NEAR(line.samples[1].temperature_c, 30.0F, 1e-4F);
  EXPECT_NEAR(line.samples[2].temperature_c, 30.0F, 1e-4F);
}

TEST(FrameDecoder, AnIdChoosesTheVariantAndOtherFramesArePassedOver) {
  // KVH-like units send more than one layout; here the accelerometers of id 2 stand elsewhere.
  std::string text(builtin_frame_text("laser_gyro"));
  text += "variants = a, b\nid.offset = 33\na.id.value = 1\nb.id.value = 2\nb.accel.offset = 6\nb.gyro.offset = 18\n";
  text.replace(text.find("status.type = u16"), 17, "status.type = u8 ");
  const auto frame = good(parse_frame_description(text, "two"));
  std::vector<ImuSample> sent = pulse_samples(2);
  FrameEncoder encoder(*frame);
  Line line(*frame);
  for (std::size_t i = 0; i < 2; ++i) {
    Bytes bytes(36);
    ASSERT_TRUE(encoder.encode(sent[i], bytes).ok());
    if (i == 1) {
      bytes[33] = std::byte{2};
      seal(*frame, bytes);
    }
    line.time_s += 0.005;
    line.feed(bytes);
  }
  ASSERT_EQ(line.samples.size(), 2U);
  EXPECT_EQ(line.samples[0].gyro, sent[0].gyro);
  EXPECT_EQ(line.samples[1].gyro, sent[1].accel);
  EXPECT_EQ(line.samples[1].accel, sent[1].gyro);

  // NovAtel: another log between two of ours.
  const FrameDescription novatel = frame_named("novatel_rawimusx");
  const Bytes vector = from_hex(rawimusx);
  Bytes other = vector;
  other.resize(12 + 8 + 4);
  other[3] = std::byte{8};
  other[4] = std::byte{0x11};
  seal(novatel, other);
  Line receiver(novatel);
  receiver.feed(other);
  receiver.feed(vector);
  receiver.feed(other);
  EXPECT_EQ(receiver.samples.size(), 1U);
  EXPECT_EQ(receiver.decoder.scan().other_frames, 2U);
  EXPECT_EQ(receiver.decoder.counters().bad_frames, 0U);
}

TEST(FrameEncoder, RefusesWhatDoesNotFit) {
  FrameEncoder encoder(frame_named("stim300"));
  ImuSample sample;
  sample.gyro[1] = 100.0;
  Bytes bytes(encoder.length());
  EXPECT_ERROR(encoder.encode(sample, bytes), "stim300: gyro y of 100 does not fit the frame's field");
}

// ---- frame log ----

std::string log_of(const FrameDescription& frame, const std::vector<ImuSample>& samples) {
  const Bytes bytes = on_the_line(frame, samples);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

TEST(FrameLog, SamplesGapsAndNoise) {
  TemporaryFolder folder;
  const FrameDescription frame = frame_named("laser_gyro");
  std::vector<ImuSample> samples = pulse_samples(3000);
  samples.erase(samples.begin() + 700, samples.begin() + 720);
  std::string bytes = "rubbish" + log_of(frame, samples);
  bytes.insert(7 + 36 * 1000, "more");
  bytes[7 + 36 * 2000 + 10] ^= 1;
  write_file(folder / "log.bin", bytes);
  const Result<FrameLog> log = good(read_frame_log(folder / "log.bin", frame));
  ASSERT_EQ(log->samples.size(), 2979u);
  EXPECT_EQ(log->samples[699].counter, 699);
  EXPECT_EQ(log->samples[700].counter, 720);
  EXPECT_EQ(log->samples[700].gyro, samples[700].gyro);
  EXPECT_SAYS(log->summary, "2979 frames of laser_gyro, ");
  EXPECT_SAYS(log->summary, "21 samples lost");
}

TEST(FrameLog, Defects) {
  TemporaryFolder folder;
  const FrameDescription frame = frame_named("laser_gyro");
  const std::string bytes = log_of(frame, pulse_samples(500, 1, 1000));
  write_file(folder / "twice.bin", bytes + bytes);
  EXPECT_TRUE(
      fails(read_frame_log(folder / "twice.bin", frame), "after 500 samples: the unit's counter started again"));
  EXPECT_TRUE(fails(read_frame_log(folder / "twice.bin", frame_named("stim300")),
                    "no sample in it by the frame description stim300"));
  write_file(folder / "empty.bin", "");
  EXPECT_TRUE(fails(read_frame_log(folder / "empty.bin", frame), "no sample in it"));
}

}  // namespace
}  // namespace turncal
