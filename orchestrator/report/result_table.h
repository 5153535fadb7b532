// The result of a calibration as a table for people: the 24 parameters with unit and, where they are known, standard deviation,
// truth, error and error in standard deviations.
#pragma once

#include <optional>
#include <ostream>

#include "calib/model/parameters.h"
#include "imu_io/recordings/parameter_file.h"

namespace turncal {

void print_results(const ParameterFile& file, const std::optional<ParameterVector>& truth, std::ostream& out);

}  // namespace turncal
