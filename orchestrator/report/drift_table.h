// What `turncal predict --navigate` prints: the free navigation that each sequence would allow, side by side.
#pragma once

#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "calib/prediction/predicted_drift.h"

namespace turncal {

// REQUIRES at least one column; each has at least one point.
void print_predicted_drift(const std::vector<std::pair<std::string, ExpectedDrift>>& columns, const DriftPlan& plan,
                           std::ostream& out);

}  // namespace turncal
