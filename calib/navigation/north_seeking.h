// North seeking on a table: how well a unit finds its heading, and how well it repeats it.
//
// Wang (2020), 4.2 and Table 2: the mean of two searches sets the table's zero; then the unit is turned to headings 0, 90, 180
// and 270 and aligned four times in each. For head, roll and pitch of each position the paper prints the mean and the "mean
// square deviation", which is the sample standard deviation, with n - 1 (docs/verification.md):
//   s^2 = sum (x_k - mean)^2 / (n - 1)
// Degrees. Headings are printed near the angle of the table: -0.01, not 359.99.
#pragma once

#include <array>
#include <span>
#include <vector>

namespace turncal {

// Three angles are in this order, that of the paper's table.
inline constexpr std::array<const char*, 3> north_angle_names = {"heading", "roll", "pitch"};

struct NorthReading {
  double table_deg = 0.0;  // angle of the table
  std::array<double, 3> angle_deg{};
  std::array<double, 3> noise_sigma_deg{};  // from the noise of the sensors, for one alignment
  std::array<double, 3> total_sigma_deg{};  // from noise and calibration
};

struct NorthPosition {
  double table_deg = 0.0;
  std::vector<NorthReading> readings;  // headings from the table's zero, near table_deg
  std::array<double, 3> mean_deg{};
  std::array<double, 3> deviation_deg{};    // sample standard deviation
  std::array<double, 3> noise_sigma_deg{};  // expected from noise alone
};

// The figures that are judged: for each angle the largest deviation of a position; and the root mean square, over the
// positions, of the mean heading less the table's. The last alone shows a calibration that is wrong but steady.
struct NorthFigure {
  double value_deg = 0.0;
  double sigma_deg = 0.0;  // of the value, from noise; of the means also from the calibration
};
struct NorthSeeking {
  double zero_deg = 0.0;  // heading of the unit with the table at 0: the mean of the searches
  std::vector<NorthPosition> positions;
  std::array<NorthFigure, 3> deviation;  // of each angle
  NorthFigure mean_heading;              // rms of the means from the table's angle
  double worst_heading_error_deg = 0.0;  // of a single reading, with its sign; not judged
  std::size_t searches = 0;
};

// Returns the probability that a unit with nothing but its noise in the readings fails: any of the four figures above
// its limit. Deviations are chi-square. The squares of the means, which share the zero's error, are taken as chi-square
// of the same mean and variance (Satterthwaite (1946)), and the figures as independent.
double false_fail_probability(const NorthSeeking& found, double heading_limit_deg, double level_limit_deg);

// Returns the factor by which the alignments must be longer for that probability, of the headings alone, to be at most
// `chance`. In the variance of a heading the part of the angle random walk (`walk_sigma_deg`, N / (W cos L sqrt(T)))
// falls with 1 / T, the rest, velocity noise, with 1 / T^3. From 1 to 1e9.
double longer_alignment(const NorthSeeking& found, double heading_limit_deg, double chance, double walk_sigma_deg);

// Mean and sample standard deviation.
struct Spread {
  double mean = 0.0;
  double deviation = 0.0;
};
Spread spread_of(std::span<const double> values);

// REQUIRES: at least one search, and two readings in each position. Consecutive readings at one angle form a position.
NorthSeeking seek_north(std::span<const NorthReading> searches, std::span<const NorthReading> readings);

// Returns the angle nearest to `near_deg` among angle_deg + 360 k.
double near(double angle_deg, double near_deg);

// Readings beside those of references without drift (an azimuth extractor, a level): Wang (2020), 4.3 and Table 3. The
// first row binds the references to the unit, so its errors are zero:
//   error = unit - (reference - (reference_1 - unit_1))
struct ReferenceRow {
  std::array<double, 3> unit_deg{}, reference_deg{};
};
struct ReferenceComparison {
  std::vector<std::array<double, 3>> error_deg;  // one per row
  std::array<double, 3> worst_deg{};             // largest size
  std::array<double, 3> rms_deg{};               // of the rows after the first
};
// REQUIRES: at least two rows
ReferenceComparison compare_references(std::span<const ReferenceRow> rows);

}  // namespace turncal
