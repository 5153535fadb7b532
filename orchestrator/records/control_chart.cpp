#include "orchestrator/records/control_chart.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace turncal {

ControlChart control_chart(std::span<const double> values, const Limit& limit) {
  ControlChart chart;
  chart.count = values.size();
  if (values.empty()) return chart;
  chart.mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  if (values.size() < 2) return chart;
  double ranges = 0.0;
  for (std::size_t i = 1; i < values.size(); ++i) ranges += std::abs(values[i] - values[i - 1]);
  constexpr double d2 = 1.128;
  const double sigma = ranges / static_cast<double>(values.size() - 1) / d2;
  chart.sigma = sigma;
  chart.lower = chart.mean - 3.0 * sigma;
  chart.upper = chart.mean + 3.0 * sigma;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (values[i] < *chart.lower || values[i] > *chart.upper) chart.outside.push_back(i);
  }
  if ((!limit.min && !limit.max) || !(sigma > 0.0)) return chart;
  constexpr double far = std::numeric_limits<double>::infinity();
  chart.cpk =
      std::min(limit.max ? *limit.max - chart.mean : far, limit.min ? chart.mean - *limit.min : far) / (3.0 * sigma);
  return chart;
}

}  // namespace turncal
