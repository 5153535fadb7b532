// North seeking on a table: how well a unit finds its heading, and how well it finds it again.
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
  double table_deg = 0.0;  // where the table stood
  std::array<double, 3> angle_deg{};
  std::array<double, 3> noise_sigma_deg{};  // from the noise of the sensors, of one alignment
  std::array<double, 3> total_sigma_deg{};  // and from the calibration
};

struct NorthPosition {
  double table_deg = 0.0;
  std::vector<NorthReading> readings;  // headings from the table's zero, near table_deg
  std::array<double, 3> mean_deg{};
  std::array<double, 3> deviation_deg{};    // sample standard deviation
  std::array<double, 3> noise_sigma_deg{};  // what the noise alone would give
};

// What is judged. Of each angle the largest deviation of a position; and whether the headings are right, not only alike: the root
// mean square, over the positions, of mean heading less the table's. A calibration that is wrong but steady shows there alone.
struct NorthFigure {
  double value_deg = 0.0;
  double sigma_deg = 0.0;  // of the value, from noise; of the means from the calibration, too
};
struct NorthSeeking {
  double zero_deg = 0.0;  // heading of the unit where the table stands at 0: the mean of the searches
  std::vector<NorthPosition> positions;
  std::array<NorthFigure, 3> deviation;  // of each angle
  NorthFigure mean_heading;              // rms of the means from the table's angle
  double worst_heading_error_deg = 0.0;  // of a single reading, with its sign; not judged
  std::size_t searches = 0;
};

// How often a unit would be turned down though nothing but its noise is in the readings: any of the four figures above its limit.
// Deviations are chi-square; the squares of the means, which share the zero's error, are taken as chi-square of the same mean and
// variance (Satterthwaite (1946)); the figures as independent.
double false_fail_probability(const NorthSeeking& found, double heading_limit_deg, double level_limit_deg);

// By what factor the alignments would have to last longer for that chance, of the headings, to be at most `chance`. Of the variance of a
// heading, what angle random walk makes (`walk_sigma_deg`, N / (W cos L sqrt(T))) goes with 1 / T, the remainder, velocity noise, with
// 1 / T^3. At least 1; no more than 1e9.
double longer_alignment(const NorthSeeking& found, double heading_limit_deg, double chance, double walk_sigma_deg);

// Mean and sample standard deviation.
struct Spread {
  double mean = 0.0;
  double deviation = 0.0;
};
Spread spread_of(std::span<const double> values);

// REQUIRES: at least one search, and two readings in each position (a single one has no deviation). Readings in order; those that follow each other at one angle are a position.
NorthSeeking seek_north(std::span<const NorthReading> searches, std::span<const NorthReading> readings);

// The angle nearest to `near_deg` among angle_deg + 360 k.
double near(double angle_deg, double near_deg);

// Readings beside those of references without drift (an azimuth extractor, a level): Wang (2020), 4.3 and Table 3. The references
// are bound to the unit by the first row, whose errors are zero:
//   error = unit - (reference - (reference_1 - unit_1))
struct ReferenceRow {
  std::array<double, 3> unit_deg{}, reference_deg{};
};
struct ReferenceComparison {
  std::vector<std::array<double, 3>> error_deg;  // a row each
  std::array<double, 3> worst_deg{};             // largest size
  std::array<double, 3> rms_deg{};               // of the rows after the first
};
// REQUIRES: at least two rows
ReferenceComparison compare_references(std::span<const ReferenceRow> rows);

}  // namespace turncal
