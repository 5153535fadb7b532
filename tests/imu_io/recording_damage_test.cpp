// Damage to a binary recording: cut at every byte, every bit flipped, blocks lost. The rule under test: what is handed
// over was written, in order; a flipped bit costs one record; what is missing is reported.
#include "imu_io/base/record_log.h"
#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_writer.h"
#include "recording_samples.h"
#include "tests/test.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

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
      for (auto i = static_cast<std::size_t>(segment.start_sample); i < static_cast<std::size_t>(segment.end_sample);
           i += chunk) {
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
  void write_parts(const std::vector<Part>& parts) const {
    std::vector<std::byte> bytes;
    for (const Part& part : parts) {
      const std::size_t begun = begin_record(bytes, recording_magic, part.type, part.number);
      bytes.insert(bytes.end(), part.payload.begin(), part.payload.end());
      end_record(bytes, begun);
    }
    write_file(path, std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  }

  // What the file is taken for when this stands in it.
  std::unique_ptr<RecordingSource> opened_with(const std::string& bytes) const {
    write_file(path, bytes);
    return opened(path);
  }
  std::vector<ImuSample> first(std::size_t count) const {
    return {samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(count)};
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
      const auto original = std::find_if(segments.begin(), segments.end(), [&](const Segment& s) {
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
      damaged[place] = static_cast<char>(damaged[place] ^ (1 << bit));
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

TEST_F(DamageTest, LostBlockIsCountedByTheNumbersOfTheRecords) {
  // Take out the last two samples records (there is one flag in them), leaving no byte of them.
  const std::size_t two_records = 2 * (record_overhead_bytes + 20 + chunk * 28) + 8;
  const std::size_t at = content.size() - (record_overhead_bytes + 8) - (record_overhead_bytes + 48) - two_records;
  const auto source = opened_with(content.substr(0, at) + content.substr(at + two_records));
  EXPECT_EQ(read_all(*source).size(), samples.size() - 2 * chunk);
  EXPECT_EQ(source->damage().records_dropped, 2U);
  EXPECT_EQ(source->damage().bytes_dropped, 0U);
  EXPECT_EQ(source->damage().samples_dropped, 2 * chunk);
  EXPECT_EQ(describe(source->damage()), "2 damaged records dropped (0 bytes, 8 samples)");
  // The dwell is cut to what is left of it.
  EXPECT_EQ(source->segments().back().end_sample, 24);
}

TEST_F(DamageTest, InsertedGarbageCostsNothing) {
  const std::size_t at = 200;
  std::string inserted = content.substr(0, at);
  // At a record boundary or inside a record: here inside the spare copy of the first record.
  inserted += std::string(5000, '\x89') + "\x89TCR" + content.substr(at);
  const auto source = opened_with(inserted);
  expect_same(read_all(*source), samples);
  EXPECT_LE(source->damage().records_dropped, 1U);
  EXPECT_GT(source->damage().bytes_dropped, 5000U);
}

// After a power loss a file can have its length but not its last blocks.
TEST_F(DamageTest, TailOfZerosIsATornTail) {
  const std::size_t keep = content.size() - 300;
  const auto source = opened_with(content.substr(0, keep) + std::string(300 + 4096, '\0'));
  const auto read = read_all(*source);
  expect_same(read, first(read.size()));
  EXPECT_FALSE(source->damage().lost_data());
  EXPECT_GT(source->damage().torn_tail_bytes, 4096U);
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
    write_parts(told);
    const auto source = opened(path);
    expect_same(source->segments(), expected);
    expect_same(read_all(*source), samples);
    EXPECT_EQ(source->damage().records_dropped, lost.size());
  }
}

TEST_F(DamageTest, NothingAfterTheEndMarkIsRead) {
  auto told = parts();
  told.push_back(told[2]);
  told.back().number = told.back().number + 100;
  told.push_back({static_cast<std::uint32_t>(RecordType::samples), 200, {}});
  append_samples(told.back().payload, make_samples(info, 5, 5000), info);
  write_parts(told);
  const auto source = opened(path);
  expect_same(read_all(*source), samples);
  EXPECT_GT(source->damage().torn_tail_bytes, 0U);
  const auto twice = opened_with(content + content);
  expect_same(read_all(*twice), samples);
  EXPECT_EQ(twice->damage().torn_tail_bytes, content.size());
}

TEST_F(DamageTest, BothFirstRecordsDestroyedIsAnError) {
  std::string damaged = content;
  damaged[30] = static_cast<char>(damaged[30] ^ 1);
  damaged[130] = static_cast<char>(damaged[130] ^ 1);
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
    write_parts(told);
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
