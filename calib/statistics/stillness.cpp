#include "calib/statistics/stillness.h"

#include <algorithm>
#include <vector>

#include "calib/statistics/median.h"

namespace turncal {

StillPart longest_still(std::span<const SixChannels> pieces, const SixChannels& noise, double outlier) {
  const std::size_t n = pieces.size();
  if (n < 5) return {0, n};
  SixChannels centre, limit;
  std::vector<double> values(n);
  for (int channel = 0; channel < 6; ++channel) {
    for (std::size_t k = 0; k < n; ++k) values[k] = pieces[k][channel];
    centre[channel] = median(values);
    for (std::size_t k = 0; k < n; ++k) values[k] = std::abs(pieces[k][channel] - centre[channel]);
    limit[channel] = outlier * std::max(1.4826 * median(values), noise[channel]);
  }
  StillPart best, now;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t from = k > 0 ? k - 1 : 0;
    const std::size_t to = std::min(k + 2, n);
    SixChannels mean = SixChannels::Zero();
    for (std::size_t j = from; j < to; ++j) mean += pieces[j];
    mean /= static_cast<double>(to - from);
    if (((mean - centre).abs() > limit).any()) {
      now = {k + 1, k + 1};
      continue;
    }
    now.end = k + 1;
    if (now.end - now.first > best.end - best.first) best = now;
  }
  return best;
}

}  // namespace turncal
