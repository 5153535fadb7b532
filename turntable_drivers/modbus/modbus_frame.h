// Modbus frames as bytes, for the simulated drive: what a request says, what an answer looks like. Pure functions.
//
// Source: Modbus Application Protocol 1.1b3; Modbus over Serial Line 1.02 (CRC-16: polynomial A001 reflected, initial FFFF, low
// byte first). Written without libmodbus, which the driver uses, so that a mistake of one shows in the other.
// Functions 3, 4, 6 and 16; anything else is answered with exception 1.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace turncal {

using Frame = std::vector<std::uint8_t>;

std::uint16_t modbus_crc(std::span<const std::uint8_t> bytes);

struct ModbusRequest {
  std::uint16_t transaction = 0;  // tcp only
  int unit = 0;
  int function = 0;
  int address = 0;
  int count = 0;                      // registers read or written
  std::vector<std::uint16_t> values;  // written
  bool well_formed = true;            // false: to be answered with exception 3
};

// The next request at the front of `bytes`, which it is taken off. Empty: not complete yet. Bytes that cannot begin a frame
// (RTU: CRC wrong) are dropped one by one.
std::optional<ModbusRequest> next_request(std::vector<std::uint8_t>& bytes, bool tcp);

Frame read_reply(const ModbusRequest& request, std::span<const std::uint16_t> values, bool tcp);
Frame write_reply(const ModbusRequest& request, bool tcp);
Frame exception_reply(const ModbusRequest& request, int exception, bool tcp);

}  // namespace turncal
