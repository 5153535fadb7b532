// Overlapping Allan deviation of a unit at rest, and the noise coefficients of IEEE 952 (annex C) estimated from the same data.
//
// With theta the integral of a channel, cells of time tau0 and tau = m tau0,
//   avar(tau) = 1 / (2 tau^2 M) sum over k of d_k^2,   d_k = theta_{k+2m} - 2 theta_{k+m} + theta_k
// over every rest, rests pooled (NIST SP 1065, 5.2.4). In records of more than 2^20 samples k steps by cells of at most
// tau/8, and taus below 8 cells come from the first 2^18 samples.
//
// The model, by the two-sided spectrum S(f) of the rate, and its Allan variance:
//   Q quantisation        Q^2 (2 - 2 cos 2 pi f tau0) / tau0     3 Q^2 / tau^2
//   N random walk         N^2                                    N^2 / tau
//   B bias instability    B^2 / (2 pi f)                         (2 ln 2 / pi) B^2 = (0.664 B)^2
//   K rate random walk    K^2 / (2 pi f)^2                       K^2 tau / 3
//   R rate ramp           a rate that grows by R a second        R^2 tau^2 / 2
// The coefficients are not read off the curve, whose points are correlated, but off the cosine transform (DCT-II) of
// the cells of each rest, less their mean. White noise and a random walk are exactly uncorrelated in it, the others
// nearly. Averaged over eighths of an octave its power is S(f) chi^2 / n. The likelihood of that is maximised for every
// choice of terms (Fisher scoring; R by least squares, the others by restricted likelihood). A term is kept if without
// it, whatever else is chosen, -2 ln L rises by more than chance gives once in a hundred times. For the others a limit
// is given (95 %). A spectrum is trusted to 0.3 % in each eighth of an octave. What does not follow the model at high
// frequencies (the sensor's own filter, vibration) is cut off octave by octave; any remaining misfit widens the sigmas.
//
// Intervals of the deviation: chi-square with 2 E(avar)^2 / var(avar) degrees of freedom, from the covariances of d_k
// in the fitted model (Greenhall and Riley, 2003, for a sum of power laws instead of one; the mean of d_k is R tau^2).
//
// Gaps: cells without samples get the mean of the cells around them if the gap is at most a tenth of the rest before
// it; else a new rest begins. A term of avar(tau) that touches a gap longer than tau/10 is left out.
// Not modelled: periodic noise, and exponentially correlated noise; noise that changes with time or temperature.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"

namespace turncal {

struct AllanPoint {
  double tau_s = 0.0;
  double deviation = 0.0;        // rad/s or m/s^2
  double degrees = 0.0;          // equivalent degrees of freedom
  double low = 0.0, high = 0.0;  // 68.3 % interval of the true deviation
};

// SI: rad or m/s, then per sqrt(s), per s, per s^1.5, per s^2.
inline constexpr std::size_t allan_terms = 5;
inline constexpr std::array<const char*, allan_terms> allan_letters = {"Q", "N", "B", "K", "R"};
inline constexpr std::array<const char*, allan_terms> allan_names = {"quantisation", "random walk", "bias instability",
                                                                     "rate random walk", "rate ramp"};

struct AllanCoefficient {
  double value = 0.0;  // 0: not found; R has a sign
  double sigma = 0.0;
  double limit = 0.0;    // of a term not found: 95 % upper limit
  double gain = 0.0;     // rise of -2 ln L without it, costs of terms included
  unsigned instead = 0;  // terms that would then replace it, a bit each
};

struct AllanFit {
  std::array<AllanCoefficient, allan_terms> terms;  // Q N B K R
  const AllanCoefficient& quantisation() const { return terms[0]; }
  const AllanCoefficient& random_walk() const { return terms[1]; }
  const AllanCoefficient& bias_instability() const { return terms[2]; }
  const AllanCoefficient& rate_ramp() const { return terms[4]; }
  double highest_hz = 0.0;  // faster data do not follow the model, or there are none
  bool cut = false;         // the data have faster ones
  double misfit = 1.0;      // mean square residual over that of chance; above 1 it widens the sigmas
  bool fits = true;         // chance exceeds the misfit in one of a thousand records
  bool made = false;
};
// Allan variance of the model.
double allan_variance(const AllanFit& fit, double tau_s);

struct AllanAxis {
  std::vector<AllanPoint> points;
  AllanFit fit;
  // Returns the minimum that a datasheet may quote: the lowest deviation over 0.664; null without points.
  const AllanPoint* lowest() const;
};

// Axes in the order gyro x y z, accelerometer x y z.
struct AllanResult {
  std::array<AllanAxis, 6> axes;
  double total_s = 0.0;  // static time used
  double longest_s = 0.0;
};

// Readings at rest as means over cells of one length, in sequence within a rest.
struct RestCells {
  double cell_s = 1.0;
  std::vector<std::size_t> ends;            // of each rest, in cells
  std::array<std::vector<double>, 6> mean;  // rad/s, m/s^2; NaN where no sample came
  // For records too long for cells of one sample: the first samples, for taus and frequencies too short for the cells.
  double sample_s = 1.0;
  std::vector<std::size_t> first_ends;
  std::array<std::vector<double>, 6> first;
};

// Returns the equivalent degrees of freedom at tau; `spans`: for each rest, the time over which k runs, in steps of cell_s.
double equivalent_degrees(const AllanFit& fit, double tau_s, double step_s, const std::vector<double>& spans);

// Makes cells of consecutive samples, in bounded memory.
class RestCellMaker {
 public:
  explicit RestCellMaker(double sample_period_s);
  void begin_rest();
  void add(std::int64_t counter, const Channels& increments);
  // `si`: rad or m/s per increment of each channel.
  RestCells take(const Channels& si);

 private:
  static constexpr std::size_t most_cells = std::size_t{1} << 20;
  void close_cell();
  void halve();

  RestCells cells_;
  std::size_t a_cell_ = 1;  // samples
  std::optional<std::int64_t> first_, last_;
  std::int64_t cell_ = 0;  // of this rest, open
  Channels sum_ = Channels::Zero();
  std::size_t count_ = 0;
};

AllanResult allan_deviation(const RestCells& cells);
// Returns the deviation of the static dwells, by their seconds. Dwells shorter than `min_dwell_s` are left out.
AllanResult allan_deviation(const CompressedRecording& recording, const Parameters& parameters,
                            double min_dwell_s = 50.0);

}  // namespace turncal
