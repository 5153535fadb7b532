// What a register map must be able to say, beyond what each of its keys is checked for: its status, and addresses that there are. Pure functions.
#pragma once

#include "imu_io/base/key_value.h"
#include "turntable_drivers/modbus/register_map.h"

namespace turncal {

// Remembers in the file what a table could not work with.
void check_map(KeyValueFile& file, const RegisterMap& map);

}  // namespace turncal
