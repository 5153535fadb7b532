// Modbus frames: numbers as registers, the requests of the driver, and what a simulated drive reads of them and answers. Pure
// functions.
//
// Source: Modbus Application Protocol 1.1b3; Modbus over Serial Line 1.02 (CRC-16: polynomial A001 reflected, initial FFFF, low
// byte first). Driver and twin share this code, so the tests use independent peers (tests/turntable_drivers/modbus).
// Functions 3, 4, 6 and 16; any other is answered with exception 1.
//
// A 32-bit value takes two registers and f64 four, at consecutive addresses. Word order: whether the highest or the lowest word comes first;
// it differs between makers. Byte swap: the two bytes of every register are also exchanged. Signed values are two's complement; f32 and
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

// REQUIRES: at least register_count(type) registers. NaN and infinity are returned unchanged.
double decode_words(std::span<const std::uint16_t> registers, WordType type, WordLayout layout);

// Encodes a value, rounded to a whole number (except f32 and f64). Empty: not finite, or out of the type's range.
std::optional<Words> encode_words(double value, WordType type, WordLayout layout);

// ---- frames ----

inline constexpr std::size_t tcp_header = 6;  // bytes before the unit

inline std::uint16_t word_at(std::string_view bytes, std::size_t at) {
  return std::uint16_t(static_cast<unsigned char>(bytes[at]) << 8 | static_cast<unsigned char>(bytes[at + 1]));
}

// Return the unit and PDU of a request.
std::string read_body(int unit, int function, int address, int count);
std::string write_body(int unit, int function, int address, std::span<const std::uint16_t> values);  // function 6 or 16
// Returns unit and PDU as sent: with a TCP header, else with the CRC.
std::string framed(std::string_view body, std::optional<std::uint16_t> transaction);

struct ModbusRequest {
  std::uint16_t transaction = 0;  // tcp only
  int unit = 0;
  int function = 0;
  int address = 0;
  int count = 0;                      // registers read or written
  std::vector<std::uint16_t> values;  // written
  bool well_formed = true;            // false: answer with exception 3
};

using Frame = std::vector<std::uint8_t>;

// Removes the next request from the front of `bytes` and returns it. Empty: not complete yet. Bytes that cannot begin a frame
// (RTU: wrong CRC) are dropped one by one.
std::optional<ModbusRequest> next_request(Frame& bytes, bool tcp);

Frame read_reply(const ModbusRequest& request, std::span<const std::uint16_t> values, bool tcp);
Frame write_reply(const ModbusRequest& request, bool tcp);
Frame exception_reply(const ModbusRequest& request, int exception, bool tcp);

}  // namespace turncal
