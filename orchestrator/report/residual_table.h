// The residuals of a diagnosis as columns of numbers, a row a second at rest (docs/report.md).
#pragma once

#include <vector>

#include "calib/diagnosis/diagnosis.h"
#include "imu_io/recordings/matrix_writer.h"

namespace turncal {

std::vector<NumberColumn> residual_columns(const Diagnosis& diagnosis);

}  // namespace turncal
