// The record framing by itself: what the journal and the recording both rest on.
#include "imu_io/base/record_log.h"

#include <gtest/gtest.h>

#include <string>

#include "imu_io/base/bytes.h"
#include "tests/imu_io/temporary_folder.h"

namespace turncal {
namespace {

constexpr std::uint32_t magic = 0x4A435489;

std::string record(std::uint32_t number, const std::string& payload, std::uint32_t type = 7) {
  std::vector<std::byte> bytes;
  const std::size_t begun = begin_record(bytes, magic, type, number);
  append_bytes(bytes, std::string_view(payload));
  end_record(bytes, begun);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

struct Scanned {
  std::vector<std::string> payloads;
  std::uint64_t records_dropped = 0;
  std::uint64_t bytes_dropped = 0;
  std::uint64_t tail_bytes = 0;
};

Scanned scanned(const std::string& content) {
  test::TemporaryFolder folder;
  test::write_file(folder / "log", content);
  auto file = PosixFile::open_to_read(folder / "log");
  EXPECT_TRUE(file.ok());
  RecordScanner scanner(*file, content.size(), magic);
  Scanned result;
  Record found;
  for (auto more = scanner.next(found); more && *more; more = scanner.next(found)) {
    EXPECT_EQ(found.type, 7U);
    result.payloads.emplace_back(reinterpret_cast<const char*>(found.payload.data()), found.payload.size());
  }
  result.records_dropped = scanner.records_dropped();
  result.bytes_dropped = scanner.bytes_dropped();
  result.tail_bytes = scanner.tail_bytes();
  return result;
}

// The worked example of docs/recording-format.md, byte for byte.
TEST(RecordLog, WorkedExample) {
  std::vector<std::byte> bytes;
  const std::size_t begun = begin_record(bytes, 0x52435489, 5, 1351);
  append_bytes(bytes, std::uint64_t{1268400});
  end_record(bytes, begun);
  std::string hex;
  for (const std::byte byte : bytes) {
    hex += "0123456789abcdef"[std::to_integer<unsigned>(byte) >> 4];
    hex += "0123456789abcdef"[std::to_integer<unsigned>(byte) & 15];
    hex += ' ';
  }
  EXPECT_EQ(hex,
            "89 54 43 52 05 00 00 00 47 05 00 00 08 00 00 00 "
            "f2 c3 ef 10 "
            "b0 5a 13 00 00 00 00 00 0a 22 6e 41 ");
}

TEST(RecordLog, ReadsWhatWasWritten) {
  const auto result =
      scanned(record(0, "first") + record(1, "") + record(2, std::string(max_record_payload_bytes, 'x')));
  ASSERT_EQ(result.payloads.size(), 3U);
  EXPECT_EQ(result.payloads[0], "first");
  EXPECT_EQ(result.payloads[1], "");
  EXPECT_EQ(result.payloads[2].size(), max_record_payload_bytes);
  EXPECT_EQ(result.records_dropped + result.bytes_dropped + result.tail_bytes, 0U);
}

TEST(RecordLog, EmptyFileAndTornTail) {
  EXPECT_TRUE(scanned("").payloads.empty());
  const std::string torn = record(1, "second");
  for (std::size_t length = 0; length < torn.size(); ++length) {
    const auto result = scanned(record(0, "first") + torn.substr(0, length));
    ASSERT_EQ(result.payloads.size(), 1U);
    ASSERT_EQ(result.tail_bytes, length);
    ASSERT_EQ(result.records_dropped, 0U);
  }
}

TEST(RecordLog, GapInTheNumbersIsLostRecords) {
  const auto result = scanned(record(0, "a") + record(5, "b"));
  EXPECT_EQ(result.payloads.size(), 2U);
  EXPECT_EQ(result.records_dropped, 4U);
  EXPECT_EQ(result.bytes_dropped, 0U);
}

TEST(RecordLog, RecordOfAnEarlierNumberIsNotTakenAgain) {
  const auto result = scanned(record(0, "a") + record(1, "b") + record(0, "old") + record(2, "c"));
  EXPECT_EQ(result.payloads, (std::vector<std::string>{"a", "b", "c"}));
  EXPECT_EQ(result.records_dropped, 0U);
  EXPECT_EQ(result.bytes_dropped, record(0, "old").size());
}

// Wherever the next record begins relative to the blocks of 1 MiB in which the file is read.
TEST(RecordLog, FindsTheNextRecordAfterGarbageOfAnyLength) {
  const std::string garbage(std::size_t{1} << 20, '\x89');
  for (int difference = -40; difference <= 40; ++difference) {
    std::string between = garbage;
    between.resize(static_cast<std::size_t>(static_cast<int>(garbage.size()) + difference), 'T');
    const auto result = scanned(record(0, "a") + between + record(1, "b"));
    ASSERT_EQ(result.payloads, (std::vector<std::string>{"a", "b"})) << difference;
    ASSERT_EQ(result.bytes_dropped, between.size());
  }
}

TEST(RecordLog, OtherMagicIsNotRead) {
  std::string other = record(0, "a");
  other[1] = 'X';
  EXPECT_TRUE(scanned(other).payloads.empty());
}

}  // namespace
}  // namespace turncal
