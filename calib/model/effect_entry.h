// What the entries of the catalogue are written with. Only the files of the catalogue include this: accel_effects.cpp,
// gyro_effects.cpp and, for what is of the whole unit, unit_effects.cpp.
#pragma once

#include "calib/model/attitude.h"
#include "calib/model/effects.h"

namespace turncal {

std::vector<EffectEntry> accel_effects();
std::vector<EffectEntry> gyro_effects();
std::vector<EffectEntry> unit_effects();

namespace effect_entry {

using Eigen::Vector3d;
using Out = Eigen::Ref<Eigen::Matrix3Xd>;

inline constexpr double g0 = standard_gravity_mps2;
inline constexpr double micro_g = 1e-6 * g0;

inline const std::vector<std::string_view> xyz = {"x", "y", "z"};
inline const std::vector<std::string_view> products = {"x_xy", "x_xz", "x_yz", "y_xy", "y_xz",
                                                       "y_yz", "z_xy", "z_xz", "z_yz"};
inline const std::vector<double> warm_up_taus_s = {60.0, 120.0, 240.0, 480.0, 960.0, 1920.0};
inline const std::vector<double> scale_warm_up_taus_s = {240.0, 960.0, 1920.0};
inline const std::vector<double> lag_taus_s = {300.0, 1200.0};

// Specific force in g, the unit in which accelerometer polynomials are stated.
inline Vector3d in_g(const BlockState& s) { return s.f_b / g0; }

inline double hours(const BlockState& s) { return s.time_s / 3600.0; }

// Diagonal effect on a triad: component k acts on axis k with a value of its own.
inline void diagonal(Out out, const Vector3d& value) {
  for (int k = 0; k < 3; ++k) out(k, k) = value[k];
}
// Full matrix: component 3 i + j puts value_j on axis i.
inline void full(Out out, const Vector3d& value) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out(i, 3 * i + j) = value[j];
}

}  // namespace effect_entry
}  // namespace turncal
