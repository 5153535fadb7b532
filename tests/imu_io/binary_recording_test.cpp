// The binary recording: what is written comes back, in every form and from text, and nothing else is accepted.
#include <rapidcheck.h>
#include "tests/test.h"

#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "recording_samples.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

// A recording of any kinds of increments, with gaps, flags and segments anywhere.
struct AnyRecording {
  RecordingInfo info;
  std::vector<ImuSample> samples;
  Segments segments;
};

AnyRecording draw_recording() {
  const auto below = [](int end) { return *rc::gen::resize(rc::kNominalSize, rc::gen::inRange(0, end)); };
  AnyRecording drawn;
  const auto kind = [&] { return below(2) == 0 ? IncrementKind::pulses : IncrementKind::physical; };
  const IncrementKind gyro = kind(), accel = kind();
  drawn.info = make_info(gyro, accel, below(2) == 0);
  drawn.info.simulated = below(2) == 0;
  drawn.info.latitude_deg = below(180) - 90 + 1.0 / 3.0;
  drawn.info.sample_period_s = 1.0 / (1 + below(2000));
  if (below(2) == 0) drawn.info.started_utc_s = 1769860800 + below(1000000);
  const auto count = std::size_t(10 + below(4000));
  const std::int64_t first = below(2) == 0 ? below(100) - 50 : std::int64_t{1} << (31 + below(20));
  drawn.samples = make_samples(drawn.info, count, first, unsigned(below(1000)));
  std::int64_t start = first;
  for (std::size_t at = below(8) == 0 ? count : 1; at < count; at += std::size_t(1 + below(1000))) {
    const std::int64_t end = drawn.samples[at].counter;
    drawn.segments.push_back(make_segment(below(9), static_cast<SegmentKind>(below(3)), start, end, below(720) - 360,
                                          1e-9 * below(9), below(2) == 0 ? -0.0 : 1.0 / 3.0));
    start = end;
  }
  return drawn;
}

bool same(const RecordingInfo& a, const RecordingInfo& b) {
  const auto all = [](const RecordingInfo& i) {
    return std::tie(i.sample_period_s, i.latitude_deg, i.gravity_mps2, i.unit_serial, i.gyro_increment,
                    i.accel_increment, i.accel_pulse_mps, i.has_temperature, i.simulated, i.started_utc_s);
  };
  return all(a) == all(b);
}

// Binary, from there text, from there binary: the same in all three, bit by bit, however often it is read, and under one hash.
TEST(RecordingForms, EveryBitComesBackFromEveryForm) {
  ::setenv("RC_PARAMS", "seed=20260101", 0);  // another seed may be given from outside
  EXPECT_TRUE(rc::check("every bit comes back from every form", [] {
    const AnyRecording drawn = draw_recording();
    const TemporaryFolder folder;
    auto writer = RecordingWriter::create(folder / binary_recording_name, drawn.info);
    RC_ASSERT(writer.ok());
    std::span<const ImuSample> left = drawn.samples;
    for (const Segment& segment : drawn.segments) {
      RC_ASSERT(writer->begin_segment(segment).ok());
      std::size_t inside = 0;
      while (inside < left.size() && left[inside].counter < segment.end_sample) ++inside;
      RC_ASSERT(writer->add(left.first(inside)).ok());
      left = left.subspan(inside);
      RC_ASSERT(writer
                    ->end_segment(segment.kind, segment.end_sample,
                                  {{segment.heading_deg, segment.pitch_deg, segment.roll_deg}})
                    .ok());
    }
    RC_ASSERT(writer->add(left).ok());
    RC_ASSERT(writer->sample_count() == drawn.samples.size());
    RC_ASSERT(writer->finish().ok());

    std::string hash;
    const auto check = [&](const std::string& path) {
      auto source = RecordingSource::open(path);
      RC_ASSERT(source.ok());
      RC_ASSERT(same((*source)->info(), drawn.info));
      RC_ASSERT(all_same((*source)->segments(), drawn.segments));
      RC_ASSERT(all_same(read_all(**source), drawn.samples));
      RC_ASSERT(all_same(read_all(**source), drawn.samples));  // again from the start
      RC_ASSERT((*source)->damage().complete && describe((*source)->damage()).empty());
      if (hash.empty()) hash = *(*source)->content_hash();
      RC_ASSERT(hash.size() == 32U);
      RC_ASSERT(*(*source)->content_hash() == hash);
      return std::move(*source);
    };
    check(folder.path());
    const auto binary = check(folder / binary_recording_name);
    RC_ASSERT(export_text(*binary, folder / "text").ok());
    const auto text = check(folder / "text");
    RC_ASSERT(import_binary(*text, folder / "b.tcr").ok());
    check(folder / "b.tcr");
  }));
}

TEST(BinaryRecording, ErrorOfTheSinkStopsTheReading) {
  TemporaryFolder folder;
  const RecordingInfo info = make_info();
  auto writer = RecordingWriter::create(folder / "a.tcr", info);
  ASSERT_OK(writer->add(make_samples(info, 5000)));
  ASSERT_OK(writer->finish());
  auto source = RecordingSource::open(folder / "a.tcr");
  int calls = 0;
  EXPECT_ERROR((*source)->read([&](std::span<const ImuSample>) {
    ++calls;
    return Status(input_error("enough"));
  }),
               "enough");
  EXPECT_EQ(calls, 1);
}

// There are many NaNs; the content hash must not see which one a decoder made.
TEST(BinaryRecording, EveryNaNMeansNotMeasured) {
  TemporaryFolder folder;
  const RecordingInfo info = make_info();
  std::vector<std::string> hashes;
  for (const std::uint32_t bits : {0x7FC00000U, 0xFFC00000U, 0x7FC00123U}) {
    ImuSample sample;
    sample.temperature_c = std::bit_cast<float>(bits);
    const std::string path = folder / std::to_string(bits);
    auto writer = RecordingWriter::create(path, info);
    ASSERT_OK(writer->add(std::span(&sample, 1)));
    ASSERT_OK(writer->finish());
    hashes.push_back(*(*RecordingSource::open(path))->content_hash());
  }
  EXPECT_EQ(hashes[0], hashes[1]);
  EXPECT_EQ(hashes[0], hashes[2]);
}

// A records payload that contradicts itself is refused whole.
TEST(BinaryRecording, SamplesPayloadIsCheckedInItself) {
  const RecordingInfo info = make_info();
  std::vector<ImuSample> samples(10);
  for (int i = 0; i < 10; ++i) samples[std::size_t(i)].counter = i < 4 ? i : i < 7 ? i + 10 : i + 20;
  samples[5].flags = 3;
  std::vector<std::byte> good;
  append_samples(good, samples, info);
  ASSERT_TRUE(parse_samples(good, info).has_value());
  // first counter (8), count (4), gaps (4), flags (4), two gaps of (index 4, counter 8), one flag of (index 4, flags 4)
  const auto refused = [&](std::size_t place, auto value) {
    std::vector<std::byte> bad = good;
    std::memcpy(bad.data() + place, &value, sizeof value);
    EXPECT_FALSE(parse_samples(bad, info).has_value()) << place;
  };
  refused(0, std::int64_t{20});  // the first gap would go back
  refused(0, std::numeric_limits<std::int64_t>::min());
  refused(8, std::uint32_t{9});  // size and count disagree
  refused(8, std::uint32_t{0xFFFFFFFF});
  refused(12, std::uint32_t{0xFFFFFFFF});
  refused(20, std::uint32_t{0});   // gap before the first sample
  refused(24, std::int64_t{3});    // no gap but a step back
  refused(24, std::int64_t{4});    // no gap at all
  refused(24, std::int64_t{25});   // beyond the next one
  refused(32, std::uint32_t{4});   // indices do not increase
  refused(32, std::uint32_t{10});  // beyond the last sample
  refused(36, std::numeric_limits<std::int64_t>::max());
  refused(44, std::uint32_t{10});  // flag beyond the last sample
  good.push_back(std::byte{0});
  EXPECT_FALSE(parse_samples(good, info).has_value());
  EXPECT_FALSE(parse_samples({}, info).has_value());
}

// ---- what is not a recording ----

TEST(BinaryRecording, OpeningWhatIsNotOne) {
  TemporaryFolder folder;
  EXPECT_ERROR(RecordingSource::open(folder / "no"), (folder / "no") + ": cannot open: No such file or directory");
  EXPECT_ERROR(RecordingSource::open(folder.path()),
               folder.path() + ": contains neither recording.tcr nor recording.conf: expected a recording");
  write_file(folder / "a.tcr", "");
  EXPECT_ERROR(RecordingSource::open(folder / "a.tcr"), (folder / "a.tcr") + ": empty file: expected a recording");
  write_file(folder / "a.tcr", std::string(100000, 'x'));
  EXPECT_ERROR(RecordingSource::open(folder / "a.tcr"),
               (folder / "a.tcr") + ": not a recording of this program, or its first records are destroyed");
  auto writer = RecordingWriter::create(folder / "b.tcr", make_info());
  EXPECT_ERROR(RecordingSource::open(folder / "b.tcr"), (folder / "b.tcr") + ": no samples in it");
}

}  // namespace
}  // namespace turncal
