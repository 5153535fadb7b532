// The record framing by itself: what the journal and the recording both rest on.
#include "imu_io/base/record_log.h"

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"
#include "tests/test.h"

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
  TemporaryFolder folder;
  write_file(folder / "log", content);
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

// The worked example of docs/files.md, byte for byte.
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
  EXPECT_EQ(hex, "89 54 43 52 05 00 00 00 47 05 00 00 08 00 00 00 f2 c3 ef 10 b0 5a 13 00 00 00 00 00 0a 22 6e 41 ");
}

TEST(RecordLog, RecordOfAnEarlierNumberIsNotTakenAgain) {
  const auto result = scanned(record(0, "a") + record(1, "b") + record(0, "old") + record(2, "c"));
  EXPECT_EQ(result.payloads, (std::vector<std::string>{"a", "b", "c"}));
  EXPECT_EQ(result.records_dropped, 0U);
  EXPECT_EQ(result.bytes_dropped, record(0, "old").size());
  std::string other = record(0, "a");
  other[1] = 'X';
  EXPECT_TRUE(scanned(other).payloads.empty()) << "another magic";
}

// Wherever the next record begins relative to the blocks of 1 MiB in which the file is read.
TEST(RecordLog, FindsTheNextRecordAfterGarbageOfAnyLength) {
  const std::string garbage(std::size_t{1} << 20, '\x89');
  for (int difference = -40; difference <= 40; ++difference) {
    std::string between = garbage;
    between.resize(std::size_t(int(garbage.size()) + difference), 'T');
    const auto result = scanned(record(0, "a") + between + record(1, "b"));
    ASSERT_EQ(result.payloads, (std::vector<std::string>{"a", "b"})) << difference;
    ASSERT_EQ(result.bytes_dropped, between.size());
  }
}

// ---- check values that are published, and the two ways to CRC-32C ----

std::uint32_t of(std::string_view text, const CrcParameters& parameters, std::size_t zeros = 0) {
  return Crc(parameters)(std::as_bytes(std::span(text.data(), text.size())), zeros);
}

// Check values of the catalogue of parametrised CRC algorithms (Cook), and of the units' manuals.
TEST(Crc, GivesThePublishedCheckValues) {
  EXPECT_EQ(of("123456789", {32, 0x04C11DB7, 0xFFFFFFFF, false, false, 0}), 0x0376E6E7U);         // CRC-32/MPEG-2
  EXPECT_EQ(of("123456789", {32, 0x04C11DB7, 0, true, true, 0}), 0x2DFD2D88U);                    // NovAtel
  EXPECT_EQ(of("123456789", {16, 0x1021, 0, false, false, 0}), 0x31C3U);                          // CRC-16/XMODEM
  EXPECT_EQ(of("123456789", {16, 0x1021, 0xFFFF, false, false, 0}), 0x29B1U);                     // CRC-16/IBM-3740
  EXPECT_EQ(of("123456789", {16, 0x8005, 0xFFFF, true, true, 0}), 0x4B37U);                       // CRC-16/MODBUS
  EXPECT_EQ(of("123456789", {32, 0x04C11DB7, 0xFFFFFFFF, true, true, 0xFFFFFFFF}), 0xCBF43926U);  // CRC-32
  EXPECT_EQ(of("123456789", {32, 0x1EDC6F41, 0xFFFFFFFF, true, true, 0xFFFFFFFF}), 0xE3069283U);  // CRC-32C
  EXPECT_EQ(of("123456789", {24, 0x864CFB, 0xB704CE, false, false, 0}), 0x21CF02U);               // CRC-24/OPENPGP
  EXPECT_EQ(of("123456789", {8, 0x07, 0, false, false, 0}), 0xF4U);                               // CRC-8/SMBUS
  EXPECT_EQ(of("123456789", {12, 0x80F, 0, false, true, 0}), 0xDAFU);                             // CRC-12/UMTS
}

TEST(Crc, PadsWithZeroBytesThatWereNotSent) {
  const CrcParameters mpeg2{32, 0x04C11DB7, 0xFFFFFFFF, false, false, 0};
  EXPECT_EQ(of("123456789", mpeg2, 3), of(std::string_view("123456789\0\0\0", 12), mpeg2));
}

std::vector<std::byte> bytes(std::size_t count, int (*value)(std::size_t)) {
  std::vector<std::byte> result(count);
  for (std::size_t i = 0; i < count; ++i) result[i] = static_cast<std::byte>(value(i));
  return result;
}

// The catalogue's check value and the four of RFC 3720, appendix B.4.
TEST(Crc32c, PublishedCheckValues) {
  EXPECT_EQ(crc32c(std::string_view("123456789")), 0xE3069283U);
  EXPECT_EQ(crc32c(bytes(32, [](std::size_t) { return 0; })), 0x8A9136AAU);
  EXPECT_EQ(crc32c(bytes(32, [](std::size_t) { return 0xFF; })), 0x62A8AB43U);
  EXPECT_EQ(crc32c(bytes(32, [](std::size_t i) { return int(i); })), 0x46DD794EU);
  EXPECT_EQ(crc32c(bytes(32, [](std::size_t i) { return int(31 - i); })), 0x113FDB5CU);
  EXPECT_EQ(crc32c(std::string_view("")), 0U);
}

TEST(Crc32c, InstructionAndTablesAgreeAtEveryLengthAndOffset) {
  std::mt19937 random(1);
  std::vector<std::byte> data(200);
  for (auto& byte : data) byte = static_cast<std::byte>(random());
  for (std::size_t offset = 0; offset < 9; ++offset) {
    for (std::size_t count = 0; count + offset <= data.size(); ++count) {
      const auto part = std::span<const std::byte>(data).subspan(offset, count);
      ASSERT_EQ(crc32c(part), crc32c_portable(part)) << offset << " " << count;
    }
  }
}

TEST(Crc32c, GoesOnFromWhatCameBefore) {
  const std::string_view text = "a turntable turns";
  for (std::size_t cut = 0; cut <= text.size(); ++cut)
    EXPECT_EQ(crc32c(text.substr(cut), crc32c(text.substr(0, cut))), crc32c(text));
}

}  // namespace
}  // namespace turncal
