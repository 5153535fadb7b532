// Modbus as bytes: numbers as registers, requests as the driver makes them, and what a simulated drive reads of them and answers. Pure
// functions.
//
// Source: Modbus Application Protocol 1.1b3; Modbus over Serial Line 1.02 (CRC-16: polynomial A001 reflected, initial FFFF, low
// byte first). Both ends use them: that they are Modbus is shown by peers that nobody here wrote (tests/turntable_drivers/modbus).
// Functions 3, 4, 6 and 16; anything else is answered with exception 1.
//
// A 32-bit value takes two registers, f64 four, in the order of their addresses. Word order: whether the highest or the lowest comes first;
// it differs between makers. Byte swap: the two bytes of every register are exchanged as well. Signed values are two's complement; f32 and
// f64 are IEEE 754.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/text.h"

namespace turncal {

enum class WordType { u16, s16, u32, s32, f32, f64 };
constexpr int register_count(WordType type) {
  return type == WordType::u16 || type == WordType::s16 ? 1 : type == WordType::f64 ? 4 : 2;
}
constexpr bool is_floating(WordType type) { return type == WordType::f32 || type == WordType::f64; }
template <>
inline constexpr auto enum_words<WordType> = std::to_array({"u16", "s16", "u32", "s32", "f32", "f64"});

struct WordLayout {
  bool high_word_first = true;
  bool swap_bytes = false;
};

struct Words {
  std::array<std::uint16_t, 4> value{};
  int count = 0;
  std::span<const std::uint16_t> span() const { return {value.data(), std::size_t(count)}; }
};

// REQUIRES: at least register_count(type) registers. NaN and infinity come back as they are.
double decode_words(std::span<const std::uint16_t> registers, WordType type, WordLayout layout);

// Rounded to the nearest whole number (not f32 and f64). Empty: not finite, or beyond the type.
std::optional<Words> encode_words(double value, WordType type, WordLayout layout);

// ---- frames ----

inline constexpr std::size_t tcp_header = 6;  // before the unit

inline std::uint16_t word_at(std::string_view bytes, std::size_t at) {
  return std::uint16_t(static_cast<unsigned char>(bytes[at]) << 8 | static_cast<unsigned char>(bytes[at + 1]));
}

// Unit and PDU of a request.
std::string read_body(int unit, int function, int address, int count);
std::string write_body(int unit, int function, int address, std::span<const std::uint16_t> values);  // 6 or 16
// Unit and PDU as they go over the wire: over TCP behind a header, else with the CRC.
std::string framed(std::string_view body, std::optional<std::uint16_t> transaction);

struct ModbusRequest {
  std::uint16_t transaction = 0;  // tcp only
  int unit = 0;
  int function = 0;
  int address = 0;
  int count = 0;                      // registers read or written
  std::vector<std::uint16_t> values;  // written
  bool well_formed = true;            // false: to be answered with exception 3
};

using Frame = std::vector<std::uint8_t>;

// The next request at the front of `bytes`, which it is taken off. Empty: not complete yet. Bytes that cannot begin a frame
// (RTU: CRC wrong) are dropped one by one.
std::optional<ModbusRequest> next_request(Frame& bytes, bool tcp);

Frame read_reply(const ModbusRequest& request, std::span<const std::uint16_t> values, bool tcp);
Frame write_reply(const ModbusRequest& request, bool tcp);
Frame exception_reply(const ModbusRequest& request, int exception, bool tcp);

}  // namespace turncal
