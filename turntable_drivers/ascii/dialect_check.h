// What a dialect must be able to say and be told, beyond what each of its keys is checked for: its status, the width of its columns, its own
// words. Pure functions.
#pragma once

#include "imu_io/base/key_value.h"
#include "turntable_drivers/ascii/dialect.h"

namespace turncal {

// Remembers in the file what a table could not work with.
void check_dialect(KeyValueFile& file, const Dialect& dialect);

}  // namespace turncal
