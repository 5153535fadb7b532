// Check values that are published, and the two ways to CRC-32C.
#include <gtest/gtest.h>

#include <random>
#include <string_view>
#include <vector>

#include "imu_io/base/crc.h"

namespace turncal {
namespace {

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
  EXPECT_EQ(crc32c(bytes(32, [](std::size_t i) { return static_cast<int>(i); })), 0x46DD794EU);
  EXPECT_EQ(crc32c(bytes(32, [](std::size_t i) { return static_cast<int>(31 - i); })), 0x113FDB5CU);
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
