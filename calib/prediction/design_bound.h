// How far from the best a walk may be: a mean of ln(sigma / aim) that no walk of the given turns is below, however it is put together.
//
// What a walk tells is at most the sum of what its turns and rests would tell, had somebody said between them what the attitude error is:
// a number that hangs on the pose and the parameters alone. Whatever is said, saying it only adds information; said is a part of
// what levelling in that pose would be wrong by. Heading is not said: it is free, and only the Earth's rate brings it back.
// With additive information the general equivalence theorem (Kiefer and Wolfowitz 1960; Pukelsheim, Optimal Design of
// Experiments, ch. 7 and 11) bounds the continuous design of the same time. For Psi(M) = -mean_k ln (M^-1)_kk, concave, Psi(cM) = Psi(M) + ln c,
// and any positive definite M with gradient G
//   Psi(walk) <= Psi(M) + ln <G, M(walk)>,   <G, M(walk)> <= T max_i <G, m_i> / t_i + H
// over all candidates i that take t_i; H is what the heading that was left free can tell. M is improved by multiplicative
// steps (Titterington 1976) until the bound is hardly better. docs/sequences.md derives it.
//
// Not in it: what depends on the Earth's rate times a scale error (1e-5 of the information), quantisation, bias instability, the cable:
// all of them make the best walk worse, or do not matter.
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
  std::array<std::vector<double>, 3>
      poses_deg;                  // where a rest may be and a turn may begin, indexed by Axis; one: this axis stands
  std::vector<double> turns_deg;  // above zero; each may go either way
  std::vector<double> rates_degps;
  bool worst = false;   // bounds the largest ln(sigma / aim) in place of the mean
  ParameterVector aim;  // sigma, file units; 0: this parameter does not count
};

// Nothing where the candidates do not determine what counts.
std::optional<double> least_log_sigma(const BoundTask& task);

}  // namespace turncal
