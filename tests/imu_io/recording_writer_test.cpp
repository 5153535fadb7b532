// The writer of recordings: what it refuses, and how it goes on after an interruption.
#include "imu_io/recordings/recording_writer.h"

#include <sys/wait.h>
#include "tests/test.h"

#include "calib/statistics/clipping.h"
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

TEST_F(WriterTest, RefusesAnExistingFile) {
  write_file(path, "x");
  EXPECT_ERROR(RecordingWriter::create(path, info), path + ": cannot create: File exists");
}

TEST_F(WriterTest, RefusesSenselessInfo) {
  const auto refused = [&](auto change, const std::string& message) {
    RecordingInfo bad = info;
    change(bad);
    EXPECT_ERROR(RecordingWriter::create(path, bad), path + ": " + message);
    EXPECT_FALSE(path_exists(path));
  };
  refused([](RecordingInfo& i) { i.gravity_mps2 = 0; }, "gravity_mps2 = '0': expected a number between 9 and 11");
  refused([](RecordingInfo& i) { i.sample_period_s = 0; },
          "sample_period_s = '0': expected a number between 1e-05 and 10");
  refused([](RecordingInfo& i) { i.sample_period_s = -1; },
          "sample_period_s = '-1': expected a number between 1e-05 and 10");
  refused([](RecordingInfo& i) { i.latitude_deg = 90.5; },
          "latitude_deg = '90.5': expected a number between -90 and 90");
  refused([](RecordingInfo& i) { i.accel_pulse_mps = 0; },
          "accel_pulse_mps = '0': expected a number between 1e-09 and 10");
  refused([](RecordingInfo& i) { i.accel_pulse_mps = 1e-308; },
          "accel_pulse_mps = '1e-308': expected a number between 1e-09 and 10");
  for (const std::string& serial : {std::string(), std::string("A#1")}) {
    refused(
        [&](RecordingInfo& i) { i.unit_serial = serial; },
        "unit_serial '" + serial + "': expected a serial number of 1 to 200 bytes, printable characters without '#'");
  }
  refused([](RecordingInfo& i) { i.unit_serial = std::string(201, 'A'); },
          "unit_serial '" + std::string(60, 'A') +
              "'..., 201 bytes: expected a serial number of 1 to 200 bytes, printable characters without '#'");
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

TEST_F(WriterTest, NothingIsAcceptedAfterTheEnd) {
  auto writer = RecordingWriter::create(path, info);
  ASSERT_OK(writer->add(make_samples(info, 5)));
  ASSERT_OK(writer->finish());
  EXPECT_EQ(writer->sync().error().kind, ErrorKind::internal);
  EXPECT_ERROR(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::keep),
               path + ": this recording is finished: nothing can be added to it");
}

TEST_F(WriterTest, OneWriterAFile) {
  auto writer = RecordingWriter::create(path, info);
  EXPECT_ERROR(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::keep),
               path + ": in use by another process (" + std::to_string(::getpid()) + ")");
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

// A real kill -9 in mid-capture: what was synced is there, what follows is a prefix of what was sent.
TEST_F(ReopenTest, KilledProcessKeepsWhatWasSynced) {
  const auto many = make_samples(info, 200000, 0);
  int pipe_ends[2];
  ASSERT_EQ(::pipe(pipe_ends), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    auto writer = RecordingWriter::create(path, info);
    for (std::size_t i = 0; writer.ok() && i + 500 <= many.size(); i += 500) {
      if (!writer->add(std::span(many).subspan(i, 500)).ok() || !writer->sync().ok()) break;
      const std::size_t synced = i + 500;
      if (::write(pipe_ends[1], &synced, sizeof synced) != sizeof synced) break;
    }
    ::pause();
    ::_exit(0);
  }
  std::size_t synced = 0;
  while (synced < 5000) ASSERT_EQ(::read(pipe_ends[0], &synced, sizeof synced), static_cast<ssize_t>(sizeof synced));
  ASSERT_EQ(::kill(child, SIGKILL), 0);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  ::close(pipe_ends[0]);
  ::close(pipe_ends[1]);

  const auto source = opened(path);
  const auto read = read_all(*source);
  EXPECT_GE(read.size(), synced);
  expect_same(read, {many.begin(), many.begin() + std::ptrdiff_t(read.size())});
  EXPECT_FALSE(source->damage().lost_data());
  auto writer = good(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::keep));
  EXPECT_EQ(writer->sample_count(), read.size());
}

// ---- what may stand in a serial number ----

TEST(RecordingCheck, PlainTextIsPrintableUtf8) {
  for (const char* good :
       {"RLG-0042", "\xC3\xA4\xC3\xB6", "\xE5\x8D\x95\xE5\x85\x83 7", "\xF0\x9F\x9B\xB0", "a=b", "\xC2\xA0x"})
    EXPECT_TRUE(is_plain_text(good)) << good;
  for (const char* bad : {"",
                          " a",
                          "a ",
                          "a#b",
                          "a\tb",
                          "a\nb",
                          "a\x7F"
                          "b",
                          "\xC2\x80",
                          "a\xC2\x9B"
                          "31m",
                          "a\xC2\x9F",  // C1: U+009B begins an escape sequence
                          "\xFF",
                          "\x80",
                          "a\x9B"
                          "b",
                          "\xC3",
                          "\xE5\x8D",
                          "\xF0\x9F\x9B",  // no UTF-8, cut short
                          "\xC0\xAF",
                          "\xC1\xBF",
                          "\xE0\x80\xAF",
                          "\xF0\x80\x80\xAF",  // longer than need be
                          "\xED\xA0\x80",
                          "\xF4\x90\x80\x80",
                          "\xF5\x80\x80\x80",  // surrogate, beyond the last
                          "a\xE2\x80\xAE"
                          "b",
                          "a\xE2\x80\xA8"
                          "b",
                          "\xE2\x81\xA6",  // turns the writing, ends the line
                          "\xE2\x80\x8B",
                          "\xEF\xBB\xBFSN1",
                          "SN\xC2\xAD"
                          "1"})  // is not seen
    EXPECT_FALSE(is_plain_text(bad)) << quoted(bad);
}

TEST(RecordingCheck, WhatIsQuotedCanBePrinted) {
  EXPECT_EQ(quoted("a\xC2\x9B"
                   "31m\xFF\n\xC3\xA4"),
            "'a??31m??\xC3\xA4'");
}

// ---- recording damage ----

// Damage to a binary recording: cut at every byte, every bit flipped, blocks lost. The rule under test: what is handed
// over was written, in order; a flipped bit costs one record; what is missing is reported.

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
  told.push_back({std::uint32_t(RecordType::samples), 200, {}});
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
