#include "orchestrator/line/run_rules.h"

#include <algorithm>
#include <cmath>

namespace turncal {

namespace {

using Stretch = std::span<const double>;

// At least `least` of them on one side beyond `level`.
bool on_one_side(Stretch z, double level, std::ptrdiff_t least) {
  return std::count_if(z.begin(), z.end(), [level](double v) { return v > level; }) >= least ||
         std::count_if(z.begin(), z.end(), [level](double v) { return v < -level; }) >= least;
}

bool goes_one_way(Stretch z) {
  const auto not_rising = [](double a, double b) { return a >= b; };
  const auto not_falling = [](double a, double b) { return a <= b; };
  return std::adjacent_find(z.begin(), z.end(), not_rising) == z.end() ||
         std::adjacent_find(z.begin(), z.end(), not_falling) == z.end();
}

bool goes_up_and_down(Stretch z) {
  for (std::size_t i = 2; i < z.size(); ++i) {
    if (!((z[i] - z[i - 1]) * (z[i - 1] - z[i - 2]) < 0.0)) return false;
  }
  return true;
}

bool all_within(Stretch z) {
  return std::all_of(z.begin(), z.end(), [](double v) { return std::abs(v) < 1.0; });
}

bool none_within_on_both_sides(Stretch z) {
  return std::all_of(z.begin(), z.end(), [](double v) { return std::abs(v) > 1.0; }) &&
         std::any_of(z.begin(), z.end(), [](double v) { return v > 0.0; }) &&
         std::any_of(z.begin(), z.end(), [](double v) { return v < 0.0; });
}

bool meets(std::size_t rule, Stretch z) {
  switch (rule) {
    case 1: return std::abs(z.front()) > 3.0;
    case 2: return on_one_side(z, 0.0, 9);
    case 3: return goes_one_way(z);
    case 4: return goes_up_and_down(z);
    case 5: return on_one_side(z, 2.0, 2);
    case 6: return on_one_side(z, 1.0, 4);
    case 7: return all_within(z);
    default: return none_within_on_both_sides(z);
  }
}

}  // namespace

std::vector<RunSignal> run_signals(std::span<const double> z) {
  std::vector<RunSignal> signals;
  for (std::size_t i = 0; i < z.size(); ++i) {
    for (std::size_t rule = 1; rule <= run_rules.size(); ++rule) {
      const std::size_t length = run_rules[rule - 1].stretch;
      if (i + 1 >= length && meets(rule, z.subspan(i + 1 - length, length))) signals.push_back({rule, i});
    }
  }
  return signals;
}

}  // namespace turncal
