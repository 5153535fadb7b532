#include "imu_io/base/format_number.h"

#include <gtest/gtest.h>

#include <bit>
#include <limits>
#include <random>

namespace turncal {
namespace {

TEST(FormatNumber, WritesWhatPeopleWrite) {
  EXPECT_EQ(format_number(0.005), "0.005");
  EXPECT_EQ(format_number(0.0005), "0.0005");
  EXPECT_EQ(format_number(9.7914), "9.7914");
  EXPECT_EQ(format_number(-90.0), "-90");
  EXPECT_EQ(format_number(100000.0), "100000");
  EXPECT_EQ(format_number(0.1 + 0.2), "0.30000000000000004");
  EXPECT_EQ(format_number(1.5e-7), "1.5e-07");
  EXPECT_EQ(format_number(0.0), "0");
  EXPECT_EQ(format_number(-0.0), "-0");
  EXPECT_EQ(format_number(std::int64_t{-12}), "-12");
  EXPECT_EQ(format_number(29.573F), "29.573");
}

template <class T, class Bits>
void every_bit_pattern_comes_back(unsigned seed) {
  std::mt19937_64 random(seed);
  for (int i = 0; i < 200000; ++i) {
    const T value = std::bit_cast<T>(static_cast<Bits>(random()));
    if (!std::isfinite(value)) continue;
    NumberBuffer buffer;
    const auto back = parse_number<T>(format_number(value, buffer));
    ASSERT_TRUE(back.has_value());
    ASSERT_EQ(std::bit_cast<Bits>(*back), std::bit_cast<Bits>(value));
  }
}
TEST(FormatNumber, RandomDoublesComeBackBitForBit) { every_bit_pattern_comes_back<double, std::uint64_t>(1); }
TEST(FormatNumber, RandomFloatsComeBackBitForBit) { every_bit_pattern_comes_back<float, std::uint32_t>(2); }

TEST(FormatNumber, ExtremesComeBack) {
  using Limits = std::numeric_limits<double>;
  for (const double x : {Limits::denorm_min(), -Limits::denorm_min(), Limits::min(), Limits::max(), Limits::lowest(),
                         Limits::epsilon(), -0.0, 1e-4, 9.999999999999999e-5, 1e15, 999999999999999.9}) {
    const auto back = parse_number(format_number(x));
    ASSERT_TRUE(back.has_value()) << x;
    EXPECT_EQ(std::bit_cast<std::uint64_t>(*back), std::bit_cast<std::uint64_t>(x));
  }
}

TEST(ParseNumber, WholeTokenAndFinite) {
  EXPECT_EQ(parse_number("1e3"), 1000.0);
  EXPECT_EQ(parse_number("-.5"), -0.5);
  for (const char* text :
       {"", " 1", "1 ", "+1", "1,0", "1.0x", "0x10", "nan", "inf", "-inf", "infinity", "1e999", "e5", "-"})
    EXPECT_FALSE(parse_number(text).has_value()) << text;
}

TEST(ParseInteger, WholeTokenAndRange) {
  EXPECT_EQ(parse_integer("-7"), -7);
  EXPECT_EQ(parse_integer<int>("2147483647"), 2147483647);
  for (const char* text : {"", "1.0", " 1", "1 ", "+1", "9223372036854775808", "1e3"})
    EXPECT_FALSE(parse_integer(text).has_value()) << text;
  EXPECT_FALSE(parse_integer<int>("2147483648").has_value());
  EXPECT_FALSE(parse_integer<unsigned>("-1").has_value());
}

}  // namespace
}  // namespace turncal
