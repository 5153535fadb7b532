// Every fault of the list for IMUs, injected, and what becomes of it. The rule under test: no sample comes out that was not sent,
// what is missing is counted, and what cannot go on is an error of kind device.
// Faults of the capture file (full disk, kill -9, torn tail, second writer) stand in recording_writer_test
// and atomic_file_test; hang-up, silence and reopening on a line in serial_imu_test.
#include "frame_streams.h"
#include "tests/test.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

const FrameDescription& gyro_frame() {
  static const FrameDescription frame = frame_named("laser_gyro");
  return frame;
}
constexpr std::size_t size = 36;

// Damaged bytes: for each shipped description with pulses, a stream in which every so many frames something happens. The
// number of frames that may be lost for one accident is given.
enum class Damage { drop, insert, flip_bit, flip_burst };
struct DamageResult {
  std::size_t accidents = 0, missing = 0;
  ImuLinkCounters counters;
};
DamageResult damaged(const FrameDescription& frame, Damage damage, unsigned seed, std::size_t every) {
  const std::vector<ImuSample> sent = pulse_samples(4000, seed, 5);
  const Bytes clean = encode_all(frame, sent);
  const std::size_t length = clean.size() / sent.size();
  std::mt19937_64 random(seed);
  Bytes stream;
  DamageResult result;
  std::size_t next_accident = every * length;
  for (std::size_t i = 0; i < clean.size(); ++i) {
    if (i >= next_accident && i + every * length < clean.size()) {
      ++result.accidents;
      next_accident = i + every * length + random() % length;
      switch (damage) {
        case Damage::drop: i += 1 + random() % 3; break;
        case Damage::insert:
          for (std::size_t n = 1 + random() % 3; n > 0; --n) stream.push_back(static_cast<std::byte>(random()));
          break;
        case Damage::flip_bit: stream.push_back(clean[i++] ^ static_cast<std::byte>(1U << random() % 8)); break;
        case Damage::flip_burst:
          for (int n = 0; n < 2; ++n) stream.push_back(clean[i++] ^ static_cast<std::byte>(1 + random() % 255));
          break;
      }
    }
    stream.push_back(clean[i]);
  }
  Line line(frame);
  line.feed_paced(stream, length);
  result.missing = expect_only_sent(line.samples, sent);
  result.counters = line.decoder.counters();
  EXPECT_FALSE(line.restarted);
  // All that is missing between first and last is known to be missing.
  const auto held = std::size_t(sent.back().counter - line.samples.back().counter);
  EXPECT_EQ(result.counters.lost_samples, result.missing - held);
  return result;
}

// What an 8-bit sum alone lets pass is 0.4 %; 10 x 390 accidents of each kind and none passes, by its counter and the next sync. Two changed bytes
// that cancel out in the sum nothing can tell.
TEST(ImuFaults, DroppedInsertedAndFlippedBytesCostTheFramesTheyHit) {
  for (const char* name : {"laser_gyro", "pulses_9966"}) {
    const FrameDescription frame = frame_named(name);
    const bool weak = frame.check.weak();
    for (const Damage damage : {Damage::drop, Damage::insert, Damage::flip_bit, Damage::flip_burst}) {
      for (unsigned seed = 1; seed <= 10 && !(weak && damage == Damage::flip_burst); ++seed) {
        const DamageResult result = damaged(frame, damage, seed, 10);
        EXPECT_GT(result.accidents, 300U);
        // An insertion between two frames costs none, a burst over a border two. With a weak check the frame before an accident is not believed
        // either when the sync after it was hit, nor one alone between two gaps.
        EXPECT_LE(result.missing, result.accidents + result.accidents / (weak ? 1 : 10)) << name << int(damage);
        EXPECT_GE(result.counters.bad_frames, weak ? 0 : result.accidents * 9 / 10);
        EXPECT_GE(result.counters.resyncs, weak ? 0 : result.accidents * 9 / 10);
      }
    }
  }
}

TEST(ImuFaults, SyncInsideAPayload) {
  // Pulses that are the sync bytes, wherever they can stand, and begin in the middle of a frame.
  std::vector<ImuSample> sent = pulse_samples(100);
  std::int32_t both = 0;
  std::memcpy(&both, "\xEB\x90\xEB\x90", 4);
  for (ImuSample& sample : sent) {
    sample.gyro.fill(both);
    sample.accel.fill(both);
  }
  const Bytes clean = encode_all(gyro_frame(), sent);
  for (std::size_t cut = 0; cut < size; ++cut) {
    Line line(gyro_frame());
    line.feed(std::span(clean).subspan(cut));
    EXPECT_EQ(expect_only_sent(line.samples, sent), cut == 0 ? 0U : 1U) << cut;
  }
}

TEST(ImuFaults, BadCheckWrongLengthWrongIdInMidStream) {
  const FrameDescription frame = frame_named("novatel_rawimusx");
  std::vector<ImuSample> sent = pulse_samples(9);
  for (ImuSample& sample : sent) {
    sample.temperature_c = std::numeric_limits<float>::quiet_NaN();
    for (double& g : sample.gyro) g = std::ldexp(g, -33);
    for (double& a : sample.accel) a = 0.3048 * std::ldexp(a, -27);
  }
  const Bytes clean = encode_all(frame, sent);
  for (const std::size_t place : {52U, 3U, 4U}) {  // check, length, id
    for (const bool sealed : {false, true}) {
      if (sealed && place == 52U) continue;
      Bytes stream = clean;
      const std::span hit = std::span(stream).subspan(4 * 56, 56);
      hit[place] ^= std::byte{1};
      if (sealed) seal(frame, hit);
      Line line(frame);
      line.feed_paced(stream, 56);
      ASSERT_EQ(line.samples.size(), 8U) << place << sealed;
      EXPECT_EQ(line.samples[4].counter - line.samples[3].counter, 2);
      EXPECT_EQ(line.decoder.counters().lost_samples, 1U);
      // A whole frame of another id with a right check is somebody else's; all else is bad.
      EXPECT_EQ(line.decoder.counters().bad_frames, sealed && place == 4U ? 0U : 1U);
    }
  }
}

TEST(ImuFaults, AWholeFrameOfAnotherLengthIsNotReadAsOurs) {
  // The id of RAWIMUSX, but shorter than its fields reach, with a check that is right.
  const FrameDescription frame = frame_named("novatel_rawimusx");
  Bytes shorter = from_hex("AA441310B6059C0678B9E21C000B9C060B9755A832941D4103158000000000000000");
  shorter.resize(32);
  shorter[3] = std::byte{16};
  seal(frame, shorter);
  Line line(frame);
  line.feed(shorter);
  line.feed(Bytes(40));
  EXPECT_TRUE(line.samples.empty());
  EXPECT_EQ(line.decoder.scan().frames, 0U);
  EXPECT_EQ(line.decoder.scan().skipped_bytes, 72U);
}

TEST(ImuFaults, CounterWrapGapDuplicateAndBackwards) {
  const std::int64_t wrap = 4294967296;
  std::vector<ImuSample> sent = pulse_samples(100, 1, wrap - 50);
  Line line(gyro_frame());
  line.feed_frames(gyro_frame(), sent);
  EXPECT_EQ(expect_only_sent(line.samples, sent), 0U);  // over the wrap

  line.time_s += 0.05;
  std::vector<ImuSample> later = pulse_samples(10, 2, wrap + 60);
  line.feed_frames(gyro_frame(), later);
  EXPECT_EQ(line.decoder.counters().lost_samples, 10U);
  EXPECT_EQ(line.samples.back().counter, wrap + 69);

  line.feed_frames(gyro_frame(), {later.back()});
  EXPECT_EQ(line.decoder.counters().duplicates, 1U);
  line.feed_frames(gyro_frame(), {later[3]});
  EXPECT_EQ(line.decoder.strays(), 1U);
  EXPECT_EQ(line.samples.size(), 110U);
  later = pulse_samples(3, 3, wrap + 70);
  line.feed_frames(gyro_frame(), later);
  EXPECT_EQ(line.samples.size(), 113U);
  EXPECT_FALSE(line.restarted);
}

TEST(ImuFaults, AUnitThatBeganAnewStopsTheDecoder) {
  Line line(gyro_frame());
  line.feed_frames(gyro_frame(), pulse_samples(100, 1, 70000));
  line.time_s += 3.0;
  line.feed_frames(gyro_frame(), pulse_samples(20, 2, 0));
  EXPECT_TRUE(line.restarted);
  EXPECT_EQ(line.samples.size(), 100U);  // not one of the new ones
  // After reopening it goes on by the time that has passed, after a gap.
  line.restarted = false;
  line.decoder.rejoin();
  line.feed_frames(gyro_frame(), pulse_samples(20, 2, 20));
  EXPECT_FALSE(line.restarted);
  ASSERT_EQ(line.samples.size(), 120U);
  EXPECT_EQ(line.samples[100].counter, 70099 + 621);  // 3 s and 21 frames
}

TEST(ImuFaults, GapBeyondWhatTheCounterCanTell) {
  // A STIM300 wraps every 128 ms. Gaps of up to 20 s, arrival up to 16 ms late.
  const FrameDescription frame = frame_named("stim300");
  std::mt19937_64 random(4);
  Line line(frame);
  std::vector<std::int64_t> sent;
  std::int64_t counter = 0;
  for (int i = 0; i < 200; ++i) {
    ImuSample sample;
    sample.accel[2] = 9.8 * 0.002;
    std::int64_t jump = 1 + std::int64_t(random() % 10000);
    if ((counter + jump) % 64 == 0) ++jump;  // a counter that begins at 0 after a silence is a unit that was reset
    sent.push_back(sample.counter = counter += jump);
    line.time_s += 0.002 * double(jump - 1);
    const double late = 0.001 * double(random() % 17);
    line.time_s += late;
    line.feed_frames(frame, {sample});
    line.time_s -= late;
  }
  line.idle(1.0);
  ASSERT_EQ(line.samples.size(), sent.size());
  for (std::size_t i = 1; i < sent.size(); ++i)
    ASSERT_EQ(line.samples[i].counter - line.samples[0].counter, sent[i] - sent[0]) << i;
}

TEST(ImuFaults, NotANumberIsNoSample) {
  const FrameDescription frame = frame_named("kvh1750");
  const std::vector<ImuSample> sent = numbered(0, 5, 40.0F);
  const Bytes stream = encode_all(frame, sent);
  for (const std::uint32_t bits : {0x7FC00000U, 0x7F800000U, 0xFF800001U}) {
    for (const std::size_t place : {4U, 12U, 16U, 24U}) {
      Bytes copy = stream;
      const std::span hit = std::span(copy).subspan(2 * 36, 36);
      for (std::size_t i = 0; i < 4; ++i) hit[place + i] = static_cast<std::byte>(bits >> (24 - 8 * i) & 0xFFU);
      seal(frame, hit);
      Line line(frame);
      line.feed_paced(copy, 36);
      EXPECT_EQ(expect_only_sent(line.samples, sent), 1U);
      EXPECT_EQ(line.decoder.counters().bad_frames, 1U);
      EXPECT_EQ(line.decoder.counters().lost_samples, 1U);
    }
  }
}

TEST(ImuFaults, AnInvalidStatusOrAnImpossibleNumberIsKeptAndFlagged) {
  for (const std::string name : {"laser_gyro", "stim300", "kvh1750", "novatel_rawimusx", "ranged"}) {
    const bool ranged = name == "ranged";
    const FrameDescription frame = ranged ? frame_with("laser_gyro", {"gyro.range = -1000, 1000"}) : frame_named(name);
    std::vector<ImuSample> sent = numbered(0, 3);
    if (ranged) {
      sent[0].gyro = {1000.0, -1000.0, 0.0};
      sent[1].gyro = {0.0, 0.0, 1001.0};
    } else {
      sent[1].flags = sample_flag_invalid;
    }
    Line line(frame);
    line.feed_frames(frame, sent);
    ASSERT_EQ(line.samples.size(), 3U) << name;
    for (std::size_t i = 0; i < 3; ++i)
      EXPECT_EQ(line.samples[i].flags, i == 1 ? sample_flag_invalid : 0U) << name << " " << i;
    EXPECT_TRUE(ranged || line.decoder.invalid() == 1U) << name;
  }
}

TEST(ImuFaults, BatchesAndClockStepsDoNotTouchTheCount) {
  for (const char* name : {"laser_gyro", "pulses_9966"}) {
    const FrameDescription frame = frame_named(name);
    const std::vector<ImuSample> sent = pulse_samples(900);
    const Bytes clean = encode_all(frame, sent);
    const std::size_t length = clean.size() / sent.size();
    Line line(frame);
    for (std::size_t i = 0; i < sent.size(); i += 3) {
      line.time_s += 0.015;
      if (i == 300) line.time_s += 3600.0;
      if (i == 600) line.time_s -= 7200.0;
      line.feed(std::span(clean).subspan(i * length, 3 * length));
    }
    EXPECT_EQ(expect_only_sent(line.samples, sent), frame.check.weak() ? 1U : 0U) << name;
    EXPECT_EQ(line.decoder.counters().lost_samples, 0U);
    EXPECT_FALSE(line.restarted);
  }
}

TEST(ImuFaults, NoiseAloneGivesNothing) {
  // 4 MB of random bytes; with the weakest check a false frame needs sync, sum and the next sync, and a second one after it.
  std::mt19937_64 random(11);
  Bytes noise(4 << 20);
  for (std::byte& byte : noise) byte = static_cast<std::byte>(random());
  for (const std::string_view name : builtin_frame_names()) {
    Line line(frame_named(std::string(name)));
    line.feed(noise);
    EXPECT_TRUE(line.samples.empty()) << name;
    EXPECT_FALSE(line.restarted) << name;
  }
}

}  // namespace
}  // namespace turncal
