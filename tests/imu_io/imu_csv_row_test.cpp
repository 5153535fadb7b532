// Rows of imu.csv: the fast parser against the slow one, and what is written comes back.
#include "imu_io/recordings/imu_csv.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>

#include "recording_samples.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

// The fast row parser against the slow one on text that is nearly a row.
TEST(ImuCsvRow, FastAndSlowParserAgree) {
  std::mt19937 random(5);
  const auto parsers = [](IncrementKind gyro, bool temperature) {
    return ImuCsvParser("x", make_info(gyro, IncrementKind::pulses, temperature));
  };
  const std::string alphabet = "0123456789-+.e, \r,,,000111";
  int accepted = 0;
  for (int round = 0; round < 300000; ++round) {
    const bool temperature = random() % 2 == 0;
    const auto gyro = random() % 2 == 0 ? IncrementKind::pulses : IncrementKind::physical;
    const ImuCsvParser parser = parsers(gyro, temperature);
    std::string row = "12,0,-3,450,2147483647,96,-1";
    if (temperature) row += ",24.125";
    for (unsigned change = random() % 4; change > 0; --change)
      row[random() % row.size()] = alphabet[random() % alphabet.size()];
    std::string padded = row + "\n" + std::string(64, '7');
    const char* at = padded.data();
    ImuSample fast;
    ImuSample slow;
    if (!parser.parse_plain(at, fast)) continue;
    ++accepted;
    ASSERT_EQ(at, padded.data() + row.size() + 1);
    if (row.ends_with('\r')) row.pop_back();
    const Status status = parser.parse(row, 1, slow);
    ASSERT_TRUE(status.ok()) << row << ": " << status.error().message;
    ASSERT_TRUE(same(fast, slow)) << row;
  }
  EXPECT_GT(accepted, 50000);
}

TEST(ImuCsvRow, TemperaturesComeBackBitForBit) {
  const RecordingInfo info = make_info();
  const ImuCsvParser parser("x", info);
  std::mt19937 random(6);
  for (int round = 0; round < 200000; ++round) {
    ImuSample sample;
    sample.temperature_c = round % 2 == 0 ? std::bit_cast<float>(static_cast<std::uint32_t>(random()))
                                          : static_cast<float>(static_cast<int>(random() % 200000) - 50000) / 1000.0F;
    if (!std::isfinite(sample.temperature_c)) continue;
    std::string row;
    append_imu_row(row, sample, info);
    const std::string_view text(row.data(), row.size() - 1);
    ImuSample slow;
    ASSERT_OK(parser.parse(text, 1, slow));
    ASSERT_TRUE(same(slow, sample)) << row;
    row.append(64, '7');
    const char* at = row.data();
    ImuSample fast;
    if (parser.parse_plain(at, fast)) ASSERT_TRUE(same(fast, sample)) << row;
  }
}

}  // namespace
}  // namespace turncal
