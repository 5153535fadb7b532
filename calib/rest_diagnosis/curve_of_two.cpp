#include "calib/rest_diagnosis/curve_of_two.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"

namespace turncal {
namespace {

int axis_of(const EffectColumn& c) { return c.entry->components[static_cast<std::size_t>(c.component)][0] - 'x'; }

bool of_one_axis(const EffectColumn& a, const EffectColumn& b) {
  return a.entry->sensor != Sensor::earth_rate && a.entry->sensor == b.entry->sensor && axis_of(a) == axis_of(b) &&
         a.recording == b.recording;
}

bool against(const Eigen::Matrix2d& G, const Eigen::Vector2d& value) {
  const double a = value[0] * value[0] * G(0, 0), b = value[1] * value[1] * G(1, 1);
  constexpr SelectionLimits limits;
  return std::abs(G(0, 1)) > limits.alias_correlation * std::sqrt(G(0, 0) * G(1, 1)) &&
         std::min(a, b) > limits.against_each_other * limits.against_each_other * value.dot(G * value);
}

}  // namespace

CurveOfTwo curve_of_two(const std::vector<EffectColumn>& columns, const Eigen::VectorXd& values,
                        const std::function<Eigen::Matrix2d(int, int)>& information) {
  for (int b = 1; b < static_cast<int>(columns.size()); ++b)
    for (int a = 0; a < b; ++a) {
      const EffectColumn &first = columns[static_cast<std::size_t>(a)], &second = columns[static_cast<std::size_t>(b)];
      if (!of_one_axis(first, second) || !against(information(a, b), {values[a], values[b]})) continue;
      const Quantity quantity =
          first.entry->quantity == second.entry->quantity ? first.entry->quantity : Quantity::bias;
      const bool of_time = first.entry->of_one_run && second.entry->of_one_run;
      return {std::string(to_string(quantity)) + " of " + std::string(to_string(first.entry->sensor)) + " " +
                  "xyz"[axis_of(first)] + (of_time ? " with time" : ""),
              first.key() + " and " + second.key() + " are one curve to the data, and it is in the name of neither"};
    }
  return {};
}

}  // namespace turncal
