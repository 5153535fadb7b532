// Check vectors of real units, and rapid random round trips through encoder and decoder.
#include "imu_io/frames/frame_decoder.h"

#include <gtest/gtest.h>

#include <cmath>

#include "frame_streams.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

TEST(FrameDecoder, ReadsARealFrameOfStim300) {
  const FrameDescription frame = frame_named("stim300");
  Line line(frame);
  line.feed(from_hex("93FFFBDB00007CFFFCC4000005CE0001F6040E540000539DFFB2B7402D99004101FB6073E3DE0D0A"));
  ASSERT_EQ(line.samples.size(), 1U);
  const ImuSample& sample = line.samples[0];
  const double gyro = std::ldexp(M_PI / 180.0, -14) * 0.002;  // rad a sample for one raw
  const double accel = std::ldexp(9.80665, -19) * 0.002;
  EXPECT_DOUBLE_EQ(sample.gyro[0], -1061 * gyro);
  EXPECT_DOUBLE_EQ(sample.gyro[1], 124 * gyro);
  EXPECT_DOUBLE_EQ(sample.gyro[2], -828 * gyro);
  EXPECT_DOUBLE_EQ(sample.accel[0], 1486 * accel);
  EXPECT_DOUBLE_EQ(sample.accel[1], 502 * accel);
  EXPECT_DOUBLE_EQ(sample.accel[2], 265812 * accel);
  EXPECT_EQ(sample.counter, 16);  // 65 / 4
  // Status 0x40 and 0x00 at the inclinometer's place are not judged.
  EXPECT_EQ(sample.flags, 0U);
  EXPECT_TRUE(std::isnan(sample.temperature_c));
}

TEST(FrameDecoder, ReadsTheVectorOfKvh1750) {
  const FrameDescription frame = frame_named("kvh1750");
  Line line(frame);
  line.feed(from_hex("FE81FF5537A96A6E38586C1FB75BF862BF803E78BB650D283B0A37AC773D00284BFA34D8"));
  ASSERT_EQ(line.samples.size(), 1U);
  const ImuSample& sample = line.samples[0];
  EXPECT_NEAR(sample.gyro[0], 2.01959e-5, 5e-11);  // as many digits as are published
  EXPECT_NEAR(sample.gyro[1], 5.15991e-5, 5e-11);
  EXPECT_NEAR(sample.gyro[2], -1.31112e-5, 5e-11);
  EXPECT_NEAR(sample.accel[0] / (9.80665 * 0.001), -1.00190639, 5e-9);
  EXPECT_NEAR(sample.accel[1] / (9.80665 * 0.001), -0.00349505, 5e-9);
  EXPECT_NEAR(sample.accel[2] / (9.80665 * 0.001), 0.00210903, 5e-9);
  EXPECT_EQ(sample.counter, 61);
  EXPECT_EQ(sample.temperature_c, 40.0F);
  EXPECT_EQ(sample.flags, 0U);
}

TEST(FrameDecoder, ReadsTheVectorOfNovatelRawimusx) {
  const FrameDescription frame = frame_named("novatel_rawimusx");
  Line line(frame);
  line.feed(
      from_hex("AA441328B6059C0678B9E21C000B9C060B9755A832941D4103158000EBD09102A687F3FF38EAFCFF66B7FCFF1C5FFFFF59D9FFF"
               "F475FAFBA"));
  ASSERT_EQ(line.samples.size(), 1U);
  const ImuSample& sample = line.samples[0];
  const double gyro = std::ldexp(1.0, -33);
  const double accel = std::ldexp(0.3048, -27);
  // In the frame: az 43110635, -ay -817242, ax -202184; gz -215194, -gy -41188, gx -9895.
  EXPECT_DOUBLE_EQ(sample.accel[0], -202184 * accel);
  EXPECT_DOUBLE_EQ(sample.accel[1], 817242 * accel);
  EXPECT_DOUBLE_EQ(sample.accel[2], 43110635 * accel);
  EXPECT_DOUBLE_EQ(sample.gyro[0], -9895 * gyro);
  EXPECT_DOUBLE_EQ(sample.gyro[1], 41188 * gyro);
  EXPECT_DOUBLE_EQ(sample.gyro[2], -215194 * gyro);
  // 43110635 x 2^-27 ft/s x 100 Hz is 9.79 m/s^2.
  EXPECT_NEAR(sample.accel[2] * 100.0, 9.79, 0.005);
  EXPECT_EQ(sample.flags, 0U);
}

// A laser-gyro frame put together here by hand from the description's table, so that encoder and decoder cannot agree on a mistake.
TEST(FrameDecoder, ReadsALaserGyroFrameMadeByHand) {
  std::string hex =
      "EB90"
      "2A000000";  // counter 42
  hex +=
      "01000000"
      "FFFFFFFF"
      "00000080";  // gyro 1, -1, -2147483648: beyond what a recording holds
  hex +=
      "E8030000"
      "18FCFFFF"
      "FFFFFF7F";  // accel 1000, -1000, 2147483647
  hex +=
      "2E09"
      "0200";  // 23.50 C, a status bit that is not judged
  hex += "0000";
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

TEST(FrameDecoder, GivesBackWhatWasEncoded) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const FrameDescription frame = frame_named("laser_gyro");
    std::vector<ImuSample> sent = pulse_samples(2000, seed, seed * 1000);
    for (std::size_t i = 0; i < sent.size(); i += 7) sent[i].flags = sample_flag_invalid;
    Line line(frame);
    line.feed(encode_all(frame, sent));
    ASSERT_EQ(line.samples.size(), sent.size());
    EXPECT_EQ(expect_only_sent(line.samples, sent), 0U);
    EXPECT_EQ(line.decoder.counters().bad_frames, 0U);
    EXPECT_EQ(line.decoder.scan().skipped_bytes, 0U);
  }
}

// Orders, widths, masks, axes, cumulative fields: every combination drawn, the samples drawn to fit.
TEST(FrameDecoder, GivesBackWhatWasEncodedForAnyLayout) {
  std::mt19937_64 random(7);
  const auto one_of = [&](std::initializer_list<const char*> choices) {
    return std::string(choices.begin()[random() % choices.size()]);
  };
  for (int layout = 0; layout < 300; ++layout) {
    const std::string type = one_of({"i16", "i24", "i32", "i64"});
    const bool cumulative = random() % 2 == 0;
    std::vector<std::string> lines = {
        "length = 80",
        "order = " + one_of({"little", "big"}),
        "word_order = " + one_of({"same", "swapped"}),
        "gyro.offset = 6",
        "gyro.type = " + type,
        "gyro.axes = " + one_of({"+x, +y, +z", "-z, +x, -y", "+y, -x, +z"}),
        "gyro.kind = " + std::string(cumulative ? "cumulative" : "each"),
        "accel.offset = 54, 34, 44",
        "accel.type = " + one_of({"i32", "i64"}),
        "status.offset = 62",
        "temperature.offset = 64",
        "counter.type = " + one_of({"u8", "u16", "u24", "u32"}),
        "check = " + one_of({"none", "sum8", "sum16", "sum32", "xor8"}),
        "check.offset = -5",
        "check.start = 2",
        "tail = 0D",
    };
    FrameDescription frame;
    {
      std::string text(builtin_frame_text("laser_gyro"));
      text.resize(text.find("check = crc"));
      std::string body;
      for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = text.find('\n', at);
        const std::string line = text.substr(at, end - at);
        at = end + 1;
        bool replaced = false;
        for (const std::string& other : lines)
          replaced = replaced || other.substr(0, other.find(' ')) == line.substr(0, line.find(' '));
        if (!replaced) body += line + "\n";
      }
      for (const std::string& line : lines) {
        if (lines[12] == "check = none" && line.starts_with("check.")) continue;
        body += line + "\n";
      }
      auto parsed = parse_frame_description(body, "drawn");
      ASSERT_TRUE(parsed.ok()) << parsed.error().message;
      frame = *parsed;
    }
    const int bits = type == "i16" ? 15 : type == "i24" ? 23 : 31;
    std::vector<ImuSample> sent = pulse_samples(60, static_cast<unsigned>(layout));
    for (ImuSample& sample : sent)
      for (double& g : sample.gyro) g = std::trunc(g / std::ldexp(1.0, 32 - bits));  // half the width, either sign
    Line line(frame);
    line.feed_frames(frame, sent);
    // A weak check waits for the next sync; a cumulative field needs a first frame to begin from.
    const std::size_t held = frame.check.weak() ? 1 : 0;
    std::vector<ImuSample> expected(sent.begin() + (cumulative ? 1 : 0),
                                    sent.end() - static_cast<std::ptrdiff_t>(held));
    ASSERT_EQ(line.samples.size(), expected.size()) << "layout " << layout;
    ASSERT_EQ(expect_only_sent(line.samples, expected), 0U) << "layout " << layout;
  }
}

TEST(FrameDecoder, RoundingIsCarriedOnSoThatNoAngleIsLost) {
  const FrameDescription frame = frame_named("stim300");
  std::vector<ImuSample> sent(5000);
  double turned = 0.0;
  for (std::size_t i = 0; i < sent.size(); ++i) {
    sent[i].counter = static_cast<std::int64_t>(i);
    sent[i].gyro = {3.3e-9, -1e-6, 1e-4};
    sent[i].accel = {0.0, 1e-7, 9.8 * 0.002};
    turned += sent[i].gyro[0];
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
    const std::uint32_t crc = frame_check_value(frame.check, Crc(frame.check.crc), bytes);
    bytes[34] = static_cast<std::byte>(crc & 0xFFU);
    bytes[35] = static_cast<std::byte>(crc >> 8);
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
  const auto frame = parse_frame_description(text, "two");
  ASSERT_TRUE(frame.ok()) << frame.error().message;
  std::vector<ImuSample> sent = pulse_samples(2);
  FrameEncoder encoder(*frame);
  Line line(*frame);
  for (std::size_t i = 0; i < 2; ++i) {
    Bytes bytes(36);
    ASSERT_TRUE(encoder.encode(sent[i], bytes).ok());
    if (i == 1) {
      bytes[33] = std::byte{2};
      const std::uint32_t crc = frame_check_value(frame->check, Crc(frame->check.crc), bytes);
      bytes[34] = static_cast<std::byte>(crc & 0xFFU);
      bytes[35] = static_cast<std::byte>(crc >> 8);
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
  const Bytes vector = from_hex(
      "AA441328B6059C0678B9E21C000B9C060B9755A832941D4103158000EBD09102A687F3FF38EAFCFF66B7FCFF1C5FFFFF59D9FFFF475FAFB"
      "A");
  Bytes other = vector;
  other.resize(12 + 8 + 4);
  other[3] = std::byte{8};
  other[4] = std::byte{0x11};
  const std::uint32_t crc = Crc(novatel.check.crc)(std::span(other).first(20));
  for (int i = 0; i < 4; ++i) other[20 + static_cast<std::size_t>(i)] = static_cast<std::byte>(crc >> (8 * i) & 0xFFU);
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

}  // namespace
}  // namespace turncal
