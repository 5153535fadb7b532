// What is true of a simulated unit, as the file truth.conf: the 24 keys of Table 1 in units of the parameter file, the
// effects that were switched on, and the temperature to which they are referred. For comparing an estimate with it.
#pragma once

#include <optional>
#include <string>

#include "calib/model/parameters.h"
#include "calib/types/status.h"

namespace turncal {

class Rig;

// reference_c: the temperature to which the estimate is referred (mean of the recording); nothing when none is measured.
std::string format_truth(const Rig& rig, std::optional<double> reference_c);

// The 24 keys of a truth file; further keys of the forms effect.*, outside.*, table.* and lot.* are allowed and skipped.
Result<ParameterVector> read_truth(const std::string& path);

}  // namespace turncal
