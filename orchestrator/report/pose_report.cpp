#include "orchestrator/report/pose_report.h"

#include <cmath>

#include "calib/model/noise_model.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/figures/report_format.h"

namespace turncal {
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

}  // namespace turncal
