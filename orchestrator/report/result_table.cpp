#include "orchestrator/report/result_table.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <span>
#include <string>

#include "calib/model/noise_model.h"
#include "calib/navigation/free_navigation.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/figures/report_format.h"

namespace turncal {

namespace {

std::string number(const char* format, double value) {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace

void print_results(const ParameterFile& file, const std::optional<ParameterVector>& truth, std::ostream& out) {
  char line[200];
  std::snprintf(line, sizeof line, "%-5s %-13s %16s", "name", "unit", "estimate");
  out << line;
  if (truth) {
    std::snprintf(line, sizeof line, " %16s %11s", "truth", "error");
    out << line;
  }
  std::snprintf(line, sizeof line, " %10s%s\n", "sigma", truth ? "  error/sigma" : "");
  out << line;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    const double estimate = file.parameters[static_cast<Eigen::Index>(i)];
    std::snprintf(line, sizeof line, "%-5s %-13s %16.10f", std::string(parameter_keys[i]).c_str(),
                  parameter_unit(parameter_keys[i], file.gyro_increment), estimate);
    out << line;
    const std::optional<double>& sigma = file.sigma[i];
    double error = 0.0;
    if (truth) {
      const double true_value = (*truth)[static_cast<Eigen::Index>(i)];
      error = estimate - true_value;
      std::snprintf(line, sizeof line, " %16.10f %11.3e", true_value, error);
      out << line;
    }
    const bool known = sigma && *sigma > 0.0;
    std::snprintf(line, sizeof line, " %10s", known ? number("%.2e", *sigma).c_str() : "-");
    out << line;
    if (truth) {
      std::snprintf(line, sizeof line, " %12s", known ? number("%+.2f", error / *sigma).c_str() : "-");
      out << line;
    }
    out << '\n';
  }
}

namespace {

struct DriftRow {
  const char* name;
  double (*value)(const ExpectedDrift& drift);
};

const ExpectedDrift::Point& end_of(const ExpectedDrift& drift) { return drift.points.back(); }

double rms_of(const Eigen::Matrix2d& covariance_m2, const ExpectedDrift& drift) {
  return expected_nm_per_h(covariance_m2, end_of(drift).time_s);
}
DriftOverRuns over_runs(const ExpectedDrift& drift) {
  const double rms = rms_of(end_of(drift).covariance_m2, drift);
  return drift_over_runs(std::span(&rms, 1));
}

constexpr DriftRow drift_rows[] = {
    {"heading after alignment, deg", [](const ExpectedDrift& d) { return d.align_sigma_rad[1] / rad_per_deg; }},
    {"north at the end, m", [](const ExpectedDrift& d) { return std::sqrt(end_of(d).covariance_m2(0, 0)); }},
    {"east at the end, m", [](const ExpectedDrift& d) { return std::sqrt(end_of(d).covariance_m2(1, 1)); }},
    {"rms, nm/h", [](const ExpectedDrift& d) { return over_runs(d).rms_nm_per_h; }},
    {"of it from noise alone, nm/h", [](const ExpectedDrift& d) { return rms_of(end_of(d).noise_m2, d); }},
    {"CEP, nm/h", [](const ExpectedDrift& d) { return over_runs(d).cep_nm_per_h; }},
    {"R95, nm/h", [](const ExpectedDrift& d) { return over_runs(d).r95_nm_per_h; }},
};

}  // namespace

void print_predicted_drift(const std::vector<std::pair<std::string, ExpectedDrift>>& columns, const DriftPlan& plan,
                           std::ostream& out) {
  char text[160];
  std::snprintf(text, sizeof text,
                "Free navigation for %g s at rest, level, front north, aligned for %g s; one sigma\n", plan.free_s,
                plan.align_s);
  out << text;
  std::snprintf(text, sizeof text, "%-30s", "");
  out << text;
  for (const auto& [name, drift] : columns) {
    std::snprintf(text, sizeof text, " %14s", name.c_str());
    out << text;
  }
  out << "\n";
  for (const DriftRow& row : drift_rows) {
    std::snprintf(text, sizeof text, "%-30s", row.name);
    out << text;
    for (const auto& [name, drift] : columns) {
      std::snprintf(text, sizeof text, " %14.3g", row.value(drift));
      out << text;
    }
    out << "\n";
  }
}

namespace {

constexpr double clearly = 4.0;  // sigmas from which a coefficient is shown on the terminal

struct NoiseValue {
  std::string key;
  double value;
};

std::vector<NoiseValue> noise_values(const SinglePose& pose) {
  std::vector<NoiseValue> values;
  for (std::size_t channel = 0; channel < 6; ++channel) {
    const AllanFit& fit = pose.noise.axes[channel].fit;
    const std::string axis(1, "xyz"[channel % 3]);
    if (channel < 3) {
      values.push_back({"angle_random_walk." + axis + "_deg_per_rt_h", fit.random_walk / radprs_per_degprh});
      values.push_back({"gyro_bias_instability." + axis + "_degph", fit.bias_instability / radps_per_degph});
    } else {
      values.push_back({"velocity_random_walk." + axis + "_ug_per_rt_hz", fit.random_walk / mpsprs_per_ugprHz});
      values.push_back({"accel_bias_instability." + axis + "_ug", fit.bias_instability / standard_gravity_mps2 * 1e6});
    }
  }
  return values;
}

}  // namespace

std::vector<std::string> pose_table(const SinglePose& pose) {
  std::vector<std::string> lines = {"verdict     Not tested: one pose of " + significant(pose.duration_s, 4) +
                                    " s determines no scale factor and no bias; it gives noise and slow changes:"};
  for (const NoiseValue& n : noise_values(pose))
    lines.push_back("noise       " + n.key + " = " + significant(n.value, 3));
  int hidden = 0;
  for (const PoseCoefficient& c : pose.coefficients) {
    if (std::abs(c.value) < clearly * c.sigma) {
      ++hidden;
      continue;
    }
    lines.push_back("change      " + c.key + " = " + significant(c.value, 3) + " +- " + significant(c.sigma, 2) + " " +
                    c.unit + (c.tau_s > 0.0 ? ", tau " + significant(c.tau_s, 3) + " s" : "") +
                    (c.alias ? " (time and temperature cannot be told apart here)" : ""));
  }
  if (hidden > 0) lines.push_back("change      " + std::to_string(hidden) + " further coefficients are below 4 sigma");
  return lines;
}

std::string format_pose(const SinglePose& pose) {
  std::string text = "# turncal diagnosis: one pose, " + format_number(pose.duration_s) +
                     " s; noise and slow changes only\nverdict = not_tested\neffects =\nquality.trusted = false\n";
  for (const NoiseValue& n : noise_values(pose)) text += "noise." + n.key + " = " + format_number(n.value) + "\n";
  for (const PoseCoefficient& c : pose.coefficients) {
    text += "coefficient." + c.key + " = " + format_number(c.value) + "\n";
    text += "sigma.coefficient." + c.key + " = " + format_number(c.sigma) + "\n";
    if (c.tau_s > 0.0) text += "coefficient." + c.key + ".tau_s = " + format_number(c.tau_s) + "\n";
  }
  return text;
}

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
