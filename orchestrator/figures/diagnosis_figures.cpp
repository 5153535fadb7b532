#include "orchestrator/figures/diagnosis_figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/evidence/holdout.h"
#include "calib/model/attitude.h"
#include "calib/model/effects.h"
#include "calib/statistics/numerics.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/number_text.h"

namespace turncal {
namespace {

constexpr std::size_t points_a_curve = 3000;
constexpr double fit_window_s =
    120.0;  // longer dwells are cut: after minutes the angle random walk hides everything else

// Returns an empty series with the name, marker and colour of the sensor along x, y or z.
Series axis_series(std::size_t axis) {
  constexpr std::array styles = {Series::Style::dot, Series::Style::triangle, Series::Style::square};
  constexpr std::array colours = {Colour::x, Colour::y, Colour::z};
  return {body_names[axis], styles[axis], colours[axis], {}};
}

// Returns the runs of static seconds between rotations (the first: before any), as [first, last) in `points`.
std::vector<std::pair<std::size_t, std::size_t>> rests(const std::vector<ResidualPoint>& points) {
  std::vector<std::pair<std::size_t, std::size_t>> result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const bool begins =
        i == 0 || points[i].since_rotation_s <= points[i - 1].since_rotation_s ||
        points[i].time_s - points[i - 1].time_s > 1.5 * (points[i].since_rotation_s - points[i - 1].since_rotation_s);
    if (begins) result.emplace_back(i, i);
    result.back().second = i + 1;
  }
  return result;
}
bool before_any_rotation(const ResidualPoint& point) { return point.since_rotation_s > 1e6; }

// Returns the limit of the frame, so that a few branches thrown far out by a fault do not flatten the others: three times what 97 % need.
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

using Eigen::Vector3d;
constexpr std::size_t fewest_seconds = 8;

double within_180(double angle_deg) { return std::remainder(angle_deg, 360.0); }

// Adds the motion between block `end` and the rest before it.
void add_motion(const CompressedRecording& recording, const SensorModel& model, std::size_t end, DwellResidual& dwell) {
  for (std::size_t k = std::min(end, recording.blocks.size()); k-- > 0;) {
    const Block& block = recording.blocks[k];
    if (recording.segments[std::size_t(block.segment)].kind != SegmentKind::rotate) {
      if (block.whole_second) return;
      continue;
    }
    dwell.add_turn(block, model);
  }
}

DwellResidual::Side fit_side(const std::vector<ResidualPoint>& points, std::size_t first, std::size_t last, bool after,
                             const Eigen::Matrix3d& C_nb, double gravity_mps2) {
  const auto rows = Eigen::Index(last - first);
  Eigen::MatrixX3d shape(rows, 3);
  Eigen::MatrixX3d v(rows, 3);
  const double start_s = points[first].time_s;
  const double middle_s = 0.5 * (points[last - 1].time_s - start_s);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const ResidualPoint& p = points[first + std::size_t(i)];
    const double t = p.time_s - start_s;
    shape.row(i) << 1.0, t, 0.5 * t * (t - 2.0 * middle_s);  // so that the slope is that in the middle
    v.row(i) = (after ? p.velocity_after_mps : p.velocity_before_mps).transpose();
  }
  Eigen::Matrix3d fit;
  for (int k = 0; k < 3; ++k) fit.col(k) = least_squares(shape, v.col(k)).x;
  const Vector3d a = fit.row(1).transpose();
  const Vector3d j = fit.row(2).transpose();
  DwellResidual::Side side;
  side.velocity_mps = fit.row(0).transpose();
  side.accel_mps2 = C_nb.transpose() * a;
  side.tilt_rad = C_nb.transpose() * Vector3d(a.z(), 0.0, -a.x()) / gravity_mps2;
  side.gyro_radps = C_nb.transpose() * Vector3d(j.z(), 0.0, -j.x()) / gravity_mps2;
  return side;
}

constexpr std::size_t markers_a_series = 300;  // more would make the page heavy, not clearer
constexpr double horizontal = 0.5;             // level_share above which an axis shows its tilt and its gyro
constexpr double real_turn_rad = 0.2;          // smaller ones are table errors
constexpr double loaded_g = 0.3;               // specific force that shows a scale factor

// Axes of sensor and causes, from the component's name: x, xy, x_yz; -1: none.
struct ComponentAxes {
  int sensor = -1, first = -1, second = -1;
};
ComponentAxes axes_of(std::string_view component) {
  const auto axis = [&](std::size_t at) {
    return at < component.size() && component[at] >= 'x' && component[at] <= 'z' ? component[at] - 'x' : -1;
  };
  if (component.size() == 1) return {axis(0), axis(0), -1};
  if (component.size() == 2) return {axis(0), axis(1) < 0 ? axis(0) : axis(1), -1};
  if (component.size() >= 4 && component[1] == '_') return {axis(0), axis(2), axis(3)};
  return {};
}

struct Abscissa {
  const char* label;  // {0}: axis of the sensor, {1} and {2}: axes of the cause
  bool angle;
  double (*value)(const DwellResidual&, const ComponentAxes&);  // NaN: not shown by this dwell
};
constexpr Abscissa by_force = {"specific force along {1}, g", false,
                               [](const DwellResidual& d, const ComponentAxes& a) { return d.f_b_g[a.first]; }};
constexpr Abscissa by_product = {"f{1} f{2}, g²", false, [](const DwellResidual& d, const ComponentAxes& a) {
                                   return a.second < 0 ? no_point : d.f_b_g[a.first] * d.f_b_g[a.second];
                                 }};
constexpr Abscissa by_temperature = {"temperature, °C", false,
                                     [](const DwellResidual& d, const ComponentAxes&) { return d.temperature_c; }};
constexpr Abscissa by_time = {"time, min", false,
                              [](const DwellResidual& d, const ComponentAxes&) { return d.time_s / 60.0; }};
constexpr Abscissa since_rotation = {"time since rotation, s", false, nullptr};  // by seconds, not by dwells
constexpr Abscissa by_any_turn = {"turned before the dwell, °", true, [](const DwellResidual& d, const ComponentAxes&) {
                                    int axis = 0;
                                    d.turned_rad.cwiseAbs().maxCoeff(&axis);
                                    const double turned_rad = d.turned_rad[axis];
                                    return std::abs(turned_rad) < real_turn_rad ? no_point : turned_rad / rad_per_deg;
                                  }};
double rate_before(const DwellResidual& d, const ComponentAxes& a) {
  return std::abs(d.turned_rad[a.sensor]) < real_turn_rad ? no_point : d.fastest_radps[a.sensor] / rad_per_deg;
}
constexpr Abscissa by_rate = {"rate about {0}, °/s", false, rate_before};
constexpr Abscissa by_heading = {"heading, °", true,
                                 [](const DwellResidual& d, const ComponentAxes&) { return d.table_deg[0]; }};

// The error of one axis, in a unit that suits the largest error of all dwells.
struct Ordinate {
  const char* label;  // {0}: the axis, {1}: the unit, {2}: the axis of n
  Vector3d DwellResidual::Side::*value;
  DisplayUnit (*unit)(double largest);
  double (*over)(const DwellResidual&, int axis);  // the shown value is divided by it; NaN: not shown by this dwell
  const char* caption;
};
double if_level(const DwellResidual& d, int axis) { return d.level_share[axis] < horizontal ? no_point : 1.0; }
constexpr const char* of_slope = "One point a dwell: the slope of the residual velocity along the axis of the sensor.";
constexpr const char* of_tilt =
    "One point a dwell in which the axis lay horizontal: the tilt error that the rotation before it left behind.";
constexpr Ordinate as_accel = {"accelerometer {0}, {1}", &DwellResidual::Side::accel_mps2, acceleration_unit,
                               [](const DwellResidual&, int) { return 1.0; }, of_slope};
constexpr Ordinate as_accel_per_g = {
    "accelerometer {0} per g, {1}/g", &DwellResidual::Side::accel_mps2, acceleration_unit,
    [](const DwellResidual& d, int axis) { return std::abs(d.f_b_g[axis]) < loaded_g ? no_point : d.f_b_g[axis]; },
    of_slope};
constexpr Ordinate as_tilt = {"tilt about {0}, {1}", &DwellResidual::Side::tilt_rad, angle_unit, if_level, of_tilt};
constexpr Ordinate as_tilt_per_turn = {"tilt per turn about {0}, {1}", &DwellResidual::Side::tilt_rad,
                                       [](double) {
                                         return DisplayUnit{1e6, "ppm"};
                                       },
                                       [](const DwellResidual& d, int axis) {
                                         const double turn_rad = d.turned_rad[axis];
                                         return std::abs(turn_rad) < real_turn_rad ? no_point
                                                                                   : turn_rad * if_level(d, axis);
                                       },
                                       of_tilt};
constexpr Ordinate as_gyro = {"gyro {0}, {1}", &DwellResidual::Side::gyro_radps, rate_unit, if_level,
                              "One point a dwell in which the axis lay horizontal: the curvature of the residual "
                              "velocity, as an error of the gyro along it."};
constexpr Ordinate as_velocity = {"velocity {2}, {1}", &DwellResidual::Side::velocity_mps, velocity_unit,
                                  [](const DwellResidual&, int) { return 1.0; },
                                  "One point a dwell: the velocity that the rotation before it left behind."};

// The axes that make an effect visible, by the quantity that it changes and its driver.
struct PlotAxes {
  const Abscissa& x;
  const Ordinate& y;
  bool all_axes = false;  // for any component, because it acts across the axes
};
PlotAxes plot_axes_of(const EffectEntry& e) {
  const bool accel = e.sensor == Sensor::accelerometer, product = e.components.front().size() > 3;  // x_yz
  if (e.driver == Driver::turns) return {since_rotation, as_velocity};
  if (e.quantity == Quantity::direction) return {by_any_turn, as_tilt, true};
  if (e.driver == Driver::rate && accel) return {by_any_turn, as_velocity, true};
  const Abscissa& x = e.driver == Driver::force         ? (product ? by_product : by_force)
                      : e.driver == Driver::temperature ? by_temperature
                      : e.driver == Driver::rate        ? by_rate
                      : e.driver == Driver::field       ? by_heading
                                                        : by_time;
  const bool scale = e.quantity == Quantity::scale_factor;
  const Ordinate& y = scale ? (accel ? as_accel_per_g : as_tilt_per_turn) : (accel ? as_accel : as_gyro);
  return {x, y, e.sensor == Sensor::earth_rate};
}

DisplayUnit unit_of(const Ordinate& y, const std::vector<DwellResidual>& dwells) {
  double largest = 0.0;
  for (const DwellResidual& d : dwells)
    for (const DwellResidual::Side* side : {&d.before, &d.after})
      for (const double x : side->*y.value)
        if (std::isfinite(x)) largest = std::max(largest, std::abs(x));
  return y.unit(largest);
}

const char* name_of(int axis) { return body_names[std::size_t(std::clamp(axis, 0, 2))]; }
std::string label_of(const Abscissa& x, const ComponentAxes& axes) {
  return fmt::format(fmt::runtime(x.label), name_of(axes.sensor), name_of(axes.first), name_of(axes.second));
}

void add_points(const std::vector<DwellResidual>& dwells, DwellResidual::Side DwellResidual::*side, const Abscissa& x,
                const Ordinate& y, const ComponentAxes& axes, double factor, Series& series) {
  for (const DwellResidual& d : dwells) {
    const double at = x.value(d, axes), value = (d.*side.*y.value)[axes.sensor] / y.over(d, axes.sensor) * factor;
    if (std::isfinite(at) && std::isfinite(value)) series.points.emplace_back(at, value);
  }
  series.points = outline(series.points, markers_a_series);
}

// Returns panels of the residual velocity, rms over all dwells, for each second after the rotation.
std::vector<Panel> since_rotation_panels(const Diagnosis& diagnosis) {
  constexpr std::size_t seconds = 100;
  std::array<std::array<Vector3d, 2>, seconds> sum;
  std::array<double, seconds> count{};
  for (auto& s : sum) s.fill(Vector3d::Zero());
  for (const ResidualPoint& p : diagnosis.residuals) {
    if (!(p.since_rotation_s >= 0.0) || p.since_rotation_s >= double(seconds)) continue;
    const auto k = std::size_t(p.since_rotation_s);
    sum[k][0] += p.velocity_before_mps.cwiseAbs2();
    sum[k][1] += p.velocity_after_mps.cwiseAbs2();
    count[k] += 1.0;
  }
  double largest = 0.0;
  for (std::size_t k = 0; k < seconds; ++k)
    if (count[k] > 0.0) largest = std::max(largest, std::sqrt(sum[k][0].maxCoeff() / count[k]));
  const DisplayUnit unit = velocity_unit(largest);
  std::vector<Panel> panels;
  for (int axis = 0; axis < 3; ++axis) {
    Panel panel;
    panel.title = n_names[std::size_t(axis)];
    panel.x_label = "time since rotation, s";
    panel.y_label = "rms velocity, " + unit.unit;
    panel.series = before_after_series(has_after(diagnosis));
    for (std::size_t s = 0; s < panel.series.size(); ++s)
      for (std::size_t k = 0; k < seconds; ++k)
        if (count[k] > 0.0)
          panel.series[s].points.emplace_back(double(k) + 0.5, std::sqrt(sum[k][s][axis] / count[k]) * unit.factor);
    panels.push_back(std::move(panel));
  }
  return panels;
}

Panel dwell_panel(const std::vector<DwellResidual>& dwells, const PlotAxes& plot, const ComponentAxes& axes,
                  bool with_after) {
  const DisplayUnit unit = unit_of(plot.y, dwells);
  Panel panel;
  panel.x_label = label_of(plot.x, axes);
  panel.y_label =
      fmt::format(fmt::runtime(plot.y.label), name_of(axes.sensor), unit.unit, n_names[std::size_t(axes.sensor)]);
  panel.angle = plot.x.angle;
  panel.series = before_after_series(with_after);
  for (Series& series : panel.series) {
    const bool first_of_two = with_after && &series == &panel.series.front();
    series.style = first_of_two ? Series::Style::open_circle : Series::Style::dot;
    add_points(dwells, &series == &panel.series.front() ? &DwellResidual::before : &DwellResidual::after, plot.x,
               plot.y, axes, unit.factor, series);
  }
  return panel;
}

// Arranges up to three panels in one row; a single one takes half of the width.
void arrange(Figure& figure) {
  figure.columns = int(std::max<std::size_t>(1, figure.panels.size()));
  figure.panel_width = figure.columns < 3 ? 480 : 320;
  figure.panel_height = 270;
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
  double unit_s = 0.0;  // unit of the time axis; stacked panels share one
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
  for (Panel& panel : figure.panels)
    if (panel.x_label.starts_with("time, ") || figure.stacked) panel.marks = marks;
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

// ---- the residual, dwell by dwell ----

void DwellResidual::add_turn(const Block& block, const SensorModel& model) {
  const Vector3d turn = model.gyro_scale * block.gyro - model.gyro_bias_radps * block.duration_s;
  turned_rad += turn;
  const Vector3d rate = turn / block.duration_s;
  for (int axis = 0; axis < 3; ++axis)
    if (std::abs(rate[axis]) > std::abs(fastest_radps[axis])) fastest_radps[axis] = rate[axis];
}

std::vector<DwellResidual> dwell_residuals(const Diagnosis& diagnosis, const CompressedRecording& recording) {
  const std::vector<ResidualPoint>& points = diagnosis.residuals;
  const SensorModel model = sensor_model(diagnosis.base.parameters, recording.info);
  std::vector<DwellResidual> result;
  for (auto [first, last] : rests(points)) {
    if (before_any_rotation(points[first])) continue;
    while (last > first && points[last - 1].time_s - points[first].time_s > fit_window_s) --last;
    if (last - first < fewest_seconds) continue;
    const ResidualPoint& p = points[first];
    if (p.segment < 0 || std::size_t(p.segment) >= recording.segments.size()) continue;
    const Segment& segment = recording.segments[std::size_t(p.segment)];
    DwellResidual d;
    d.segment = p.segment;
    d.step = segment.step;
    d.time_s = 0.5 * (p.time_s + points[last - 1].time_s);
    d.table_deg = {within_180(segment.heading_deg), within_180(segment.pitch_deg), within_180(segment.roll_deg)};
    Vector3d f = Vector3d::Zero();
    double temperature = 0.0;
    for (std::size_t i = first; i < last; ++i) {
      f += points[i].f_b_mps2;
      temperature += points[i].temperature_c;
    }
    f /= double(last - first);
    d.f_b_g = f / standard_gravity_mps2;
    d.temperature_c = recording.info.has_temperature ? temperature / double(last - first) : no_point;
    const Eigen::Matrix3d C_nb =
        level(attitude_from_angles(segment.heading_deg * rad_per_deg, segment.pitch_deg * rad_per_deg,
                                   segment.roll_deg * rad_per_deg),
              f);
    d.level_share = (Vector3d::Ones() - C_nb.row(1).transpose().cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
    d.before = fit_side(points, first, last, false, C_nb, recording.info.gravity_mps2);
    d.after = fit_side(points, first, last, true, C_nb, recording.info.gravity_mps2);
    add_motion(recording, model, p.block, d);
    result.push_back(d);
  }
  return result;
}

double velocity_rms_mps(const Diagnosis& diagnosis, bool after) {
  double sum = 0.0;
  double count = 0.0;
  for (const auto& [first, last] : rests(diagnosis.residuals))
    for (std::size_t i = first; i < std::min(last, first + velocity_seconds); ++i) {
      const ResidualPoint& p = diagnosis.residuals[i];
      sum += (after ? p.velocity_after_mps : p.velocity_before_mps).squaredNorm();
      count += 1.0;
    }
  return count > 0.0 ? std::sqrt(sum / count) : no_point;
}

Figure effect_figure(const Diagnosis& diagnosis, const std::vector<DwellResidual>& dwells, const std::string& effect,
                     std::size_t number) {
  constexpr std::size_t most_panels = 3;
  const std::vector<const EstimatedEffect*> components = strongest_of(diagnosis.extended, effect);
  const PlotAxes plot = plot_axes_of(*components.front()->column.entry);
  Figure figure{"effect" + std::to_string(number), "Residual against what " + effect + " depends on", ""};
  if (&plot.x == &since_rotation) {
    figure.panels = since_rotation_panels(diagnosis);
    arrange(figure);
    figure.caption = "Root mean square over all dwells, second by second after the rotation.";
    return figure;
  }
  if (plot.all_axes) {
    for (int axis = 0; axis < 3; ++axis)
      figure.panels.push_back(dwell_panel(dwells, plot, {axis, axis, -1}, has_after(diagnosis)));
  } else {
    for (const EstimatedEffect* e : components) {
      const std::string component = component_name(e->column);
      const ComponentAxes axes = axes_of(component);
      if (axes.sensor < 0) continue;
      Panel panel = dwell_panel(dwells, plot, axes, has_after(diagnosis));
      panel.title = "component " + component;
      if (!panel.empty() && figure.panels.size() < most_panels) figure.panels.push_back(std::move(panel));
    }
  }
  std::erase_if(figure.panels, [](const Panel& panel) { return panel.empty(); });
  arrange(figure);
  figure.caption = plot.y.caption;
  return figure;
}

std::vector<Figure> unexplained_figures(const std::vector<DwellResidual>& dwells) {
  static constexpr Abscissa pitch = {"pitch, °", true,
                                     [](const DwellResidual& d, const ComponentAxes&) { return d.table_deg[1]; }};
  static constexpr Abscissa roll = {"roll, °", true,
                                    [](const DwellResidual& d, const ComponentAxes&) { return d.table_deg[2]; }};
  static constexpr Abscissa rate_of_each = {"rate about the axis before, °/s", false, rate_before};
  static constexpr std::pair<const Abscissa&, int> against[] = {{by_heading, 0},   {pitch, 0},          {roll, 0},
                                                                {by_force, 0},     {by_force, 1},       {by_force, 2},
                                                                {rate_of_each, 0}, {by_temperature, 0}, {by_time, 0}};
  std::vector<Figure> figures;
  for (const Ordinate* y : {&as_accel, &as_gyro}) {
    const bool of_accel = y == &as_accel;
    const DisplayUnit unit = unit_of(*y, dwells);
    Figure figure = small_panels(
        of_accel ? "asAccel" : "asGyro",
        "Residual of each dwell as " + std::string(of_accel ? "accelerometer" : "gyro") +
            " error, against table angles, specific force, rate, temperature and time",
        of_accel ? "One point a dwell and axis: slope of the residual velocity along the axis, as an error of its "
                   "accelerometer."
                 : "One point a dwell and horizontal axis: curvature of the residual velocity, as an error of the "
                   "gyro along it.");
    for (const auto& [x, first] : against) {
      Panel panel;
      panel.x_label = label_of(x, {0, first, -1});
      panel.angle = x.angle;
      panel.y_label = (of_accel ? "accelerometer, " : "gyro, ") + unit.unit;
      for (int axis = 0; axis < 3; ++axis) {
        Series& series = panel.series.emplace_back(axis_series(std::size_t(axis)));
        add_points(dwells, &DwellResidual::before, x, *y, {axis, first, -1}, unit.factor, series);
      }
      if (!panel.empty()) figure.panels.push_back(std::move(panel));
    }
    if (!figure.panels.empty()) figures.push_back(std::move(figure));
  }
  return figures;
}

}  // namespace turncal
