// The three axes of the table and how they stack. C_nb = Ry(-H) Rz(P) Rx(R): heading outer, pitch middle, roll inner.
#pragma once

#include <array>
#include <cstddef>

namespace turncal {

enum class Axis { heading = 0, pitch = 1, roll = 2 };
inline constexpr std::array<Axis, 3> all_axes = {Axis::heading, Axis::pitch, Axis::roll};
constexpr const char* to_string(Axis axis) {
  return axis == Axis::heading ? "heading" : axis == Axis::pitch ? "pitch" : "roll";
}

constexpr std::size_t index(Axis axis) { return static_cast<std::size_t>(axis); }

// One number an axis, indexed by Axis: degrees, deg/s or deg/s^2, as the name says.
struct AxisTriple {
  std::array<double, 3> value{};
  double& operator[](Axis axis) { return value[index(axis)]; }
  double operator[](Axis axis) const { return value[index(axis)]; }
  bool operator==(const AxisTriple&) const = default;
};

}  // namespace turncal
