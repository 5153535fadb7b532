// One parameter over many calibrations: control limits of individuals and the capability index.
//
//   short-term sigma s = mean |x_i - x_(i-1)| / 1.128        (moving range of two, d2 = 1.128; ISO 7870-2)
//   control limits    mean -+ 3 s
//   Cpk = min(max - mean, mean - min) / (3 s), over the limits there are
//
// In the order of time. At least two values, or there are no limits; not enough of them to say much are not refused.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "orchestrator/station/verdict.h"

namespace turncal {

struct ControlChart {
  std::size_t count = 0;
  double mean = 0.0;
  std::optional<double> sigma;  // short-term; empty for fewer than two values
  std::optional<double> lower, upper;
  std::vector<std::size_t> outside;
  std::optional<double> cpk;  // empty without limits or without spread
};

ControlChart control_chart(std::span<const double> values, const Limit& limit);

}  // namespace turncal
