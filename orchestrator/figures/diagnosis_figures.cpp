#include "orchestrator/figures/diagnosis_figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "calib/model/effects.h"
#include "calib/statistics/numerics.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/number_text.h"

namespace turncal {
namespace {

constexpr std::size_t points_a_curve = 3000;

// A few branches that a fault has thrown far out must not flatten all others: then the frame is three times what 97 % need.
double frame_limit(const Panel& panel, bool& cut) {
  std::vector<double> sizes;
  for (const Series& series : panel.series)
    for (const auto& [x, y] : series.points)
      if (std::isfinite(x) && std::isfinite(y)) sizes.push_back(std::abs(y));
  if (sizes.empty()) return 0.0;
  const auto place = sizes.begin() + std::ptrdiff_t(0.97 * double(sizes.size() - 1));
  std::nth_element(sizes.begin(), place, sizes.end());
  const double limit = 3.0 * *place;
  if (*std::max_element(place, sizes.end()) <= limit || limit <= 0.0) return 0.0;
  cut = true;
  return limit;
}

}  // namespace

std::vector<const EstimatedEffect*> components_of(const JointResult& result, std::string_view effect) {
  std::vector<const EstimatedEffect*> found;
  for (const EstimatedEffect& e : result.effects)
    if (e.column.entry != nullptr && e.column.entry->name == effect) found.push_back(&e);
  return found;
}

std::vector<const EstimatedEffect*> strongest_of(const JointResult& result, std::string_view effect) {
  std::vector<const EstimatedEffect*> found = components_of(result, effect);
  std::ranges::stable_sort(found, [](auto* a, auto* b) { return z_of(*a) > z_of(*b); });
  return found;
}

Series axis_series(std::size_t axis) {
  constexpr std::array styles = {Series::Style::dot, Series::Style::triangle, Series::Style::square};
  constexpr std::array colours = {Colour::x, Colour::y, Colour::z};
  return {body_names[axis], styles[axis], colours[axis], {}};
}

std::vector<Series> before_after_series(bool with_after) {
  std::vector<Series> series(with_after ? 2 : 1);
  series[0].colour = with_after ? Colour::before : Colour::after;
  series[0].label = with_after ? "before (24 parameters)" : "residual";
  if (with_after) {
    series[1].colour = Colour::after;
    series[1].label = "after (with the effects added)";
  }
  return series;
}

Figure time_figure(const Diagnosis& diagnosis) {
  Figure figure{
      "time", "Residual velocity against time, north, up and east",
      "The unit stands still in every second shown: any velocity is an error. It is navigated freely from "
      "the beginning of the last rotation on; every rotation starts a new branch, which is shown for two minutes."};
  figure.panel_height = 185;
  figure.stacked = true;
  std::vector<std::pair<std::size_t, std::size_t>> parts = rests(diagnosis.residuals);
  std::erase_if(parts, [&](const auto& part) { return before_any_rotation(diagnosis.residuals[part.first]); });
  for (auto& [first, last] : parts)
    while (last > first && diagnosis.residuals[last - 1].time_s - diagnosis.residuals[first].time_s > fit_window_s)
      --last;
  double largest = 0.0;
  for (const auto& [first, last] : parts)
    for (std::size_t i = first; i < last; ++i) {
      const ResidualPoint& p = diagnosis.residuals[i];
      largest =
          std::max({largest, p.velocity_before_mps.cwiseAbs().maxCoeff(), p.velocity_after_mps.cwiseAbs().maxCoeff()});
    }
  const DisplayUnit unit = velocity_unit(largest);
  bool cut = false;
  for (int axis = 0; axis < 3; ++axis) {
    Panel panel;
    panel.y_label = std::string(n_names[std::size_t(axis)]) + ", " + unit.unit;
    if (axis == 2) panel.x_label = "time, h";
    panel.series = before_after_series(has_after(diagnosis));
    for (std::size_t s = 0; s < panel.series.size(); ++s) {
      std::vector<std::pair<double, double>> points;
      for (const auto& [first, last] : parts) {
        for (std::size_t i = first; i < last; ++i) {
          const ResidualPoint& p = diagnosis.residuals[i];
          points.emplace_back(p.time_s / 3600.0,
                              (s == 0 ? p.velocity_before_mps : p.velocity_after_mps)[axis] * unit.factor);
        }
        points.emplace_back(no_point, no_point);
      }
      panel.series[s].points = outline(points, points_a_curve);
    }
    panel.y_limit = frame_limit(panel, cut);
    figure.panels.push_back(std::move(panel));
  }
  if (figure.panels.front().empty()) figure.panels.clear();
  if (cut) figure.caption += " Single branches, as after a fault in the data, leave the frame.";
  return figure;
}

void mark_steps(const CompressedRecording& recording, Figure& figure) {
  double unit_s = 0.0;  // of the axis; stacked panels share one
  for (Panel& panel : figure.panels) {
    if (panel.x_label == "time, h") unit_s = 3600.0;
    if (panel.x_label == "time, min") unit_s = 60.0;
  }
  if (unit_s == 0.0 || recording.blocks.empty()) return;
  const std::int64_t first_sample = recording.blocks.front().start_sample;
  std::vector<std::pair<double, std::string>> marks;
  int step = 0;
  for (const Segment& segment : recording.segments) {
    if (segment.step == step) continue;
    step = segment.step;
    marks.emplace_back(double(segment.start_sample - first_sample) * recording.info.sample_period_s / unit_s,
                       std::to_string(step));
  }
  if (marks.size() < 2) return;
  for (Panel& panel : figure.panels) {
    const bool of_time = panel.x_label.starts_with("time, ");
    if (of_time || figure.stacked) panel.marks = marks;
  }
  figure.caption += " Thin lines: where the steps of the sequence begin.";
}

Figure allan_figure(const AllanResult& allan, const AllanResult* other) {
  Figure figure{
      "allan", "Allan deviation of the six sensors with the fitted model",
      "Markers: overlapping Allan deviation of all rests, with 68 % intervals. Lines: the terms of IEEE 952 that the "
      "data show, where the noise is of this model."};
  if (other != nullptr) figure.caption += " Open circles: what it is compared with.";
  figure.columns = 2;
  figure.panel_width = 480;
  figure.panel_height = 330;
  for (const bool gyro : {true, false}) {
    const DisplayUnit unit =
        gyro ? DisplayUnit{1.0 / radps_per_degph, "°/h"} : DisplayUnit{1e6 / standard_gravity_mps2, "µg"};
    Panel panel;
    panel.title = gyro ? "gyros" : "accelerometers";
    panel.x_label = "averaging time τ, s";
    panel.y_label = "Allan deviation, " + unit.unit;
    panel.logarithmic = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const AllanAxis& a = allan.axes[axis + (gyro ? 0 : 3)];
      Series markers = axis_series(axis);
      Series line, intervals, beside;
      line.colour = intervals.colour = beside.colour = markers.colour;
      beside.style = Series::Style::open_circle;
      for (const AllanPoint& p : a.points) {
        if (!(p.deviation > 0.0) || !(p.tau_s > 0.0)) continue;
        markers.points.emplace_back(p.tau_s, p.deviation * unit.factor);
        const bool fitted = !a.fit.cut || 2.0 * p.tau_s * a.fit.highest_hz >= 1.0;
        if (const double variance = allan_variance(a.fit, p.tau_s); fitted && variance > 0.0)
          line.points.emplace_back(p.tau_s, std::sqrt(variance) * unit.factor);
        if (!(p.low > 0.0)) continue;
        for (const double end : {p.low, p.high}) intervals.points.emplace_back(p.tau_s, end * unit.factor);
        intervals.points.emplace_back(no_point, no_point);
      }
      if (other != nullptr)
        for (const AllanPoint& p : other->axes[axis + (gyro ? 0 : 3)].points)
          beside.points.emplace_back(p.tau_s, p.deviation * unit.factor);
      for (Series* series : {&line, &intervals, &beside, &markers}) panel.series.push_back(std::move(*series));
    }
    if (!panel.empty()) figure.panels.push_back(std::move(panel));
  }
  return figure;
}

double family_threshold_z(const Diagnosis& diagnosis, double false_alarm) {
  const auto visible = std::ranges::count_if(diagnosis.candidates, [](const CandidateScore& c) { return c.visible; });
  return std::sqrt(chi_square_1_limit(false_alarm / double(std::max<std::ptrdiff_t>(visible, 1))));
}

std::vector<const CandidateScore*> strongest_candidates(const Diagnosis& diagnosis) {
  std::vector<const CandidateScore*> found;
  for (const EffectEntry& entry : effect_catalogue()) {
    const CandidateScore* best = nullptr;
    for (const CandidateScore& c : diagnosis.candidates)
      if (c.column.entry != nullptr && c.column.entry->name == entry.name && c.visible && std::isfinite(c.z) &&
          (best == nullptr || std::abs(c.z) >= std::abs(best->z)))
        best = &c;
    if (best != nullptr) found.push_back(best);
  }
  std::ranges::stable_sort(found, [](auto* a, auto* b) { return std::abs(a->z) > std::abs(b->z); });
  return found;
}

}  // namespace turncal
