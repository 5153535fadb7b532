#include "calib/diagnosis/unexplained.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/model/parameters.h"

namespace turncal {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Ref;
using Out = Ref<Matrix3Xd>;

constexpr double micro_g = 1e-6 * standard_gravity_mps2;
const std::vector<std::string_view> xyz = {"x", "y", "z"};
const std::vector<std::string_view> waves = {"x_sin", "y_sin", "z_sin", "x_cos", "y_cos", "z_cos"};

void step(const BlockState& s, double at, Out out) {
  if (s.time_s >= at)
    for (int k = 0; k < 3; ++k) out(k, k) = 1.0;
}
void wave(const BlockState& s, double period, Out out) {
  const double phase = 2.0 * pi * s.time_s / period;
  for (int k = 0; k < 3; ++k) {
    out(k, k) = std::sin(phase);
    out(k, 3 + k) = std::cos(phase);
  }
}
// tau carries the order of the harmonic
void angle_wave(const BlockState& s, int axis, double order, Out out) {
  for (int k = 0; k < 3; ++k) {
    out(k, k) = std::sin(order * s.table_rad[axis]);
    out(k, 3 + k) = std::cos(order * s.table_rad[axis]);
  }
}

// `tau_s` of a column is the time of the step, the period, or the order of the harmonic.
const std::vector<EffectEntry>& patterns() {
  static const std::vector<EffectEntry> entries = [] {
    std::vector<EffectEntry> e;
    const auto add = [&](std::string_view name, std::string_view unit, const std::vector<std::string_view>& components,
                         double si, auto write) {
      e.push_back({name, "", "", unit, components, si, "", write});
    };
    add("bias step of gyro", "deg/h", xyz, radps_per_degph,
        [](const BlockState& s, const Site&, double at, Out g, Out) { step(s, at, g); });
    add("bias step of accelerometer", "ug", xyz, micro_g,
        [](const BlockState& s, const Site&, double at, Out, Out a) { step(s, at, a); });
    add("periodic bias of gyro", "deg/h", waves, radps_per_degph,
        [](const BlockState& s, const Site&, double period, Out g, Out) { wave(s, period, g); });
    add("periodic bias of accelerometer", "ug", waves, micro_g,
        [](const BlockState& s, const Site&, double period, Out, Out a) { wave(s, period, a); });
    add("bias with the heading angle, gyro", "deg/h", waves, radps_per_degph,
        [](const BlockState& s, const Site&, double order, Out g, Out) { angle_wave(s, 0, order, g); });
    add("bias with the pitch angle, gyro", "deg/h", waves, radps_per_degph,
        [](const BlockState& s, const Site&, double order, Out g, Out) { angle_wave(s, 1, order, g); });
    add("bias with the roll angle, gyro", "deg/h", waves, radps_per_degph,
        [](const BlockState& s, const Site&, double order, Out g, Out) { angle_wave(s, 2, order, g); });
    // A unit that is another one in the next recording.
    add("scale factor of gyro", "ppm", xyz, 1e-6,
        [](const BlockState& s, const Site&, double, Out g, Out) { g.diagonal() = s.w_b; });
    add("scale factor of accelerometer", "ppm", xyz, 1e-6,
        [](const BlockState& s, const Site&, double, Out, Out a) { a.diagonal() = s.f_b; });
    add("bias that remembers which way up accelerometer was", "ug", xyz, micro_g,
        [](const BlockState& s, const Site&, double, Out, Out a) {
          for (int k = 0; k < 3; ++k) a(k, k) = s.last_up[k];
        });
    return e;
  }();
  return entries;
}

constexpr int steps_in_run = 12;

double length_s(const CompressedRecording& recording) {
  if (recording.blocks.empty()) return 0.0;
  const Block& last = recording.blocks.back();
  return static_cast<double>(last.start_sample - recording.blocks.front().start_sample) *
             recording.info.sample_period_s +
         last.duration_s;
}

}  // namespace

std::vector<EffectColumn> refined(const EffectColumn& column, const std::vector<const CompressedRecording*>& parts) {
  std::vector<EffectColumn> columns;
  const bool step = column.entry->name.starts_with("bias step");
  if (!depends_on_time_only(column)) return columns;
  const double spacing = length_s(*parts[static_cast<std::size_t>(column.recording)]) / steps_in_run;
  for (int k = -(refined_values / 2); k <= refined_values / 2; ++k) {
    columns.push_back(column);
    columns.back().tau_s = step ? column.tau_s + k * spacing / 8.0 : column.tau_s * std::pow(1.06, k);
  }
  return columns;
}

std::vector<EffectColumn> pattern_columns(const std::vector<const CompressedRecording*>& parts) {
  std::vector<EffectColumn> columns;
  for (const EffectEntry& entry : patterns()) {
    const auto add = [&](const std::vector<double>& values, int recording) {
      for (const double value : values)
        for (int k = 0; k < static_cast<int>(entry.components.size()); ++k)
          columns.push_back({&entry, k, value, recording});
    };
    if (entry.name.starts_with("scale factor")) {
      for (std::size_t of = 1; of < parts.size(); ++of) add({1.0}, static_cast<int>(of));
      continue;
    }
    if (!depends_on_time_only({&entry})) {
      add(entry.name.starts_with("bias with") ? std::vector{1.0, 2.0} : std::vector{1.0}, -1);
      continue;
    }
    for (std::size_t of = 0; of < parts.size(); ++of) {
      const double length = length_s(*parts[of]);
      std::vector<double> values;
      if (length > 0.0 && entry.name.starts_with("bias step"))
        for (int k = 1; k < steps_in_run; ++k) values.push_back(length * k / steps_in_run);
      else if (length > 0.0)
        for (const double cycles : {1.0, 1.7, 3.0, 5.0}) values.push_back(length / cycles);
      add(values, static_cast<int>(of));
    }
  }
  return columns;
}

bool depends_on_time_only(const EffectColumn& pattern) {
  return pattern.entry->name.starts_with("bias step") || pattern.entry->name.starts_with("periodic");
}

bool is_pattern(const EffectColumn& column) {
  const std::vector<EffectEntry>& all = patterns();
  return std::any_of(all.begin(), all.end(), [&](const EffectEntry& e) { return &e == column.entry; });
}

std::string describe_pattern(const EffectColumn& column) {
  const std::string axis(1, column.entry->components[static_cast<std::size_t>(column.component)][0]);
  std::string text = std::string(column.entry->name) + " " + axis;
  char tail[64] = "";
  if (column.entry->name.starts_with("bias step"))
    std::snprintf(tail, sizeof tail, " at about %.0f s", column.tau_s);
  else if (column.entry->name.starts_with("periodic"))
    std::snprintf(tail, sizeof tail, ", period about %.0f s", column.tau_s);
  else if (column.entry->name.starts_with("bias with"))
    std::snprintf(tail, sizeof tail, ", harmonic %.0f", column.tau_s);
  return text + tail + (column.recording > 0 ? " of recording " + std::to_string(column.recording + 1) : "");
}

}  // namespace turncal
