#include "calib/navigation/north_seeking.h"

#include <algorithm>
#include <cmath>

#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

constexpr double same_angle_deg = 1e-6;

void summarise(NorthPosition& position) {
  for (std::size_t a = 0; a < 3; ++a) {
    std::vector<double> angles;
    double squares = 0.0;
    for (const NorthReading& reading : position.readings) {
      angles.push_back(reading.angle_deg[a]);
      squares += reading.noise_sigma_deg[a] * reading.noise_sigma_deg[a];
    }
    const Spread spread = spread_of(angles);
    position.mean_deg[a] = spread.mean;
    position.deviation_deg[a] = spread.deviation;
    position.noise_sigma_deg[a] = std::sqrt(squares / double(position.readings.size()));
  }
}

// Returns the variance of a mean heading less the table's. Noise: of the mean and of the zero. Calibration: an error fixed in the
// unit turns with it, so over the quarters of the circle the square left after the zero is twice that of a single alignment.
double mean_variance(const NorthPosition& position, std::size_t searches) {
  double noise = 0.0, calibration = 0.0;
  for (const NorthReading& reading : position.readings) {
    const double own = reading.noise_sigma_deg[0] * reading.noise_sigma_deg[0];
    noise += own;
    calibration += std::max(0.0, reading.total_sigma_deg[0] * reading.total_sigma_deg[0] - own);
  }
  const auto n = double(position.readings.size());
  return noise / n * (1.0 / n + 1.0 / double(searches)) + 2.0 * calibration / n;
}

}  // namespace

double near(double angle_deg, double near_deg) { return near_deg + std::remainder(angle_deg - near_deg, 360.0); }

Spread spread_of(std::span<const double> values) {
  const auto n = double(values.size());
  double sum = 0.0, squares = 0.0;
  for (const double x : values) sum += x;
  const double mean = sum / n;
  for (const double x : values) squares += (x - mean) * (x - mean);
  return {mean, values.size() > 1 ? std::sqrt(squares / (n - 1.0)) : 0.0};
}

NorthSeeking seek_north(std::span<const NorthReading> searches, std::span<const NorthReading> readings) {
  NorthSeeking result;
  // Averages about the first search, so that 359.99 and 0.01 have the mean 0.
  double sum = 0.0;
  const double first = searches.front().angle_deg[0] - searches.front().table_deg;
  for (const NorthReading& search : searches) sum += near(search.angle_deg[0] - search.table_deg, first);
  result.zero_deg = near(sum / double(searches.size()), 0.0);

  for (const NorthReading& reading : readings) {
    if (result.positions.empty() || std::abs(result.positions.back().table_deg - reading.table_deg) > same_angle_deg) {
      result.positions.emplace_back();
      result.positions.back().table_deg = reading.table_deg;
    }
    NorthReading zeroed = reading;
    zeroed.angle_deg[0] = near(reading.angle_deg[0] - result.zero_deg, reading.table_deg);
    result.positions.back().readings.push_back(zeroed);
    const double error = zeroed.angle_deg[0] - reading.table_deg;
    if (std::abs(error) > std::abs(result.worst_heading_error_deg)) result.worst_heading_error_deg = error;
  }
  result.searches = searches.size();
  double squares = 0.0, variance = 0.0;
  for (NorthPosition& position : result.positions) {
    summarise(position);
    const auto n = double(position.readings.size());
    for (std::size_t a = 0; a < 3; ++a) {
      if (position.deviation_deg[a] < result.deviation[a].value_deg) continue;
      // A sample standard deviation of n readings scatters by sigma / sqrt(2 (n - 1)).
      result.deviation[a] = {position.deviation_deg[a], position.noise_sigma_deg[a] / std::sqrt(2.0 * (n - 1.0))};
    }
    squares += std::pow(position.mean_deg[0] - position.table_deg, 2);
    variance += mean_variance(position, result.searches);
  }
  const auto count = double(result.positions.size());
  result.mean_heading = {std::sqrt(squares / count), std::sqrt(variance / count)};
  return result;
}

double false_fail_probability(const NorthSeeking& found, double heading_limit_deg, double level_limit_deg) {
  double passes = 1.0;
  // Sum of squares of the means: each has its own noise, and all share that of the zero.
  double trace = 0.0, of_squares = 0.0, zero = 0.0;
  for (const NorthPosition& position : found.positions) {
    const auto n = double(position.readings.size());
    for (std::size_t a = 0; a < 3; ++a) {
      const double limit = a == 0 ? heading_limit_deg : level_limit_deg;
      const double variance = std::pow(position.noise_sigma_deg[a], 2);
      if (variance > 0.0) passes *= 1.0 - chi_square_tail((n - 1.0) * limit * limit / variance, n - 1.0);
    }
    const double own = std::pow(position.noise_sigma_deg[0], 2) / n;
    zero = std::pow(position.noise_sigma_deg[0], 2) / double(found.searches);
    trace += own + zero;
    of_squares += own * own + 2.0 * own * zero;
  }
  const auto count = double(found.positions.size());
  of_squares += count * count * zero * zero;
  if (trace > 0.0)
    passes *= 1.0 - chi_square_tail(count * heading_limit_deg * heading_limit_deg * trace / of_squares,
                                    trace * trace / of_squares);
  return 1.0 - passes;
}

double longer_alignment(const NorthSeeking& found, double heading_limit_deg, double chance, double walk_sigma_deg) {
  constexpr double step = 1.02, most = 1e9, no_limit = 1e9;
  NorthSeeking scaled = found;
  double factor = 1.0;
  while (factor < most && false_fail_probability(scaled, heading_limit_deg, no_limit) > chance) {
    factor *= step;
    for (std::size_t k = 0; k < found.positions.size(); ++k) {
      const double variance = std::pow(found.positions[k].noise_sigma_deg[0], 2);
      const double walk = std::min(variance, walk_sigma_deg * walk_sigma_deg);
      scaled.positions[k].noise_sigma_deg[0] = std::sqrt(walk / factor + (variance - walk) / std::pow(factor, 3));
    }
  }
  return factor;
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
  for (double& rms : result.rms_deg) rms = std::sqrt(rms / double(rows.size() - 1));
  return result;
}

}  // namespace turncal
