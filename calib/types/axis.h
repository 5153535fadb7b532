// The three axes of the table and how they stack. C_nb = Ry(-H) Rz(P) Rx(R): heading outer, pitch middle, roll inner.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace turncal {

enum class Axis { heading = 0, pitch = 1, roll = 2 };
inline constexpr std::array<Axis, 3> all_axes = {Axis::heading, Axis::pitch, Axis::roll};
constexpr const char* to_string(Axis axis) {
  return axis == Axis::heading ? "heading" : axis == Axis::pitch ? "pitch" : "roll";
}

constexpr std::size_t index(Axis axis) { return std::size_t(axis); }

// One number per axis, indexed by Axis: degrees, deg/s or deg/s^2, as the name says.
struct AxisTriple {
  std::array<double, 3> value{};
  double& operator[](Axis axis) { return value[index(axis)]; }
  double operator[](Axis axis) const { return value[index(axis)]; }
  bool operator==(const AxisTriple&) const = default;
};

// Permutation of three axes with signs: how the axes of a unit lie in the body that it is mounted in.
//
// Written as three signed letters, "x, y, z" or "-z, y, x": the first names the unit's axis along the body's x axis (front), the second
// that along its y axis (up), the third that along its z axis (right). Body component k = sign[k] * unit component from[k].
struct AxisOrder {
  std::array<int, 3> from{0, 1, 2};
  std::array<int, 3> sign{1, 1, 1};
  bool operator==(const AxisOrder&) const = default;
};

// Parses "x, -z, +y"; none unless every letter occurs once.
inline std::optional<AxisOrder> axis_order(std::string_view text) {
  AxisOrder order;
  std::array<bool, 3> used{};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t comma = k < 2 ? text.find(',') : text.size();
    if (comma == std::string_view::npos) return {};
    std::string_view letter = text.substr(0, comma);
    text.remove_prefix(std::min(comma + 1, text.size()));
    while (letter.starts_with(' ')) letter.remove_prefix(1);
    while (letter.ends_with(' ')) letter.remove_suffix(1);
    order.sign[k] = letter.starts_with('-') ? -1 : 1;
    if (letter.starts_with('-') || letter.starts_with('+')) letter.remove_prefix(1);
    const std::size_t from = letter.size() == 1 ? std::string_view("xyz").find(letter[0]) : std::string_view::npos;
    if (from == std::string_view::npos || used[from]) return {};
    order.from[k] = int(from);
    used[from] = true;
  }
  return order;
}

inline std::string to_string(const AxisOrder& order) {
  std::string text;
  for (std::size_t k = 0; k < 3; ++k)
    text += std::string(k == 0 ? "" : ", ") + (order.sign[k] < 0 ? "-" : "") + "xyz"[order.from[k]];
  return text;
}

// Limits of one axis of the table. Degrees, deg/s, deg/s^2. Positions are cumulative, as everywhere in this project.
struct AxisLimits {
  double soft_min_deg = -540.0;
  double soft_max_deg = 540.0;
  double max_rate_degps = 100.0;
  double max_acceleration_degps2 = 100.0;
  // The cable's total winding from end to end: the largest minus the smallest cumulative angle a run may use.
  // 0: slip rings, no limit.
  double wrap_deg = 720.0;
};

}  // namespace turncal
