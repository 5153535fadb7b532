// What a register map makes of each operation, request by request (turntable_drivers/table/table_description.h). A pure function.
#pragma once

#include <vector>

#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

std::vector<TableRow> explain(const RegisterMap& map);

}  // namespace turncal
