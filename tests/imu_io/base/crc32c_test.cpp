#include "imu_io/base/crc.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace turncal {
namespace {

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
