#include "orchestrator/report/residual_table.h"

#include <limits>

namespace turncal {

std::vector<NumberColumn> residual_columns(const Diagnosis& diagnosis) {
  std::vector<NumberColumn> columns;
  const auto add = [&](const std::string& name, auto value) {
    NumberColumn& column = columns.emplace_back(NumberColumn{name, {}});
    for (const ResidualPoint& point : diagnosis.residuals) column.values.push_back(value(point));
  };
  const auto add_each = [&](const std::string& name, const char* const(&axes)[3], const std::string& unit,
                            Eigen::Vector3d ResidualPoint::*vector) {
    for (int k = 0; k < 3; ++k)
      add(name + axes[k] + unit, [vector, k](const ResidualPoint& point) { return (point.*vector)[k]; });
  };
  constexpr const char* const n[3] = {"north", "up", "east"};
  constexpr const char* const b[3] = {"x", "y", "z"};
  add("time_s", [](const ResidualPoint& point) { return point.time_s; });
  add("segment", [](const ResidualPoint& point) { return static_cast<double>(point.segment + 1); });
  add("since_rotation_s", [](const ResidualPoint& point) {
    const bool turned = point.since_rotation_s <= point.time_s;
    return turned ? point.since_rotation_s : std::numeric_limits<double>::quiet_NaN();
  });
  add("temperature_c", [](const ResidualPoint& point) { return point.temperature_c; });
  add_each("force_", b, "_mps2", &ResidualPoint::f_b_mps2);
  add_each("velocity_before_", n, "_mps", &ResidualPoint::velocity_before_mps);
  add_each("velocity_after_", n, "_mps", &ResidualPoint::velocity_after_mps);
  add_each("normalised_before_", n, "", &ResidualPoint::normalised_before);
  add_each("normalised_after_", n, "", &ResidualPoint::normalised_after);
  return columns;
}

}  // namespace turncal
