// A bound on walks: a mean of ln(sigma / aim) that no walk of the given turns falls below, in whatever order.
//
// A walk tells at most the sum of what its turns and rests would tell if the attitude error between them were
// disclosed: a value that depends on the pose and the parameters alone. Any disclosure only adds information; a part of
// the levelling error in that pose is disclosed. Heading is not: it is free, and only the Earth's rate restores it.
// With additive information the general equivalence theorem (Kiefer and Wolfowitz 1960; Pukelsheim, Optimal Design of
// Experiments, ch. 7 and 11) bounds the continuous design of the same time. For Psi(M) = -mean_k ln (M^-1)_kk, concave, Psi(cM) = Psi(M) + ln c,
// and any positive definite M with gradient G
//   Psi(walk) <= Psi(M) + ln <G, M(walk)>,   <G, M(walk)> <= T max_i <G, m_i> / t_i + H
// over all candidates i that take t_i; H is what the free heading can tell. M is improved by multiplicative steps
// (Titterington 1976) until the bound hardly rises. docs/sequences.md derives it.
//
// Left out: terms of the Earth's rate times a scale error (1e-5 of the information), quantisation, bias instability,
// the cable. They make the best walk worse, or do not matter.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "calib/model/parameters.h"

namespace turncal {

struct BoundTask {
  RecordingInfo info;  // site, increments
  NoiseModel noise;
  double time_s = 0.0;
  double settle_s = 0.0;      // of every turn
  double least_rest_s = 0.0;  // after every turn, or every other one
  double acceleration_degps2 = 20.0;
  std::array<std::vector<double>, 3> poses_deg;  // of rests and beginnings of turns, by Axis; one: this axis is fixed
  std::vector<double> turns_deg;                 // above zero; each may go either way
  std::vector<double> rates_degps;
  bool worst = false;   // bounds the largest ln(sigma / aim) in place of the mean
  ParameterVector aim;  // sigma, file units; 0: this parameter does not count
};

// Returns the bound; none if the candidates do not determine the parameters that count.
std::optional<double> least_log_sigma(const BoundTask& task);

}  // namespace turncal
