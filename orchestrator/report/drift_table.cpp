#include "orchestrator/report/drift_table.h"

#include <cmath>
#include <cstdio>
#include <span>

#include "calib/navigation/navigation_error.h"

namespace turncal {
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

}  // namespace turncal
