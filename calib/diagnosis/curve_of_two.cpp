#include "calib/diagnosis/curve_of_two.h"

#include <algorithm>
#include <cmath>

#include "calib/diagnosis/nameless_families.h"
#include "calib/model/limits.h"

namespace turncal {
namespace {

bool of_gyro(const EffectColumn& c) { return c.entry->name.starts_with("gyro_"); }
bool of_sensor(const EffectColumn& c) { return of_gyro(c) || c.entry->name.starts_with("accel_"); }
bool of_scale(const EffectColumn& c) { return c.entry->name.find("_scale_") != std::string_view::npos; }
int axis_of(const EffectColumn& c) { return c.entry->components[static_cast<std::size_t>(c.component)][0] - 'x'; }

bool of_one_axis(const EffectColumn& a, const EffectColumn& b) {
  return of_sensor(a) && of_sensor(b) && of_gyro(a) == of_gyro(b) && axis_of(a) == axis_of(b) &&
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
      const bool gyro = of_gyro(first), scale = of_scale(first) && of_scale(second);
      const DisturbedSensor sensor = gyro ? (scale ? DisturbedSensor::gyro_scale : DisturbedSensor::gyro_bias)
                                          : (scale ? DisturbedSensor::accel_scale : DisturbedSensor::accel_bias);
      const bool of_time = first.entry->of_one_run && second.entry->of_one_run;
      return {words_of(sensor, axis_of(first)) + (of_time ? " with time" : ""),
              first.key() + " and " + second.key() + " are one curve to the data, and it is in the name of neither"};
    }
  return {};
}

}  // namespace turncal
