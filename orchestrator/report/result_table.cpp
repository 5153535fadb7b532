#include "orchestrator/report/result_table.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <span>

#include "calib/navigation/free_navigation.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/text.h"
#include "orchestrator/report/allan_report.h"
#include "orchestrator/report/report.h"

namespace turncal {

namespace {

using namespace cell;

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
    {"rms, NM/h", [](const ExpectedDrift& d) { return over_runs(d).rms_nm_per_h; }},
    {"from noise alone, NM/h", [](const ExpectedDrift& d) { return rms_of(end_of(d).noise_m2, d); }},
    {"CEP, NM/h", [](const ExpectedDrift& d) { return over_runs(d).cep_nm_per_h; }},
    {"R95, NM/h", [](const ExpectedDrift& d) { return over_runs(d).r95_nm_per_h; }},
};

constexpr std::string_view calibration_verdict = "calibrated";  // there is no other

constexpr double clearly = 4.0;  // sigmas from which a coefficient is shown on the terminal

// Returns keys and values; a coefficient that is not seen has its 95 % limit.
std::vector<std::pair<std::string, double>> noise_values(const SinglePose& pose) {
  std::vector<std::pair<std::string, double>> values;
  for (std::size_t channel = 0; channel < 6; ++channel)
    for (std::size_t term = 0; term < allan_terms; ++term) {
      const AllanFit& fit = pose.noise.axes[channel].fit;
      const AllanCoefficient& c = fit.terms[term];
      const AllanUnit& unit = allan_unit(channel < 3, term);
      const bool seen = c.value != 0.0;
      const std::string key = fmt::format("{}.{}_{}", unit.name, "xyz"[channel % 3], unit.unit);
      if (fit.made) values.emplace_back(seen ? key : "limit." + key, (seen ? c.value : c.limit) / unit.si);
      if (seen) values.emplace_back("sigma." + key, c.sigma / unit.si);
    }
  return values;
}

std::string row_name(const PredictedEffect& effect) {
  return effect.column.key() + (effect.column.tau_s > 0.0 ? fmt::format(" ({:g} s)", effect.column.tau_s) : "");
}

void add_confusions(const NamedPrediction& column, Document& document) {
  std::map<std::string, std::set<std::string>> aliases;
  std::vector<std::string> unseen;
  for (const PredictedEffect& effect : column.prediction.effects) {
    if (!effect.visible) unseen.push_back(row_name(effect));
    if (effect.among_its_own)
      aliases[std::string(effect.column.entry->name)].insert("other components of the same effect");
    for (const std::string& alias : effect.aliases) aliases[std::string(effect.column.entry->name)].insert(alias);
  }
  document.text(column.name + ": " + (aliases.empty() ? "no confounded effects" : "confounded effects (~)"));
  for (const auto& [name, others] : aliases)
    document.text("  " + name + " with " + join({others.begin(), others.end()}));
  document.text(column.name + ": not detectable (-): " + (unseen.empty() ? "none" : join(unseen)));
}

}  // namespace

Table result_table(const ParameterFile& file, const std::optional<ParameterVector>& truth) {
  Table table{{name("name"), wide("meaning"), text("unit"), number("estimate"), number("truth"), number("sigma"),
               number("error/sigma")}};
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    const auto at = Eigen::Index(i);
    const double estimate = file.parameters[at], sigma = file.sigma[i].value_or(0.0);
    const double true_value = truth ? (*truth)[at] : 0.0, error = (estimate - true_value) / sigma;
    table.row({name(parameter_keys[i]), wide(quantity_name(parameter_keys[i])),
               text(unit_text(parameter_unit(parameter_keys[i], file.gyro_increment))), with_sigma(estimate, sigma),
               with_sigma(true_value, sigma), sigma > 0.0 ? number(sigma, 2) : number("-"),
               sigma > 0.0 ? number(fmt::format("{:+.2f}", error), error) : number("-")});
  }
  if (!truth) {
    table.drop(6);
    table.drop(4);
  }
  return table;
}

Document calibration_document(const ParameterFile& file, const std::vector<std::string>& notes,
                              const std::optional<ParameterVector>& truth) {
  Document document{"turncal calibration, unit " + file.unit_serial, "Calibration, unit " + file.unit_serial};
  document.soft(fmt::format("Recording with content {}; method {}; latitude {}°, gravity {} m/s².", file.recording_hash,
                            file.method, file.latitude_deg, file.gravity_mps2));
  if (file.simulated)
    document.add(Paragraph{"Simulated data: these are not the parameters of a real unit.", "loud"}, Scope::page);
  const bool trusted = is_trusted(file);
  const char* const found = "nothing contradicts the fit; turncal diagnose tests it further";
  document.add(verdict_facts(verdict_title(calibration_verdict), trusted, trusted ? found : why_not_trusted(file)),
               Scope::brief);
  for (const std::string& note : notes) document.add(Paragraph{note, "note"});
  document.section("parameters", "The 24 parameters");
  document.add(result_table(file, truth));
  document.soft("turncal " + file.software_version + ", " + file.time_utc);
  return document;
}

Result<std::string> format_calibration(const ParameterFile& file) {
  return "verdict = " + std::string(calibration_verdict) + "\n" + TRY(format_parameter_file(file));
}

void add_predicted_drift(const std::vector<std::pair<std::string, ExpectedDrift>>& columns, const DriftPlan& plan,
                         Document& document) {
  document.section("navigation",
                   fmt::format("Free navigation for {:g} s at rest, level, front north, aligned for {:g} s; one sigma",
                               plan.free_s, plan.align_s));
  Table table{{text("drift")}};
  for (const auto& [name, drift] : columns) table.head.push_back(number(name));
  for (const DriftRow& row : drift_rows) {
    std::vector<Cell> cells = {text(row.name)};
    for (const auto& [name, drift] : columns) cells.push_back(number(row.value(drift)));
    table.row(std::move(cells));
  }
  document.add(std::move(table));
}

Facts pose_facts(const SinglePose& pose) {
  Facts facts;
  for (std::size_t channel = 0; channel < 6; ++channel) {
    std::vector<std::string> terms;
    for (std::size_t term = 0; term < allan_terms; ++term)
      terms.push_back(fmt::format("{} {} {}", allan_letters[term],
                                  allan_cell(pose.noise.axes[channel].fit, channel < 3, term).words,
                                  allan_unit(channel < 3, term).shown));
    facts.add(channel_names[channel], join(terms));
  }
  int hidden = 0;
  for (const PoseCoefficient& c : pose.coefficients) {
    if (std::abs(c.value) < clearly * c.sigma) {
      ++hidden;
      continue;
    }
    facts.add("change", fmt::format("{} = {}{}{}", c.key, quantity(c.value, c.sigma, c.unit),
                                    c.tau_s > 0.0 ? ", tau " + significant(c.tau_s, 3) + " s" : "",
                                    c.alias ? " (time and temperature cannot be told apart here)" : ""));
  }
  if (hidden > 0) facts.add("change", fmt::format("{} further coefficients are below 4 sigma", hidden));
  return facts;
}

std::string format_pose(const SinglePose& pose, const std::string& why_not_trusted) {
  KeyValues lines;
  lines.comment(fmt::format("turncal diagnosis: one pose, {:.10g} s; noise and slow changes only", pose.duration_s));
  lines.text("verdict", to_string(Verdict::not_tested));
  lines.text("effects", "");
  lines.flag("quality.trusted", false);
  lines.text("quality.reason", why_not_trusted);
  for (const auto& [key, value] : noise_values(pose)) lines.number("noise." + key, value);
  for (const PoseCoefficient& c : pose.coefficients) {
    lines.number("coefficient." + c.key, c.value);
    lines.number("sigma.coefficient." + c.key, c.sigma);
    if (c.tau_s > 0.0) lines.number("coefficient." + c.key + ".tau_s", c.tau_s);
  }
  return lines.take();
}

std::vector<NumberColumn> residual_columns(const Diagnosis& diagnosis) {
  std::vector<NumberColumn> columns;
  const auto add = [&](const std::string& name, auto value) {
    NumberColumn& column = columns.emplace_back(NumberColumn{name, {}});
    for (const ResidualPoint& point : diagnosis.residuals) column.values.push_back(value(point));
  };
  const auto add_each = [&](const std::string& name, const std::array<const char*, 3>& axes, const std::string& unit,
                            Eigen::Vector3d ResidualPoint::*vector) {
    for (std::size_t k = 0; k < 3; ++k)
      add(name + axes[k] + unit, [vector, k](const ResidualPoint& point) { return (point.*vector)[Eigen::Index(k)]; });
  };
  add("time_s", [](const ResidualPoint& point) { return point.time_s; });
  add("segment", [](const ResidualPoint& point) { return double(point.segment + 1); });
  add("since_rotation_s", [](const ResidualPoint& point) {
    return point.since_rotation_s <= point.time_s ? point.since_rotation_s : std::numeric_limits<double>::quiet_NaN();
  });
  add("temperature_c", [](const ResidualPoint& point) { return point.temperature_c; });
  add_each("force_", body_names, "_mps2", &ResidualPoint::f_b_mps2);
  add_each("velocity_before_", n_names, "_mps", &ResidualPoint::velocity_before_mps);
  add_each("velocity_after_", n_names, "_mps", &ResidualPoint::velocity_after_mps);
  add_each("normalised_before_", n_names, "", &ResidualPoint::normalised_before);
  add_each("normalised_after_", n_names, "", &ResidualPoint::normalised_after);
  return columns;
}

std::string describe(const Undetermined& direction) {
  std::vector<std::string> terms;
  for (const auto& [key, weight] : direction.combination) terms.push_back(fmt::format("{:+.2f} {}", weight, key));
  return join(terms, " ");
}

Table sigma_table(const std::vector<NamedPrediction>& columns, const RecordingInfo& info) {
  Table table{{name("sigma"), wide("of"), text("unit")}};
  for (std::size_t c = 0; c < columns.size(); ++c) {
    table.head.push_back(number(columns[c].name));
    if (c > 0) table.head.push_back(number("ratio"));
  }
  const Prediction& first = columns.front().prediction;
  for (const int k : free_parameters()) {
    const auto at = Eigen::Index(k);
    std::vector<Cell> row = {name(parameter_keys[k]), wide(quantity_name(parameter_keys[k])),
                             text(unit_text(parameter_unit(parameter_keys[k], info.gyro_increment)))};
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const Prediction& p = columns[c].prediction;
      row.push_back(p.determined[k] ? number(p.sigma[at]) : number("-"));
      if (c > 0)
        row.push_back(p.determined[k] && first.determined[k] ? fixed(p.sigma[at] / first.sigma[at], 2) : number("-"));
    }
    table.row(std::move(row));
  }
  return table;
}

void add_undetermined(const std::vector<NamedPrediction>& columns, Document& document) {
  for (const NamedPrediction& column : columns) {
    std::vector<std::string> lost;
    for (std::size_t k = 0; k < parameter_keys.size(); ++k)
      if (parameter_is_free[k] && !column.prediction.determined[k]) lost.emplace_back(parameter_keys[k]);
    document.text(column.name +
                  (lost.empty() ? ": all 21 parameters are determined" : ": not determined: " + join(lost, " ")));
    if (lost.empty()) continue;
    for (const Undetermined& direction : column.prediction.undetermined)
      document.text("  combination, in plausible ranges: " + describe(direction));
  }
}

void add_detectable(const std::vector<NamedPrediction>& columns, Document& document) {
  document.section("effects", "Smallest effect caught (5 sigma, alone)");
  Table table{{name("effect"), text("unit")}};
  for (const NamedPrediction& column : columns)
    for (const Cell& head : {number(column.name), text("~")}) table.head.push_back(head);
  for (std::size_t row = 0; row < columns.front().prediction.effects.size(); ++row) {
    const PredictedEffect& first = columns.front().prediction.effects[row];
    std::vector<Cell> cells = {name(row_name(first)), text(first.column.entry->unit)};
    for (const NamedPrediction& column : columns) {
      const PredictedEffect& effect = column.prediction.effects[row];
      cells.push_back(effect.visible ? number(effect.detectable) : number("-"));
      cells.push_back(text(effect.visible && (!effect.aliases.empty() || effect.among_its_own) ? "~" : ""));
    }
    table.row(std::move(cells));
  }
  document.add(std::move(table));
  for (const NamedPrediction& column : columns) add_confusions(column, document);
}

}  // namespace turncal
