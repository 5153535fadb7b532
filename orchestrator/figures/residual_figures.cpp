#include "orchestrator/figures/diagnosis_figures.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "orchestrator/figures/report_format.h"

namespace turncal {

namespace {

using Eigen::Vector3d;

enum class Abscissa { specific_force, force_product, temperature, time, since_rotation, turned, rate, heading };
enum class Ordinate { accel, accel_per_g, tilt, tilt_per_turn, gyro, velocity };

struct PlotAxes {
  std::string_view effect;
  Abscissa x;
  Ordinate y;
  bool all_axes = false;  // whatever the component: it acts across the axes
};

// What the eye needs to see each effect. One that is not here is shown against time.
constexpr PlotAxes plot_axes[] = {
    {"accel_second_order", Abscissa::specific_force, Ordinate::accel},
    {"accel_scale_asymmetry", Abscissa::specific_force, Ordinate::accel},
    {"accel_odd_quadratic", Abscissa::specific_force, Ordinate::accel},
    {"accel_third_order", Abscissa::specific_force, Ordinate::accel},
    {"accel_cross_coupling", Abscissa::force_product, Ordinate::accel},
    {"accel_size_effect", Abscissa::turned, Ordinate::velocity, true},
    {"accel_delay", Abscissa::turned, Ordinate::velocity, true},
    {"accel_bias_temperature", Abscissa::temperature, Ordinate::accel},
    {"accel_scale_temperature", Abscissa::temperature, Ordinate::accel_per_g},
    {"accel_bias_drift", Abscissa::time, Ordinate::accel},
    {"accel_warm_up", Abscissa::time, Ordinate::accel},
    {"gyro_g_sensitivity", Abscissa::specific_force, Ordinate::gyro},
    {"gyro_scale_asymmetry", Abscissa::turned, Ordinate::tilt},
    {"gyro_rate_nonlinearity", Abscissa::rate, Ordinate::tilt_per_turn},
    {"gyro_bias_temperature", Abscissa::temperature, Ordinate::gyro},
    {"gyro_scale_temperature", Abscissa::temperature, Ordinate::tilt_per_turn},
    {"gyro_bias_drift", Abscissa::time, Ordinate::gyro},
    {"gyro_warm_up", Abscissa::time, Ordinate::gyro},
    {"gyro_magnetic", Abscissa::heading, Ordinate::gyro},
    {"earth_rate", Abscissa::heading, Ordinate::gyro, true},
    {"sample_period", Abscissa::heading, Ordinate::gyro, true},
    {"post_rotation_relaxation", Abscissa::since_rotation, Ordinate::velocity},
    {"gyro_accel_flexure", Abscissa::turned, Ordinate::tilt, true},
};

PlotAxes plot_axes_of(const std::string& effect) {
  for (const PlotAxes& plot : plot_axes)
    if (plot.effect == effect) return plot;
  return {effect, Abscissa::time, effect.starts_with("gyro") ? Ordinate::gyro : Ordinate::accel};
}

// Sensor axis and the axes of what it depends on, from the component's name: x, xy, x_yz, x_rx; -1 where there is none.
struct ComponentAxes {
  int sensor = -1, first = -1, second = -1;
};
ComponentAxes axes_of(std::string_view component) {
  const auto axis = [&](std::size_t at) {
    return at < component.size() && component[at] >= 'x' && component[at] <= 'z' ? component[at] - 'x' : -1;
  };
  if (component.size() == 1) return {axis(0), axis(0), -1};
  if (component.size() == 2) return {axis(0), axis(1), -1};
  if (component.size() >= 4 && component[1] == '_') return {axis(0), axis(2), axis(3)};
  return {};
}

struct Limits {  // largest magnitudes before and after, to choose units
  double accel = 0.0, tilt = 0.0, gyro = 0.0, velocity = 0.0;
};
Limits limits_of(const std::vector<DwellResidual>& dwells) {
  Limits l;
  for (const DwellResidual& d : dwells)
    for (const DwellResidual::Side* side : {&d.before, &d.after}) {
      const auto raise = [](double& largest, const Vector3d& v) {
        for (const double x : v)
          if (std::isfinite(x)) largest = std::max(largest, std::abs(x));
      };
      raise(l.accel, side->accel_mps2);
      raise(l.tilt, side->tilt_rad);
      raise(l.gyro, side->gyro_radps);
      raise(l.velocity, side->velocity_mps);
    }
  return l;
}

constexpr std::size_t markers_a_series = 300;  // more would make the page heavy, not clearer
constexpr double horizontal = 0.5;             // level_share above which an axis shows its tilt and its gyro
constexpr double real_turn_rad = 0.2;          // smaller ones are table errors
constexpr double loaded_g = 0.3;               // specific force that shows a scale factor

double abscissa_of(const DwellResidual& d, Abscissa x, const ComponentAxes& axes, int sensor) {
  switch (x) {
    case Abscissa::specific_force: return d.f_b_g[axes.first >= 0 ? axes.first : sensor];
    case Abscissa::force_product: return axes.second < 0 ? no_point : d.f_b_g[axes.first] * d.f_b_g[axes.second];
    case Abscissa::temperature: return d.temperature_c;
    case Abscissa::time: return d.time_s / 60.0;
    case Abscissa::since_rotation: return no_point;  // seconds, not dwells: since_rotation_panels()
    case Abscissa::turned: {
      int axis = axes.sensor;
      if (axis < 0) d.turned_rad.cwiseAbs().maxCoeff(&axis);
      return std::abs(d.turned_rad[axis]) < real_turn_rad ? no_point : d.turned_rad[axis] / rad_per_deg;
    }
    case Abscissa::rate:
      return std::abs(d.turned_rad[sensor]) < real_turn_rad ? no_point : d.fastest_radps[sensor] / rad_per_deg;
    case Abscissa::heading: return d.table_deg[0];
  }
  return no_point;
}

std::string abscissa_label(Abscissa x, const ComponentAxes& axes, int sensor) {
  const auto name = [](int axis) { return std::string(body_names[static_cast<std::size_t>(std::clamp(axis, 0, 2))]); };
  switch (x) {
    case Abscissa::specific_force: return "specific force along " + name(axes.first >= 0 ? axes.first : sensor) + ", g";
    case Abscissa::force_product: return "f" + name(axes.first) + " f" + name(axes.second) + ", g²";
    case Abscissa::temperature: return "temperature, °C";
    case Abscissa::time: return "time, min";
    case Abscissa::since_rotation: return "time since rotation, s";
    case Abscissa::turned:
      return axes.sensor < 0 ? "turned before the dwell, °" : "turned about " + name(axes.sensor) + ", °";
    case Abscissa::rate: return "rate about " + name(sensor) + ", °/s";
    case Abscissa::heading: return "heading, °";
  }
  return {};
}

double ordinate_of(const DwellResidual& d, const DwellResidual::Side& side, Ordinate y, int axis, const Limits& l) {
  switch (y) {
    case Ordinate::accel: return side.accel_mps2[axis] * acceleration_unit(l.accel).factor;
    case Ordinate::accel_per_g:
      return std::abs(d.f_b_g[axis]) < loaded_g
                 ? no_point
                 : side.accel_mps2[axis] / d.f_b_g[axis] * acceleration_unit(l.accel).factor;
    case Ordinate::tilt:
      return d.level_share[axis] < horizontal ? no_point : side.tilt_rad[axis] * angle_unit(l.tilt).factor;
    case Ordinate::tilt_per_turn:
      return d.level_share[axis] < horizontal || std::abs(d.turned_rad[axis]) < real_turn_rad
                 ? no_point
                 : 1e6 * side.tilt_rad[axis] / d.turned_rad[axis];
    case Ordinate::gyro:
      return d.level_share[axis] < horizontal ? no_point : side.gyro_radps[axis] * rate_unit(l.gyro).factor;
    case Ordinate::velocity: return side.velocity_mps[axis] * velocity_unit(l.velocity).factor;
  }
  return no_point;
}

std::string ordinate_label(Ordinate y, int axis, const Limits& l) {
  const std::string name = body_names[static_cast<std::size_t>(axis)];
  switch (y) {
    case Ordinate::accel: return "accelerometer " + name + ", " + acceleration_unit(l.accel).unit;
    case Ordinate::accel_per_g: return "accelerometer " + name + " per g, " + acceleration_unit(l.accel).unit + "/g";
    case Ordinate::tilt: return "tilt about " + name + ", " + angle_unit(l.tilt).unit;
    case Ordinate::tilt_per_turn: return "tilt per turn about " + name + ", ppm";
    case Ordinate::gyro: return "gyro " + name + ", " + rate_unit(l.gyro).unit;
    case Ordinate::velocity:
      return "velocity " + std::string(n_names[static_cast<std::size_t>(axis)]) + ", " + velocity_unit(l.velocity).unit;
  }
  return {};
}

// rms over all dwells of the residual velocity, second by second after the rotation.
std::vector<Panel> since_rotation_panels(const Diagnosis& diagnosis) {
  constexpr std::size_t seconds = 100;
  std::array<std::array<Vector3d, 2>, seconds> sum;
  std::array<double, seconds> count{};
  for (auto& s : sum) s.fill(Vector3d::Zero());
  for (const ResidualPoint& p : diagnosis.residuals) {
    if (!(p.since_rotation_s >= 0.0) || p.since_rotation_s >= static_cast<double>(seconds)) continue;
    const auto k = static_cast<std::size_t>(p.since_rotation_s);
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
    panel.title = n_names[static_cast<std::size_t>(axis)];
    panel.x_label = "time since rotation, s";
    panel.y_label = "rms velocity, " + unit.unit;
    panel.series = before_after_series(has_after(diagnosis));
    for (std::size_t s = 0; s < panel.series.size(); ++s)
      for (std::size_t k = 0; k < seconds; ++k)
        if (count[k] > 0.0)
          panel.series[s].points.emplace_back(static_cast<double>(k) + 0.5,
                                              std::sqrt(sum[k][s][axis] / count[k]) * unit.factor);
    panels.push_back(std::move(panel));
  }
  return panels;
}

Panel dwell_panel(const std::vector<DwellResidual>& dwells, const PlotAxes& plot, const ComponentAxes& axes, int axis,
                  bool with_after, const Limits& limits) {
  Panel panel;
  panel.x_label = abscissa_label(plot.x, axes, axis);
  panel.y_label = ordinate_label(plot.y, axis, limits);
  panel.angle = plot.x == Abscissa::turned || plot.x == Abscissa::heading;
  panel.series = before_after_series(with_after);
  for (std::size_t s = 0; s < panel.series.size(); ++s) {
    panel.series[s].style = with_after && s == 0 ? Series::Style::open_circle : Series::Style::dot;
    for (const DwellResidual& d : dwells) {
      const double x = abscissa_of(d, plot.x, axes, axis);
      const double y = ordinate_of(d, s == 0 ? d.before : d.after, plot.y, axis, limits);
      if (std::isfinite(x) && std::isfinite(y)) panel.series[s].points.emplace_back(x, y);
    }
    panel.series[s].points = outline(panel.series[s].points, markers_a_series);
  }
  return panel;
}

// One row of up to three panels; a single one takes half of the width.
void arrange(Figure& figure) {
  figure.columns = static_cast<int>(std::max<std::size_t>(1, figure.panels.size()));
  figure.panel_width = figure.columns < 3 ? 480 : 320;
  figure.panel_height = 270;
}

const char* caption_of(Ordinate y) {
  switch (y) {
    case Ordinate::accel:
    case Ordinate::accel_per_g:
      return "One point a dwell: the slope of the residual velocity along the axis of the sensor.";
    case Ordinate::tilt:
    case Ordinate::tilt_per_turn:
      return "One point a dwell in which the axis lay horizontal: the tilt error that the rotation before it left "
             "behind.";
    case Ordinate::gyro:
      return "One point a dwell in which the axis lay horizontal: the curvature of the residual velocity, as an error "
             "of the gyro "
             "along it.";
    case Ordinate::velocity: return "One point a dwell: the velocity that the rotation before it left behind.";
  }
  return "";
}

}  // namespace

Figure effect_figure(const Diagnosis& diagnosis, const std::vector<DwellResidual>& dwells, const std::string& effect,
                     std::size_t number) {
  constexpr std::size_t most_panels = 3;
  const PlotAxes plot = plot_axes_of(effect);
  const Limits limits = limits_of(dwells);
  Figure figure;
  figure.id = "effect" + std::to_string(number);
  figure.label = "Residual against what " + effect + " depends on";
  if (plot.x == Abscissa::since_rotation) {
    figure.panels = since_rotation_panels(diagnosis);
    arrange(figure);
    figure.caption = "Root mean square over all dwells, second by second after the rotation.";
    return figure;
  }
  if (plot.all_axes) {
    for (int axis = 0; axis < 3; ++axis)
      figure.panels.push_back(dwell_panel(dwells, plot, {}, axis, has_after(diagnosis), limits));
  } else {
    for (const EstimatedEffect* e : strongest_of(diagnosis.extended, effect)) {
      const std::string component = component_name(e->column);
      const ComponentAxes axes = axes_of(component);
      if (axes.sensor < 0) continue;
      Panel panel = dwell_panel(dwells, plot, axes, axes.sensor, has_after(diagnosis), limits);
      panel.title = "component " + component;
      if (!panel.empty() && figure.panels.size() < most_panels) figure.panels.push_back(std::move(panel));
    }
  }
  std::erase_if(figure.panels, [](const Panel& panel) { return panel.empty(); });
  arrange(figure);
  figure.caption = caption_of(plot.y);
  return figure;
}

std::vector<Figure> unexplained_figures(const std::vector<DwellResidual>& dwells) {
  struct Against {
    const char* label;
    bool angle;
    double (*value)(const DwellResidual&, int);
  };
  static constexpr Against against[] = {
      {"heading, °", true, [](const DwellResidual& d, int) { return d.table_deg[0]; }},
      {"pitch, °", true, [](const DwellResidual& d, int) { return d.table_deg[1]; }},
      {"roll, °", true, [](const DwellResidual& d, int) { return d.table_deg[2]; }},
      {"specific force along x, g", false, [](const DwellResidual& d, int) { return d.f_b_g[0]; }},
      {"specific force along y, g", false, [](const DwellResidual& d, int) { return d.f_b_g[1]; }},
      {"specific force along z, g", false, [](const DwellResidual& d, int) { return d.f_b_g[2]; }},
      {"rate about the axis before, °/s", false,
       [](const DwellResidual& d, int axis) {
         return std::abs(d.turned_rad[axis]) < real_turn_rad ? no_point : d.fastest_radps[axis] / rad_per_deg;
       }},
      {"temperature, °C", false, [](const DwellResidual& d, int) { return d.temperature_c; }},
      {"time, min", false, [](const DwellResidual& d, int) { return d.time_s / 60.0; }},
  };
  const Limits limits = limits_of(dwells);
  std::vector<Figure> figures;
  for (const Ordinate y : {Ordinate::accel, Ordinate::gyro}) {
    const bool accel = y == Ordinate::accel;
    Figure figure;
    figure.id = accel ? "asAccel" : "asGyro";
    figure.label = "Residual of each dwell as " + std::string(accel ? "accelerometer" : "gyro") +
                   " error, against table angles, specific force, rate, temperature and time";
    figure.caption =
        accel ? "One point a dwell and axis: slope of the residual velocity along the axis, as an error of its "
                "accelerometer."
              : "One point a dwell and horizontal axis: curvature of the residual velocity, as an error of the "
                "gyro along it.";
    figure.columns = 3;
    figure.panel_width = 320;
    figure.panel_height = 240;
    for (const Against& a : against) {
      Panel panel;
      panel.x_label = a.label;
      panel.angle = a.angle;
      panel.y_label =
          accel ? "accelerometer, " + acceleration_unit(limits.accel).unit : "gyro, " + rate_unit(limits.gyro).unit;
      for (int axis = 0; axis < 3; ++axis) {
        Series series = axis_series(static_cast<std::size_t>(axis));
        for (const DwellResidual& d : dwells) {
          const double value = ordinate_of(d, d.before, y, axis, limits);
          const double x = a.value(d, axis);
          if (std::isfinite(x) && std::isfinite(value)) series.points.emplace_back(x, value);
        }
        series.points = outline(series.points, markers_a_series);
        panel.series.push_back(std::move(series));
      }
      if (!panel.empty()) figure.panels.push_back(std::move(panel));
    }
    if (!figure.panels.empty()) figures.push_back(std::move(figure));
  }
  return figures;
}

}  // namespace turncal
