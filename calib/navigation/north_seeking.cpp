#include "calib/navigation/north_seeking.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr double same_angle_deg = 1e-6;

std::vector<double> column(const std::vector<NorthReading>& readings, std::size_t angle) {
  std::vector<double> values;
  values.reserve(readings.size());
  for (const NorthReading& reading : readings) values.push_back(reading.angle_deg[angle]);
  return values;
}

void summarise(NorthPosition& position) {
  for (std::size_t a = 0; a < 3; ++a) {
    const Spread spread = spread_of(column(position.readings, a));
    position.mean_deg[a] = spread.mean;
    position.deviation_deg[a] = spread.deviation;
    double squares = 0.0;
    for (const NorthReading& reading : position.readings)
      squares += reading.noise_sigma_deg[a] * reading.noise_sigma_deg[a];
    position.noise_sigma_deg[a] = std::sqrt(squares / static_cast<double>(position.readings.size()));
  }
}

}  // namespace

double near(double angle_deg, double near_deg) { return near_deg + std::remainder(angle_deg - near_deg, 360.0); }

Spread spread_of(std::span<const double> values) {
  const auto n = static_cast<double>(values.size());
  double sum = 0.0, squares = 0.0;
  for (const double x : values) sum += x;
  const double mean = sum / n;
  for (const double x : values) squares += (x - mean) * (x - mean);
  return {mean, values.size() > 1 ? std::sqrt(squares / (n - 1.0)) : 0.0};
}

NorthSeeking seek_north(std::span<const NorthReading> searches, std::span<const NorthReading> readings) {
  NorthSeeking result;
  // About the first search, so that 359.99 and 0.01 have the mean 0.
  double sum = 0.0;
  const double first = searches.front().angle_deg[0] - searches.front().table_deg;
  for (const NorthReading& search : searches) sum += near(search.angle_deg[0] - search.table_deg, first);
  result.zero_deg = near(sum / static_cast<double>(searches.size()), 0.0);

  for (const NorthReading& reading : readings) {
    if (result.positions.empty() || std::abs(result.positions.back().table_deg - reading.table_deg) > same_angle_deg) {
      result.positions.emplace_back();
      result.positions.back().table_deg = reading.table_deg;
    }
    NorthReading zeroed = reading;
    zeroed.angle_deg[0] = near(reading.angle_deg[0] - result.zero_deg, reading.table_deg);
    result.positions.back().readings.push_back(zeroed);
    const double error = zeroed.angle_deg[0] - reading.table_deg;
    if (result.positions.size() + result.positions.back().readings.size() == 2 ||
        std::abs(error) > std::abs(result.worst_heading_error_deg)) {
      result.worst_heading_error_deg = error;
      result.worst_heading = zeroed;
    }
  }
  for (NorthPosition& position : result.positions) {
    summarise(position);
    for (std::size_t k = 0; k < 2; ++k) {
      if (position.deviation_deg[k + 1] < result.worst_level_deviation_deg[k]) continue;
      result.worst_level_deviation_deg[k] = position.deviation_deg[k + 1];
      // A sample standard deviation of n readings scatters by sigma / sqrt(2 (n - 1)).
      const double n = std::max(2.0, static_cast<double>(position.readings.size()));
      result.level_sigma_deg[k] = position.noise_sigma_deg[k + 1] / std::sqrt(2.0 * (n - 1.0));
    }
  }
  return result;
}

ReferenceComparison compare_references(std::span<const ReferenceRow> rows) {
  ReferenceComparison result;
  for (const ReferenceRow& row : rows) {
    std::array<double, 3> error{};
    for (std::size_t a = 0; a < 3; ++a) {
      const double bound = rows.front().reference_deg[a] - rows.front().unit_deg[a];
      error[a] = std::remainder(row.unit_deg[a] - (row.reference_deg[a] - bound), 360.0);
      result.worst_deg[a] = std::max(result.worst_deg[a], std::abs(error[a]));
      result.rms_deg[a] += error[a] * error[a];
    }
    result.error_deg.push_back(error);
  }
  for (double& rms : result.rms_deg) rms = std::sqrt(rms / static_cast<double>(rows.size() - 1));
  return result;
}

}  // namespace turncal
