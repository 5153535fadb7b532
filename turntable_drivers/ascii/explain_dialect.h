// What a dialect makes of each operation, sentence by sentence (turntable_drivers/table/table_description.h). A pure function.
#pragma once

#include <vector>

#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

std::vector<TableRow> explain(const Dialect& dialect);

}  // namespace turncal
