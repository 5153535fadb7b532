// The binary recording: what is written comes back, in every form and from text, and nothing else is accepted.
#include <gtest/gtest.h>

#include <bit>
#include <cstring>
#include <tuple>

#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "recording_samples.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

class BinaryRecordingKinds : public testing::TestWithParam<std::tuple<IncrementKind, IncrementKind, bool>> {};

TEST_P(BinaryRecordingKinds, EverythingComesBack) {
  TemporaryFolder folder;
  const auto [gyro, accel, temperature] = GetParam();
  RecordingInfo info = make_info(gyro, accel, temperature);
  info.simulated = true;
  if (temperature) info.started_utc_s = 1769860800;
  const auto samples = make_samples(info, 5000);
  const std::int64_t middle = samples[2500].counter;
  const Segments segments = {make_segment(1, SegmentKind::align, samples[0].counter, middle, -90, 0.5, 0),
                             make_segment(2, SegmentKind::still, middle, samples.back().counter + 1, 0, 0, 360)};
  auto writer = RecordingWriter::create(folder / binary_recording_name, info);
  ASSERT_OK(writer);
  write_segment(*writer, segments[0], std::span(samples).first(2500));
  write_segment(*writer, segments[1], std::span(samples).subspan(2500));
  EXPECT_EQ(writer->sample_count(), samples.size());
  ASSERT_OK(writer->finish());

  for (const std::string& path : {folder.path(), folder / binary_recording_name}) {
    auto source = RecordingSource::open(path);
    ASSERT_OK(source);
    const RecordingInfo& read = (*source)->info();
    EXPECT_EQ(read.sample_period_s, info.sample_period_s);
    EXPECT_EQ(read.latitude_deg, info.latitude_deg);
    EXPECT_EQ(read.gravity_mps2, info.gravity_mps2);
    EXPECT_EQ(read.unit_serial, info.unit_serial);
    EXPECT_EQ(read.gyro_increment, info.gyro_increment);
    EXPECT_EQ(read.accel_increment, info.accel_increment);
    EXPECT_EQ(read.accel_pulse_mps, info.accel_pulse_mps);
    EXPECT_EQ(read.has_temperature, info.has_temperature);
    EXPECT_EQ(read.simulated, info.simulated);
    EXPECT_EQ(read.started_utc_s, info.started_utc_s);
    expect_same((*source)->segments(), segments);
    expect_same(read_all(**source), samples);
    expect_same(read_all(**source), samples);  // again from the start
    EXPECT_EQ(describe((*source)->damage()), "");
    EXPECT_TRUE((*source)->damage().complete);
  }
}
INSTANTIATE_TEST_SUITE_P(All, BinaryRecordingKinds,
                         testing::Combine(testing::Values(IncrementKind::pulses, IncrementKind::physical),
                                          testing::Values(IncrementKind::pulses, IncrementKind::physical),
                                          testing::Bool()));

TEST(BinaryRecording, RepeatedDwellIsClosedAsRotate) {
  TemporaryFolder folder;
  const RecordingInfo info = make_info();
  const auto samples = make_samples(info, 50, 0);
  auto writer = RecordingWriter::create(folder / "a.tcr", info);
  ASSERT_OK(writer->begin_segment(make_segment(3, SegmentKind::still, 0, 0, -90, 0, 0)));
  ASSERT_OK(writer->add(samples));
  ASSERT_OK(writer->end_segment(SegmentKind::rotate, 50, {{-90, 0, 0}}));
  EXPECT_FALSE(writer->open_segment().has_value());
  ASSERT_OK(writer->finish());
  auto source = RecordingSource::open(folder / "a.tcr");
  ASSERT_OK(source);
  expect_same((*source)->segments(), {make_segment(3, SegmentKind::rotate, 0, 50, -90, 0, 0)});
}

TEST(BinaryRecording, SegmentThatWasNotEndedIsReadAsRotate) {
  TemporaryFolder folder;
  const RecordingInfo info = make_info();
  const auto samples = make_samples(info, 60, 0);
  {
    auto writer = RecordingWriter::create(folder / "a.tcr", info);
    write_segment(*writer, make_segment(1, SegmentKind::align, 0, 20), std::span(samples).first(20));
    ASSERT_OK(writer->begin_segment(make_segment(1, SegmentKind::still, 20, 0, 0, 90, 0)));
    ASSERT_OK(writer->add(std::span(samples).subspan(20)));
  }
  auto source = RecordingSource::open(folder / "a.tcr");
  ASSERT_OK(source);
  expect_same((*source)->segments(),
              {make_segment(1, SegmentKind::align, 0, 20), make_segment(1, SegmentKind::rotate, 20, 60, 0, 90, 0)});
  EXPECT_FALSE((*source)->damage().complete);
  EXPECT_EQ(describe((*source)->damage()), "no end mark: the capture was interrupted");
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
  for (int i = 0; i < 10; ++i) samples[static_cast<std::size_t>(i)].counter = i < 4 ? i : i < 7 ? i + 10 : i + 20;
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
               folder.path() + ": neither recording.tcr nor recording.conf in it: expected a recording");
  write_file(folder / "a.tcr", "");
  EXPECT_ERROR(RecordingSource::open(folder / "a.tcr"), (folder / "a.tcr") + ": empty file: expected a recording");
  write_file(folder / "a.tcr", std::string(100000, 'x'));
  EXPECT_ERROR(RecordingSource::open(folder / "a.tcr"),
               (folder / "a.tcr") + ": not a recording of this program, or its first records are destroyed");
  auto writer = RecordingWriter::create(folder / "b.tcr", make_info());
  EXPECT_ERROR(RecordingSource::open(folder / "b.tcr"), (folder / "b.tcr") + ": no samples in it");
}

// ---- beside the text form ----

class TextRoundTrip : public testing::TestWithParam<std::tuple<IncrementKind, IncrementKind, bool>> {};

// Binary to text and back: the same samples bit for bit, the same hash in all three.
TEST_P(TextRoundTrip, KeepsEveryBitAndTheHash) {
  TemporaryFolder folder;
  const auto [gyro, accel, temperature] = GetParam();
  RecordingInfo info = make_info(gyro, accel, temperature);
  info.simulated = temperature;
  if (temperature) info.started_utc_s = 1769860800;
  const auto samples = make_samples(info, 30000, std::int64_t{1} << 40);
  auto writer = RecordingWriter::create(folder / "a.tcr", info);
  write_segment(*writer,
                make_segment(1, SegmentKind::align, samples[10].counter, samples[900].counter, 1e-9, -0.0, 1.0 / 3.0),
                samples);
  ASSERT_OK(writer->finish());
  auto binary = RecordingSource::open(folder / "a.tcr");
  ASSERT_OK(binary);
  ASSERT_OK(export_text(**binary, folder / "text"));
  auto text = RecordingSource::open(folder / "text");
  ASSERT_OK(text);
  EXPECT_EQ((*text)->info().simulated, info.simulated);
  EXPECT_EQ((*text)->info().started_utc_s, info.started_utc_s);
  expect_same(read_all(**text), samples);
  ASSERT_OK(import_binary(**text, folder / "b.tcr"));
  auto again = RecordingSource::open(folder / "b.tcr");
  ASSERT_OK(again);
  expect_same(read_all(**again), samples);
  const std::string hash = *(*binary)->content_hash();
  EXPECT_EQ(hash.size(), 32U);
  EXPECT_EQ(*(*text)->content_hash(), hash);
  EXPECT_EQ(*(*again)->content_hash(), hash);
}
INSTANTIATE_TEST_SUITE_P(All, TextRoundTrip,
                         testing::Combine(testing::Values(IncrementKind::pulses, IncrementKind::physical),
                                          testing::Values(IncrementKind::pulses, IncrementKind::physical),
                                          testing::Bool()));

// ---- the recording that everybody measures with ----

TEST(SharedRecording, ImportAndExportGiveTheSameBytes) {
  const std::string clean = std::string(TURNCAL_SOURCE_DIR) + "/../shared/data/recordings/clean";
  if (!path_exists(clean)) GTEST_SKIP() << clean << " is not there";
  TemporaryFolder folder;
  auto text = RecordingSource::open(clean);
  ASSERT_OK(text);
  ASSERT_OK(import_binary(**text, folder / binary_recording_name));
  auto binary = RecordingSource::open(folder.path());
  ASSERT_OK(binary);
  ASSERT_OK(export_text(**binary, folder / "out"));
  for (const char* name : {"/imu.csv", "/segments.csv", "/recording.conf"})
    EXPECT_TRUE(read_file(folder / "out" + name) == read_file(clean + name)) << name;
  EXPECT_EQ(*(*text)->content_hash(), *(*binary)->content_hash());
}

}  // namespace
}  // namespace turncal
