// The time constant of an effect by likelihood, and what it leaves open in the parameters.
//
// The selection knows a few time constants (EffectEntry::taus_s), some a factor of four apart; at the wrong one a warm-up, a creep or a scale
// factor that settles drags the parameters along, by nine of their sigma where the truth lay in the middle. One filter pass carries the effect's
// columns at many time constants beside the model: with each in the place of the effect, chi-square and parameters are one solve away
// (the model is linear in the effect). The best one of a grid that narrows is taken, and the parameters are averaged over the
// time constant by likelihood, with a prior even in its logarithm, from half the shortest of the list to twice the longest.
// Components of one effect have one time constant. Not modelled: two processes with a time constant each.
#pragma once

#include <string>
#include <vector>

#include "calib/diagnosis/diagnosis_model.h"

namespace turncal {

// Of every effect of m.chosen that has one: the model is fitted again with the best, at its noise.
void find_time_constants(DiagnosisModel& m);

struct OpenTime {
  std::string name;
  double tau_s = 0.0, log_sigma = 0.0;  // sigma of its logarithm
  // What of the covariance of m.current's free parameters and effects it accounts for: the sum of the squares of these.
  std::vector<Eigen::VectorXd> shifts;
};
std::vector<OpenTime> open_times(const DiagnosisModel& m);

}  // namespace turncal
