// Numbers as registers: vectors worked by hand, both word orders, both byte orders, and the borders of every type.
#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/table/table_description.h"

#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

namespace turncal {
namespace {

using V = std::vector<std::uint16_t>;
constexpr WordLayout high{true, false}, low{false, false}, high_swapped{true, true}, low_swapped{false, true};

V encoded(double value, WordType type, WordLayout layout) {
  const std::optional<Words> words = encode_words(value, type, layout);
  return words ? V(words->span().begin(), words->span().end()) : V{};
}

TEST(RegisterWords, SignAt7FFFAnd8000) {
  EXPECT_EQ(decode_words(V{0x7FFF}, WordType::s16, high), 32767.0);
  EXPECT_EQ(decode_words(V{0x8000}, WordType::s16, high), -32768.0);
  EXPECT_EQ(decode_words(V{0x8000}, WordType::u16, high), 32768.0);
  EXPECT_EQ(decode_words(V{0x0000, 0x7FFF}, WordType::s32, high), 32767.0);
  EXPECT_EQ(decode_words(V{0x0000, 0x8000}, WordType::s32, high), 32768.0);
  EXPECT_EQ(decode_words(V{0x7FFF, 0xFFFF}, WordType::s32, high), 2147483647.0);
  EXPECT_EQ(decode_words(V{0x8000, 0x0000}, WordType::s32, high), -2147483648.0);
  EXPECT_EQ(decode_words(V{0x8000, 0x0000}, WordType::u32, high), 2147483648.0);
  EXPECT_EQ(decode_words(V{0xFFFF, 0xFFFE}, WordType::s32, high), -2.0);
}

// 0x12345678 in the four orders that makers use, and 1.0f = 0x3F800000.
TEST(RegisterWords, OrderOfWordsAndBytes) {
  const double value = 0x12345678;
  EXPECT_EQ(encoded(value, WordType::u32, high), (V{0x1234, 0x5678}));
  EXPECT_EQ(encoded(value, WordType::u32, low), (V{0x5678, 0x1234}));
  EXPECT_EQ(encoded(value, WordType::u32, high_swapped), (V{0x3412, 0x7856}));
  EXPECT_EQ(encoded(value, WordType::u32, low_swapped), (V{0x7856, 0x3412}));
  EXPECT_EQ(encoded(1.0, WordType::f32, high), (V{0x3F80, 0x0000}));
  EXPECT_EQ(encoded(1.0, WordType::f32, low_swapped), (V{0x0000, 0x803F}));
  for (const WordLayout layout : {high, low, high_swapped, low_swapped}) {
    EXPECT_EQ(decode_words(encoded(value, WordType::u32, layout), WordType::u32, layout), value);
    EXPECT_EQ(decode_words(encoded(-1.5, WordType::f32, layout), WordType::f32, layout), -1.5);
    EXPECT_EQ(decode_words(encoded(-90001, WordType::s32, layout), WordType::s32, layout), -90001.0);
  }
  EXPECT_EQ(encoded(0x1234, WordType::u16, high_swapped), V{0x3412});
  EXPECT_EQ(decode_words(V{0x3412}, WordType::u16, low_swapped), 0x1234);
}

TEST(RegisterWords, WhatDoesNotFitIsNotSent) {
  EXPECT_EQ(encoded(32767.4, WordType::s16, high), V{0x7FFF});
  EXPECT_EQ(encoded(32768.0, WordType::s16, high), V{});
  EXPECT_EQ(encoded(-32768.0, WordType::s16, high), V{0x8000});
  EXPECT_EQ(encoded(-32769.0, WordType::s16, high), V{});
  EXPECT_EQ(encoded(-1.0, WordType::u16, high), V{});
  EXPECT_EQ(encoded(4294967295.0, WordType::u32, high), (V{0xFFFF, 0xFFFF}));
  EXPECT_EQ(encoded(4294967296.0, WordType::u32, high), V{});
  EXPECT_EQ(encoded(2147483648.0, WordType::s32, high), V{});
  EXPECT_EQ(encoded(std::nan(""), WordType::s32, high), V{});
  EXPECT_EQ(encoded(std::numeric_limits<double>::infinity(), WordType::f32, high), V{});
  EXPECT_TRUE(std::isnan(decode_words(V{0x7FC0, 0x0000}, WordType::f32, high)));
}

TEST(RegisterWords, WrapAt360) {
  EXPECT_EQ(unwrapped_deg(359.0, 1.0, 360.0), -1.0);
  EXPECT_EQ(unwrapped_deg(1.0, 359.0, 360.0), 361.0);
  EXPECT_EQ(unwrapped_deg(0.5, 719.5, 360.0), 720.5);
  EXPECT_EQ(unwrapped_deg(270.0, 0.0, 360.0), -90.0);
  EXPECT_EQ(unwrapped_deg(10.0, 12.0, 360.0), 10.0);
}

// pi is 400921FB 54442D18.
TEST(RegisterWords, NumbersOf64Bits) {
  EXPECT_EQ(decode_words(V{0x4009, 0x21FB, 0x5444, 0x2D18}, WordType::f64, high), 3.141592653589793);
  EXPECT_EQ(decode_words(V{0x2D18, 0x5444, 0x21FB, 0x4009}, WordType::f64, {false, false}), 3.141592653589793);
  EXPECT_EQ(decode_words(V{0x182D, 0x4454, 0xFB21, 0x0940}, WordType::f64, {false, true}), 3.141592653589793);
  const std::optional<Words> words = encode_words(-123456.789012345, WordType::f64, {false, true});
  ASSERT_TRUE(words);
  EXPECT_EQ(words->span().size(), 4u);
  EXPECT_EQ(decode_words(words->span(), WordType::f64, {false, true}), -123456.789012345);
  EXPECT_FALSE(encode_words(std::nan(""), WordType::f64, high));
}

}  // namespace
}  // namespace turncal
