// Noise of one triad: what is added to the three true increments of a sample.
//
//   white       N sqrt(dt) * normal                                        random walk of angle or velocity
//   flicker     sum over j of Markov processes, tau_j = longest / 4^j down to a quarter second or so, each with
//               variance B^2 ln 4 / pi: their spectra add up to B^2 / (2 pi f), whose Allan deviation is
//               B sqrt(2 ln 2 / pi) = 0.664 B (IEEE 952 annex C). Stationary from the first sample.
//   rate walk   K sqrt(t): random walk of the bias, from 0
//
// Flicker and rate walk are held constant over tau/16 and 0.1 s: their steps are far below the white noise, and a
// sample costs three normal numbers. SI units: N in rad/sqrt(s) or m/s/sqrt(s), B in rad/s or m/s^2, K in that per
// sqrt(s).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "turntable_drivers/rig/rig_math.h"

namespace turncal::rig_model {

struct NoiseSize {
  double white = 0.0;
  double flicker = 0.0;
  double flicker_longest_s = 1000.0;
  double rate_walk = 0.0;
};

class TriadNoise {
 public:
  // Streams 3 * triad + 1 .. + 3 of the seed are used.
  TriadNoise(const NoiseSize& size, double period_s, std::uint64_t seed, std::uint64_t triad);
  // Increments of the next sample, added to `increment`.
  void add(std::array<double, 3>& increment);
  // Sum of flicker and rate walk in force, rate units.
  const std::array<double, 3>& bias() const { return bias_; }

 private:
  struct Markov {
    double decay = 0.0;
    double kick = 0.0;
    std::int64_t every = 1;
    std::array<double, 3> value{};
  };
  void update_bias();

  double period_s_;
  double white_sigma_;
  double walk_kick_;
  std::int64_t walk_every_;
  std::int64_t grid_ = 1;  // samples between updates of the fastest process
  std::int64_t sample_ = 0;
  std::int64_t until_update_ = 0;
  bool drifts_;
  std::vector<Markov> processes_;
  std::array<double, 3> walk_{};
  std::array<double, 3> bias_{};
  RandomStream white_, flicker_, walk_stream_;
};

}  // namespace turncal::rig_model
