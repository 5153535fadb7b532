#include "orchestrator/report/result_table.h"

#include <cmath>
#include <cstdio>
#include <string>

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

}  // namespace turncal
