// The numbers of a move as registers: what the drive is told, and whether its registers can hold it and read it back. Pure functions.
#pragma once

#include <cstdint>
#include <vector>

#include "calib/types/status.h"
#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {

// Of one step of a list. An error: a number does not fit its type, or a rate or an acceleration rounds to nothing.
Result<std::vector<std::uint16_t>> words_of(const RegisterMap& map, const WriteStep& step, Axis axis,
                                            const Moves& moves);

// Whether the map's registers are wide enough for a move of this axis.
Status check_move(const RegisterMap& map, Axis axis, const Moves& moves);

}  // namespace turncal
