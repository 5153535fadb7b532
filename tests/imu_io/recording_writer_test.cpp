// The writer of recordings: what it refuses, and how it goes on after an interruption.
#include "imu_io/recordings/recording_writer.h"

#include "tests/test.h"

#include "calib/statistics/clipping.h"
#include "frame_streams.h"
#include "imu_io/base/record_log.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/recording_source.h"
#include "recording_samples.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

// ---- the writer's refusals ----

struct WriterTest : testing::Test {
  TemporaryFolder folder;
  std::string path = folder / "a.tcr";
  RecordingInfo info = make_info();
};

TEST_F(WriterTest, RefusesSenselessInfo) {
  using Change = void (*)(RecordingInfo&);
  const std::string serial = ": expected a serial number of 1 to 200 bytes, printable characters without '#'";
  const std::pair<Change, std::string> cases[] = {
      {[](RecordingInfo& i) { i.gravity_mps2 = 0; }, "gravity_mps2 = '0': expected a number between 9 and 11"},
      {[](RecordingInfo& i) { i.sample_period_s = 0; },
       "sample_period_s = '0': expected a number between 1e-05 and 10"},
      {[](RecordingInfo& i) { i.latitude_deg = 90.5; }, "latitude_deg = '90.5': expected a number between -90 and 90"},
      {[](RecordingInfo& i) { i.accel_pulse_mps = 1e-308; },
       "accel_pulse_mps = '1e-308': expected a number between 1e-09 and 10"},
      {[](RecordingInfo& i) { i.unit_serial = ""; }, "unit_serial ''" + serial},
      {[](RecordingInfo& i) { i.unit_serial = "A#1"; }, "unit_serial 'A#1'" + serial},
      {[](RecordingInfo& i) { i.unit_serial.assign(201, 'A'); },
       "unit_serial '" + std::string(60, 'A') + "'..., 201 bytes" + serial}};
  for (const auto& [change, message] : cases) {
    RecordingInfo bad = info;
    change(bad);
    EXPECT_ERROR(RecordingWriter::create(path, bad), path + ": " + message);
    EXPECT_FALSE(path_exists(path));
  }
  write_file(path, "x");
  EXPECT_ERROR(RecordingWriter::create(path, info), path + ": cannot create: File exists");
}

TEST_F(WriterTest, RefusesBadSamples) {
  auto writer = RecordingWriter::create(path, info);
  const auto refused = [&](auto change, const std::string& message) {
    ImuSample sample;
    sample.counter = 1000;
    change(sample);
    EXPECT_ERROR(writer->add(std::span(&sample, 1)), path + ": " + message);
  };
  refused([](ImuSample& s) { s.gyro[1] = 0.5; }, "sample 1000: gyro: expected whole pulses that fit into 32 bits");
  refused([](ImuSample& s) { s.accel[2] = 3e9; }, "sample 1000: accel: expected whole pulses that fit into 32 bits");
  refused([](ImuSample& s) { s.gyro[0] = std::nan(""); },
          "sample 1000: gyro: expected whole pulses that fit into 32 bits");
  refused([](ImuSample& s) { s.temperature_c = INFINITY; }, "sample 1000: temperature_c: expected a finite number");
  refused([](ImuSample& s) { s.counter = std::int64_t{1} << 63; }, "sample -9223372036854775808: counter out of range");
  ImuSample good;
  good.counter = 7;
  ASSERT_OK(writer->add(std::span(&good, 1)));
  EXPECT_ERROR(writer->add(std::span(&good, 1)),
               path + ": sample counter = '7': expected more than 7 of the sample before");
}

TEST_F(WriterTest, RefusesBadSegments) {
  auto writer = RecordingWriter::create(path, info);
  EXPECT_ERROR(writer->end_segment(SegmentKind::still, 5, {}), path + ": a segment ends that did not begin");
  EXPECT_ERROR(writer->finish(), path + ": recording without samples");
  ASSERT_OK(writer->begin_segment(make_segment(1, SegmentKind::align, 0, 0)));
  EXPECT_ERROR(writer->begin_segment(make_segment(1, SegmentKind::align, 0, 0)),
               path + ": a segment begins before the one before has ended");
  EXPECT_ERROR(writer->end_segment(SegmentKind::align, 0, {}),
               path + ": segment end_sample = '0': expected more than its start, 0");
  EXPECT_ERROR(writer->finish(), path + ": recording ends inside a segment");
  ASSERT_OK(writer->end_segment(SegmentKind::align, 10, {}));
  EXPECT_ERROR(writer->begin_segment(make_segment(1, SegmentKind::still, 11, 0)),
               path + ": segment start_sample = '11': expected 10, where the one before ended");
  EXPECT_ERROR(writer->begin_segment(make_segment(1, SegmentKind::still, 10, 0, std::nan(""))),
               path + ": segment with an angle that is not finite");
  ASSERT_OK(writer->add(make_samples(info, 5, 0)));
  EXPECT_ERROR(writer->finish(),
               path + ": segment 1: end_sample = '10': expected at most one more than the last sample, 4");
}

TEST_F(WriterTest, OneWriterAFileAndNothingAfterTheEnd) {
  auto writer = RecordingWriter::create(path, info);
  const auto again = [&] { return RecordingWriter::reopen(path, RecordingWriter::OpenSegment::keep); };
  EXPECT_ERROR(again(), path + ": in use by another process (" + std::to_string(::getpid()) + ")");
  ASSERT_OK(writer->add(make_samples(info, 5)));
  ASSERT_OK(writer->finish());
  EXPECT_EQ(writer->sync().error().kind, ErrorKind::internal);
  EXPECT_ERROR(again(), path + ": this recording is finished: nothing can be added to it");
}

TEST_F(WriterTest, FullDiskIsReportedAndWhatWasWrittenCanBeRead) {
  const auto samples = make_samples(info, 20000, 0);
  auto writer = RecordingWriter::create(path, info);
  Status status, again;
  {
    const FileSizeLimit limit(200000);
    status = writer->add(samples);
    again = writer->sync();
  }
  ASSERT_TRUE(fails(status, ErrorKind::device));
  EXPECT_EQ(status.error().message, path + ": cannot write: File too large");
  EXPECT_FALSE(again.ok());  // nothing is written after a torn record
  const auto source = opened(path);
  const auto read = read_all(*source);
  ASSERT_EQ(read.size() % RecordingWriter::block_samples, 0U);
  ASSERT_GT(read.size(), 4000U);
  expect_same(read, {samples.begin(), samples.begin() + std::ptrdiff_t(read.size())});
  EXPECT_GT(source->damage().torn_tail_bytes, 0U);
}

// ---- going on after an interruption ----

struct ReopenTest : WriterTest {
  std::vector<ImuSample> samples = make_samples(info, 100, 0);
  std::int64_t counter(std::size_t i) const { return samples[i].counter; }
  void interrupted() {
    auto writer = good(RecordingWriter::create(path, info));
    write_segment(*writer, make_segment(1, SegmentKind::align, 0, 20), std::span(samples).first(20));
    ASSERT_OK(writer->begin_segment(make_segment(1, SegmentKind::still, 20, 0, 0, 90, 0)));
    ASSERT_OK(writer->add(std::span(samples).subspan(20, 30)));
    ASSERT_OK(writer->sync());
  }
};

TEST_F(ReopenTest, KeepGoesOnInsideTheOpenSegment) {
  interrupted();
  auto writer = good(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::keep));
  EXPECT_EQ(writer->sample_count(), 50U);
  EXPECT_EQ(writer->first_counter(), 0);
  EXPECT_EQ(writer->last_counter(), 49);
  EXPECT_EQ(writer->info().unit_serial, "LG-7");
  ASSERT_TRUE(writer->open_segment().has_value());
  EXPECT_EQ(writer->open_segment()->start_sample, 20);
  ASSERT_OK(writer->end_segment(SegmentKind::rotate, 50, {{0, 90, 0}}));
  write_segment(*writer, make_segment(1, SegmentKind::still, 50, counter(99) + 1, 0, 90, 0),
                std::span(samples).subspan(50));
  ASSERT_OK(writer->finish());
  const auto source = opened(path);
  expect_same(read_all(*source), samples);
  expect_same(source->segments(),
              {make_segment(1, SegmentKind::align, 0, 20), make_segment(1, SegmentKind::rotate, 20, 50, 0, 90, 0),
               make_segment(1, SegmentKind::still, 50, counter(99) + 1, 0, 90, 0)});
  EXPECT_EQ(describe(source->damage()), "");
}

// An interrupted dwell that is taken off and repeated leaves the very file of a run that was never interrupted.
TEST_F(ReopenTest, DropLeavesNoTrace) {
  const auto rest = [&](RecordingWriter& writer) {
    write_segment(writer, make_segment(1, SegmentKind::still, 20, counter(99) + 1, 0, 90, 0),
                  std::span(samples).subspan(20));
    ASSERT_OK(writer.finish());
  };
  interrupted();
  auto writer = good(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::drop));
  EXPECT_EQ(writer->sample_count(), 20U);
  EXPECT_EQ(writer->last_counter(), 19);
  EXPECT_FALSE(writer->open_segment().has_value());
  rest(*writer);

  auto whole = RecordingWriter::create(folder / "whole.tcr", info);
  write_segment(*whole, make_segment(1, SegmentKind::align, 0, 20), std::span(samples).first(20));
  rest(*whole);
  EXPECT_EQ(file_text(path), file_text(folder / "whole.tcr"));
}

TEST_F(ReopenTest, ARestThatIsSetAsideIsRotateAndItsSamplesSaySo) {
  const Segment first = make_segment(1, SegmentKind::align, 0, 20),
                second = make_segment(1, SegmentKind::still, 20, 50);
  {
    auto writer = RecordingWriter::create(path, info);
    write_segment(*writer, first, std::span(samples).first(20));
    write_segment(*writer, second, std::span(samples).subspan(20, 30));
    ASSERT_OK(writer->set_aside(first));
    ASSERT_OK(writer->sync());
  }
  const auto read = [&](SegmentKind kind) {
    const auto source = opened(path);
    EXPECT_EQ(source->segments()[0].kind, kind);
    EXPECT_EQ(source->segments()[1].kind, SegmentKind::still);
    EXPECT_EQ(describe(source->damage()), "no end mark: the capture was interrupted");
    auto expected = std::vector(samples.begin(), samples.begin() + 50);
    for (std::size_t i = 0; kind == SegmentKind::rotate && i < 20; ++i) expected[i].flags |= sample_flag_set_aside;
    expect_same(read_all(*source), expected);
  };
  read(SegmentKind::rotate);
  // What was decided after the last segment that is kept goes with what came after it: it is decided again.
  ASSERT_OK(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::drop));
  read(SegmentKind::align);
}

// A process may be killed after each sync: what was handed over until then is in the file.
TEST_F(ReopenTest, WhatWasSyncedIsInTheFile) {
  auto writer = good(RecordingWriter::create(path, info));
  for (std::size_t done = 0; done < samples.size(); done += 10) {
    ASSERT_OK(writer->add(std::span(samples).subspan(done, 10)));
    ASSERT_OK(writer->sync());
    const auto source = opened(path);
    expect_same(read_all(*source), {samples.begin(), samples.begin() + std::ptrdiff_t(done) + 10});
    EXPECT_FALSE(source->damage().lost_data());
  }
}

// ---- what may stand in a serial number ----

TEST(RecordingCheck, PlainTextIsPrintableUtf8) {
  for (const char* good :
       {"RLG-0042", "\xC3\xA4\xC3\xB6", "\xE5\x8D\x95\xE5\x85\x83 7", "\xF0\x9F\x9B\xB0", "a=b", "\xC2\xA0x"})
    EXPECT_TRUE(is_plain_text(good)) << good;
  const std::pair<const char*, std::vector<const char*>> kinds[] = {
      {"empty, blanks at an end, #, controls", {"", "2061", "6120", "612362", "610962", "610A62", "617F62"}},
      {"C1, of which U+009B begins an escape sequence", {"C280", "61C29B33316D", "61C29F"}},
      {"no UTF-8, cut short", {"FF", "80", "619B62", "C3", "E58D", "F09F9B"}},
      {"longer than need be", {"C0AF", "C1BF", "E080AF", "F08080AF"}},
      {"surrogate, beyond the last", {"EDA080", "F4908080", "F5808080"}},
      {"turns the writing, ends the line", {"61E280AE62", "61E280A862", "E281A6"}},
      {"is not seen", {"E2808B", "EFBBBF534E31", "534EC2AD31"}}};
  for (const auto& [kind, texts] : kinds)
    for (const char* hex : texts) {
      const Bytes bytes = from_hex(hex);
      EXPECT_FALSE(is_plain_text({reinterpret_cast<const char*>(bytes.data()), bytes.size()})) << kind << ": " << hex;
    }
}

TEST(RecordingCheck, WhatIsQuotedCanBePrinted) {
  EXPECT_EQ(quoted("a\xC2\x9B"
                   "31m\xFF\n\xC3\xA4"),
            "'a??31m??\xC3\xA4'");
}

// ---- recording damage ----

// Damage to a binary recording: cut at every byte, every bit flipped, blocks lost. The rule under test: what is handed
// over was written, in order; a flipped bit costs one record; what is missing is reported.

constexpr std::size_t chunk = 4;  // samples in a record here

struct DamageTest : testing::Test {
  TemporaryFolder folder;
  std::string path = folder / "a.tcr";
  RecordingInfo info = make_info();
  std::vector<ImuSample> samples = make_samples(info, 32, 0);
  Segments segments = {make_segment(1, SegmentKind::align, 0, 8, 0, 0, 0),
                       make_segment(1, SegmentKind::rotate, 8, 16, 0, 90, 0),
                       make_segment(1, SegmentKind::still, 16, 32, 0, 90, 0)};
  std::string content;

  void SetUp() override {
    auto writer = good(RecordingWriter::create(path, info));
    for (const Segment& segment : segments) {
      // The moves are planned as dwells that then had to be repeated.
      Segment planned = segment;
      if (planned.kind == SegmentKind::rotate) planned.kind = SegmentKind::still;
      ASSERT_OK(writer->begin_segment(planned));
      for (auto i = std::size_t(segment.start_sample); i < std::size_t(segment.end_sample); i += chunk) {
        ASSERT_OK(writer->add(std::span(samples).subspan(i, chunk)));
        ASSERT_OK(writer->sync());
      }
      ASSERT_OK(writer->end_segment(segment.kind, segment.end_sample,
                                    {{segment.heading_deg, segment.pitch_deg, segment.roll_deg}}));
    }
    ASSERT_OK(writer->finish());
    content = file_text(path);
  }

  struct Part {
    std::uint32_t type = 0;
    std::uint32_t number = 0;
    std::vector<std::byte> payload;
  };
  // 2 info, then for each segment its begin, its samples records and its end, then the end mark.
  std::vector<Part> parts() const {
    std::vector<Part> result;
    auto file = PosixFile::open_to_read(path);
    RecordScanner scanner(*file, content.size(), recording_magic);
    Record record;
    for (auto more = scanner.next(record); more && *more; more = scanner.next(record))
      result.push_back({record.type, record.number, {record.payload.begin(), record.payload.end()}});
    EXPECT_EQ(result.size(), 17U);
    return result;
  }
  static std::string bytes_of(const std::vector<Part>& parts) {
    std::vector<std::byte> bytes;
    for (const Part& part : parts) {
      const std::size_t begun = begin_record(bytes, recording_magic, part.type, part.number);
      bytes.insert(bytes.end(), part.payload.begin(), part.payload.end());
      end_record(bytes, begun);
    }
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

  // What the file is taken for when this stands in it.
  std::unique_ptr<RecordingSource> opened_with(const std::string& bytes) const {
    write_file(path, bytes);
    return opened(path);
  }
  std::vector<ImuSample> first(std::size_t count) const {
    return {samples.begin(), samples.begin() + std::ptrdiff_t(count)};
  }

  // Every sample read is one that was written, in order.
  void expect_subset(const std::vector<ImuSample>& read) const {
    std::size_t next = 0;
    for (const ImuSample& sample : read) {
      while (next < samples.size() && samples[next].counter != sample.counter) ++next;
      ASSERT_LT(next, samples.size()) << "counter " << sample.counter;
      ASSERT_TRUE(same(sample, samples[next])) << "counter " << sample.counter;
    }
  }

  // Contiguous, inside the samples, and no dwell that was not one, nor one with other angles.
  void expect_honest(const Segments& read, std::int64_t first, std::int64_t last) const {
    for (std::size_t i = 0; i < read.size(); ++i) {
      if (i > 0) {
        ASSERT_EQ(read[i].start_sample, read[i - 1].end_sample);
      }
      ASSERT_LT(read[i].start_sample, read[i].end_sample);
      ASSERT_GE(read[i].start_sample, first);
      ASSERT_LE(read[i].end_sample, last + 1);
      if (read[i].kind == SegmentKind::rotate) continue;
      const auto original = std::ranges::find_if(segments, [&](const Segment& s) {
        return s.kind == read[i].kind && s.start_sample <= read[i].start_sample && s.end_sample >= read[i].end_sample;
      });
      ASSERT_NE(original, segments.end());
      ASSERT_EQ(original->pitch_deg, read[i].pitch_deg);
    }
  }
};

TEST_F(DamageTest, CutAtEveryByteIsANormalEnd) {
  std::size_t most_samples = 0;
  for (std::size_t length = 0; length < content.size(); ++length) {
    SCOPED_TRACE(length);
    write_file(path, content.substr(0, length));
    auto source = RecordingSource::open(path);
    if (!source) {
      ASSERT_EQ(most_samples, 0U);  // only before the first samples
      continue;
    }
    const auto read = read_all(**source);
    ASSERT_GE(read.size(), most_samples);
    most_samples = read.size();
    expect_same(read, first(read.size()));
    expect_honest((*source)->segments(), read.front().counter, read.back().counter);
    const RecordingDamage damage = (*source)->damage();
    ASSERT_FALSE(damage.complete);
    ASSERT_FALSE(damage.lost_data());
    ASSERT_EQ(damage.bytes_dropped, 0U);
    ASSERT_LE(damage.torn_tail_bytes, length);
    source->reset();

    // Reopened, the torn tail is gone and the rest can be written.
    auto writer = good(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::keep));
    ASSERT_EQ(writer->sample_count(), read.size());
    ASSERT_OK(writer->add(std::span(samples).subspan(read.size())));
    if (writer->open_segment()) {
      ASSERT_OK(writer->end_segment(SegmentKind::rotate, samples.back().counter + 1, {}));
    }
    ASSERT_OK(writer->finish());
    const auto whole = opened(path);
    expect_same(read_all(*whole), samples);
    ASSERT_EQ(describe(whole->damage()), "");
  }
  EXPECT_EQ(most_samples, samples.size());
}

TEST_F(DamageTest, DropAfterACutAtEveryByteEndsAtASegmentEnd) {
  for (std::size_t length = 300; length < content.size(); ++length) {
    SCOPED_TRACE(length);
    write_file(path, content.substr(0, length));
    auto writer = good(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::drop));
    const std::int64_t last = writer->segments().empty() ? 0 : writer->segments().back().end_sample;
    ASSERT_FALSE(writer->open_segment().has_value());
    ASSERT_EQ(writer->last_counter().value_or(-1) + 1, last);
  }
}

TEST_F(DamageTest, EveryFlippedBitCostsAtMostOneRecord) {
  for (std::size_t place = 0; place < content.size(); ++place) {
    for (int bit = 0; bit < 8; ++bit) {
      SCOPED_TRACE(testing::Message() << "byte " << place << " bit " << bit);
      std::string damaged = content;
      damaged[place] = char(damaged[place] ^ (1 << bit));
      write_file(path, damaged);
      const auto source = opened(path);
      const auto read = read_all(*source);
      ASSERT_GE(read.size() + chunk, samples.size());
      expect_subset(read);
      expect_honest(source->segments(), read.front().counter, read.back().counter);
      const RecordingDamage& damage = source->damage();
      if (damage.complete) {
        ASSERT_EQ(damage.records_dropped, 1U);
        ASSERT_GE(damage.bytes_dropped, record_overhead_bytes);
        ASSERT_EQ(damage.samples_dropped, samples.size() - read.size());
        ASSERT_EQ(damage.torn_tail_bytes, 0U);
      } else {
        // The end mark itself was hit: that looks like a capture that was interrupted.
        ASSERT_EQ(damage.records_dropped, 0U);
        ASSERT_EQ(read.size(), samples.size());
        ASSERT_EQ(damage.torn_tail_bytes, record_overhead_bytes + 8);
      }
      ASSERT_NE(describe(damage), "");
    }
  }
}

TEST_F(DamageTest, WhatIsMissingIsCountedAndWhatIsTooMuchCostsNothing) {
  // The last two samples records (there is one flag in them), and what stands behind them.
  const std::size_t two = 2 * (record_overhead_bytes + 20 + chunk * 28) + 8,
                    behind = (record_overhead_bytes + 8) + (record_overhead_bytes + 48), size = content.size();
  auto beyond = parts();  // a record again, and one of other samples, after the end mark
  beyond.push_back(beyond[2]);
  beyond.back().number += 100;
  beyond.push_back({std::uint32_t(RecordType::samples), 200, {}});
  append_samples(beyond.back().payload, make_samples(info, 5, 5000), info);
  const struct {
    const char* what;
    std::string bytes;
    std::size_t lost_records, dropped_bytes, torn_bytes;  // of bytes at least so many
    bool complete;
  } cases[] = {{"a block lost", content.substr(0, size - behind - two) + content.substr(size - behind), 2, 0, 0, true},
               {"garbage inside the spare copy of the first record",
                content.substr(0, 200) + std::string(5000, '\x89') + "\x89TCR" + content.substr(200), 1, 5001, 0, true},
               {"blocks of zeros, as after a power loss", content.substr(0, size - 300) + std::string(300 + 4096, '\0'),
                0, 0, 4097, false},
               {"records after the end mark", bytes_of(beyond), 0, 0, 1, true},
               {"all of it twice", content + content, 0, 0, size, true}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.what);
    const auto source = opened_with(c.bytes);
    const auto read = read_all(*source);
    expect_same(read, first(read.size()));
    const RecordingDamage& damage = source->damage();
    EXPECT_EQ(damage.complete, c.complete);
    EXPECT_EQ(damage.samples_dropped, c.complete ? samples.size() - read.size() : 0);
    EXPECT_LE(damage.records_dropped, c.lost_records);
    EXPECT_GE(damage.bytes_dropped, c.dropped_bytes);
    EXPECT_GE(damage.torn_tail_bytes, c.torn_bytes);
    if (&c != &cases[0]) continue;
    EXPECT_EQ(describe(damage), "2 damaged records dropped (0 bytes, 8 samples)");
    EXPECT_EQ(source->segments().back().end_sample, 24) << "the dwell is cut to what is left of it";
  }
}

// The dwell may have been one that had to be repeated: only its end record could have told. (Records: 2 info, 6 to 9 of the second segment,
// 10 the begin of the third.)
TEST_F(DamageTest, SegmentWithoutItsEndIsRotate) {
  const Segment unknown =
      make_segment(1, SegmentKind::rotate, 8, 16, 0, 0, 0);  // the angles of the segment before stand in
  const struct {
    std::vector<int> lost;
    Segments expected;
  } cases[] = {{{9}, segments}, {{9, 6}, {segments[0], unknown, segments[2]}}, {{10}, segments}};
  const std::vector<Part> whole = parts();
  for (const auto& [lost, expected] : cases) {
    auto told = whole;
    for (const int place : lost) told.erase(told.begin() + place);
    const auto source = opened_with(bytes_of(told));
    expect_same(source->segments(), expected);
    expect_same(read_all(*source), samples);
    EXPECT_EQ(source->damage().records_dropped, lost.size());
  }
}

TEST_F(DamageTest, BothFirstRecordsDestroyedIsAnError) {
  std::string damaged = content;
  damaged[30] = char(damaged[30] ^ 1);
  damaged[130] = char(damaged[130] ^ 1);
  write_file(path, damaged);
  EXPECT_ERROR(RecordingSource::open(path),
               path + ": not a recording of this program, or its first records are destroyed");
}

// Records whose checksums are right but whose content is not: a writer gone wrong, or somebody's intent.
TEST_F(DamageTest, RecordsThatLieAboutThemselves) {
  const std::vector<Part> truth = parts();
  std::mt19937 random(9);
  int readable = 0;
  for (int round = 0; round < 20000; ++round) {
    std::vector<Part> told = truth;
    std::vector<std::byte>& payload = told[random() % told.size()].payload;
    for (auto changes = 1 + random() % 3; changes > 0; --changes) {
      const std::size_t place = random() % std::min<std::size_t>(payload.size(), 48);
      payload[place] = random() % 2 == 0 ? static_cast<std::byte>(random()) : std::byte{0xFF};
    }
    if (random() % 8 == 0) payload.resize(random() % (payload.size() + 20));
    write_file(path, bytes_of(told));
    auto source = RecordingSource::open(path);
    if (!source) continue;
    std::int64_t last = std::numeric_limits<std::int64_t>::min();
    const Status status = (*source)->read([&](std::span<const ImuSample> block) {
      for (const ImuSample& sample : block) {
        if (sample.counter <= last) return Status(input_error("counters do not increase"));
        last = sample.counter;
      }
      return Status();
    });
    ASSERT_OK(status);
    const Segments& read = (*source)->segments();
    for (std::size_t i = 1; i < read.size(); ++i) ASSERT_EQ(read[i].start_sample, read[i - 1].end_sample);
    ++readable;
  }
  EXPECT_GT(readable, 15000);
}

}  // namespace
}  // namespace turncal
