// The middle of some numbers: the element at place size / 2 in order, so the upper of two middles. Rearranges them; one at least.
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <vector>

namespace turncal {

inline double median(std::vector<double>& values) {
  assert(!values.empty());
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace turncal
