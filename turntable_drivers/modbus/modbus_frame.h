// Modbus frames as bytes: requests as the driver makes them, and what a simulated drive reads of them and answers. Pure functions.
//
// Source: Modbus Application Protocol 1.1b3; Modbus over Serial Line 1.02 (CRC-16: polynomial A001 reflected, initial FFFF, low
// byte first). Both ends use them: that they are Modbus is shown by peers that nobody here wrote (tests/turntable_drivers/modbus).
// Functions 3, 4, 6 and 16; anything else is answered with exception 1.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace turncal {

inline constexpr std::size_t tcp_header = 6;  // before the unit

inline std::uint16_t word_at(std::string_view bytes, std::size_t at) {
  return static_cast<std::uint16_t>(static_cast<unsigned char>(bytes[at]) << 8 |
                                    static_cast<unsigned char>(bytes[at + 1]));
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
