// ModbusTurntable: drives behind Modbus TCP or RTU, wholly described by a RegisterMap. The driver is DescribedTurntable; this is the
// language of registers (turntable_drivers/table/table_codec.h), framed by modbus_frame.h:
//
// - A reply must come from the unit, be of the function, and have exactly the length or the address asked for; over TCP it must carry the
//   request's transaction number too (frames of earlier ones are skipped, whole ones that a gateway sends again are dropped). RTU has no
//   number by which a repeated reply could be told from a new one: bytes after a reply are trouble.
// - Several drives on the line are told apart by unit, and readings by their lengths (register_map.h).
// - Exceptions 5 and 6 (busy) and 10 and 11 (gateway) count as failures; 1 to 3 are mistakes of the map (kind input), 4 is a fault of
//   the drive.
// - commission() shows what scale, sign and word order give.
#pragma once

#include <atomic>

#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/table/described_turntable.h"

namespace turncal {

class ModbusTurntable : public DescribedTurntable {
 public:
  // The clock and the count must outlive the table.
  ModbusTurntable(const RegisterMap& map, const Clock& clock, const std::atomic<int>* stop_requests = nullptr);
};

}  // namespace turncal
