// The tables of the report that are about the fit: the 24 parameters and the noise.
#include "orchestrator/report/report_tables.h"

#include <algorithm>
#include <cmath>

#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/html_table.h"

namespace turncal {

using namespace html;

namespace {

constexpr const char* axis_names[] = {"x", "y", "z"};

std::string parameter_meaning(std::size_t k) {
  const std::string axis = axis_names[k % 3];
  if (k < 3) return "gyro " + axis + " bias";
  if (k < 6) return "accelerometer " + axis + " bias";
  const std::size_t i = (k - (k < 15 ? 6 : 15)) / 3;
  const std::string sensor = std::string(k < 15 ? "gyro " : "accelerometer ") + axis_names[i];
  return i == k % 3 ? sensor + " scale factor" : sensor + " towards " + axis;
}

struct ParameterUnit {
  double factor = 1.0;
  std::string unit;
};
ParameterUnit parameter_unit(std::size_t k, const RecordingInfo& info) {
  if (k < 3) return {1.0, "°/h"};
  if (k < 6) return {1e6, "µg"};
  if (k < 15 && info.gyro_increment == IncrementKind::pulses) return {1.0, "″/pulse"};
  return {1.0, ""};
}
// Sigma of scale factors in ppm and of installation errors in arc-seconds.
std::string handy_sigma(std::size_t k, double sigma, const ParameterVector& values) {
  if (k < 6) return "";
  const std::size_t i = (k - (k < 15 ? 6 : 15)) / 3;
  const double scale = values[static_cast<Eigen::Index>((k < 15 ? 6 : 15) + 4 * i)];
  return i == k % 3 ? significant(1e6 * sigma / scale, 2, typo) + " ppm"
                    : significant(sigma / scale / rad_per_arcsec, 2, typo) + " ″";
}

Cell bar(double value, double largest, bool left) {
  const bool here = left ? value < 0.0 : value > 0.0;
  const double width = here ? 70.0 * std::abs(value) / std::max(largest, 1e-9) : 0.0;
  const std::string kind = left ? "half left" : "half";
  if (width < 0.5) return {"", kind};
  return {"<span class=\"bar\" style=\"width:" + significant(width, 3) + "px\"></span>", kind};
}

std::string or_dash(double value, const std::string& unit) {
  return value > 0.0 ? significant(value, 2, typo) + " " + unit : "-";
}

std::string combination_text(const Undetermined& u) {
  std::string result;
  for (const auto& [key, weight] : u.combination) {
    if (!result.empty())
      result += weight < 0.0 ? " − " : " + ";
    else if (weight < 0.0)
      result += "−";
    result += significant(std::abs(weight), 2) + " " + key;
  }
  return result;
}

}  // namespace

std::string html_parameters(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  const bool both = has_after(diagnosis);
  const ParameterVector before = to_vector(diagnosis.base.parameters);
  const ParameterVector after = to_vector(diagnosis.extended.parameters);
  const ParameterVector change = changes_in_sigma(diagnosis);
  double largest = 1.0;
  for (const double c : change)
    if (std::isfinite(c)) largest = std::max(largest, std::abs(c));
  std::vector<Cell> head = {text("parameter"), text("")};
  if (both) head.push_back(number("before"));
  for (const Cell& cell : {number(both ? "after" : "value"), number("σ"), text("unit"), number("σ, rel.")})
    head.push_back(cell);
  if (both)
    for (const Cell& cell : {number("change, σ"), Cell{"", "half"}, Cell{"", "half"}}) head.push_back(cell);
  HtmlTable table(head);
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    const ParameterUnit unit = parameter_unit(k, context.recording.info);
    const double sigma = diagnosis.extended.sigma[row];
    std::vector<Cell> cells = {name(parameter_keys[k]), text(parameter_meaning(k))};
    if (!parameter_is_free[k] || !(sigma > 0.0)) {
      if (both) cells.push_back(number(parameter_is_free[k] ? "not determined" : "0"));
      for (const Cell& cell :
           {number(parameter_is_free[k] ? "not determined" : "0"), number("-"), text(""), number("-")})
        cells.push_back(cell);
      if (both)
        for (const Cell& cell : {number("-"), Cell{"", "half left"}, Cell{"", "half"}}) cells.push_back(cell);
      table.row(cells, "dim");
      continue;
    }
    if (both) cells.push_back(number(value_with_sigma(before[row] * unit.factor, sigma * unit.factor, typo)));
    cells.push_back(number(value_with_sigma(after[row] * unit.factor, sigma * unit.factor, typo)));
    cells.push_back(number(significant(sigma * unit.factor, 2, typo)));
    cells.push_back(text(unit.unit));
    cells.push_back(number(handy_sigma(k, sigma, after)));
    if (both) {
      cells.push_back(number(signed_number(change[row], 1)));
      cells.push_back(bar(change[row], largest, true));
      cells.push_back(bar(change[row], largest, false));
    }
    table.row(cells, both && std::abs(change[row]) > 3.0 ? "hit" : "");
  }
  std::string html = table.finish();
  html += paragraph(
      "a21, a31 and a32 are zero by definition: the accelerometers define the axes of the unit. The biases of the "
      "accelerometers are shown in µg; parameters.conf has them in g.",
      "soft");
  html += paragraph(both ? "σ is one standard deviation with the effects in the model. Bold: the missing effect had "
                           "moved the parameter "
                           "by more than three of them."
                         : "σ is one standard deviation. No effect was added, so nothing changed.",
                    "soft");
  if (!diagnosis.extended.undetermined.empty()) {
    html += paragraph("Not determined by this recording (combinations, in units of plausible ranges):");
    html += "<ul>\n";
    for (const Undetermined& u : diagnosis.extended.undetermined) html += item(html_escape(combination_text(u)));
    html += "</ul>\n";
  }
  return html;
}

std::string html_noise(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  const JointResult& r = diagnosis.extended;
  const NoiseModel& noise = r.noise;
  constexpr double micro_g = 1e-6 * standard_gravity_mps2;
  HtmlTable table({text("sensor"), number("random walk used"), text(""), number("Allan: N"), number("Q"), number("B"),
                   number("K")});
  for (std::size_t k = 0; k < 6; ++k) {
    const bool gyro = k < 3;
    const auto axis = static_cast<Eigen::Index>(k % 3);
    const double walk = gyro ? radprs_per_degprh : mpsprs_per_ugprHz;
    const double used = (gyro ? noise.angle_random_walk : noise.velocity_random_walk)[axis];
    const double sigma =
        r.noise_fit ? (gyro ? r.noise_fit->sigma_angle_random_walk : r.noise_fit->sigma_velocity_random_walk)[axis]
                    : 0.0;
    const AllanFit& f = r.allan.axes[k].fit;
    const double bias = gyro ? radps_per_degph : micro_g;
    const std::string walk_unit = gyro ? "°/√h" : "µg/√Hz";
    table.row({text(std::string(gyro ? "gyro " : "accelerometer ") + axis_names[k % 3]),
               number(value_with_sigma(used / walk, sigma / walk, typo)),
               text((sigma > 0.0 ? "± " + value_with_sigma(sigma / walk, sigma / walk, typo) + " " : "") + walk_unit),
               number(or_dash(f.random_walk / walk, walk_unit)),
               number(or_dash(f.quantisation / (gyro ? rad_per_arcsec : 1e-3), gyro ? "″" : "mm/s")),
               number(or_dash(f.bias_instability / bias, gyro ? "°/h" : "µg")),
               number(or_dash(f.rate_random_walk * 60.0 / bias, gyro ? "°/h/√h" : "µg/√h"))});
  }
  std::string html = table.finish();
  html += paragraph(
      "Allan fit: N random walk, Q quantisation, B bias instability, K rate random walk; - where the dwells show none.",
      "soft");
  std::string line = context.noise_given
                         ? "The noise was given in the configuration, not measured. "
                         : "The noise was measured on this recording (maximum likelihood, started from the Allan "
                           "deviation). ";
  if (r.noise_fit && r.noise_fit->axes_differ) line += "The axes of a triad differ and have values of their own. ";
  line += "Bias instability used: gyros " + significant(noise.gyro_bias_instability_radps / radps_per_degph, 2, typo) +
          " °/h, accelerometers " + significant(noise.accel_bias_instability_mps2 / micro_g, 2, typo) +
          " µg, correlation time " + significant(noise.bias_correlation_s, 3) + " s; one-pulse quantisation " +
          significant(noise.gyro_pulse_rad / rad_per_arcsec, 3, typo) + " ″ and " +
          significant(1e3 * noise.accel_pulse_mps, 3, typo) + " mm/s.";
  html += paragraph(line);
  std::vector<std::string> lags;
  for (const double a : r.whiteness.autocorrelation) lags.push_back(signed_number(a, 2));
  html += paragraph("Whiteness: " + (r.whiteness.message.empty() ? "not tested" : r.whiteness.message) +
                    " (mean square " + ratio(r.whiteness.level) + ", 1 expected; autocorrelation at 1 to " +
                    std::to_string(lags.size()) + " s: " + (lags.empty() ? "-" : join(lags)) + ").");
  return html;
}

}  // namespace turncal
