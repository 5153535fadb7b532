// The codec for registers (turntable_drivers/table/table_codec.h): drives behind Modbus TCP or RTU that a RegisterMap describes, framed
// by modbus_frame.h:
//
// - A reply must come from the unit, have the function of the request, and exactly its length or address. Over TCP it must also carry the
//   request's transaction number; frames of earlier transactions are skipped, and complete repetitions by a gateway are dropped. RTU has no
//   number that tells a repeated reply from a new one: bytes after a reply are an error.
// - Several drives on the line differ by unit, and readings by their length (register_map.h).
// - Exceptions 5 and 6 (busy) and 10 and 11 (gateway) count as failures; 1 to 3 are errors of the map (kind input), 4 is a fault of
//   the drive.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/table/table_codec.h"

namespace turncal {

// Requests and replies on a line of registers to any device, by these rules.
class ModbusFraming {
 public:
  explicit ModbusFraming(bool header) : header_(header) {}
  std::string framed(const std::string& body);  // with the next transaction number, or a CRC
  std::optional<std::size_t> reply_end(const TableRequest& request, std::string& heard, bool at_once) const;
  // registers: receives those of a reading.
  Judgement judge(const TableRequest& request, const std::string& reply, std::string& heard,
                  std::vector<std::uint16_t>& registers) const;
  bool has_unexpected(std::string& heard) const;

 private:
  bool is_of_earlier(const std::string& frame) const;
  bool header_;
  std::uint16_t transaction_ = 0;
};

std::unique_ptr<TableCodec> codec_of(const RegisterMap& map);

}  // namespace turncal
