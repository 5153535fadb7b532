// Searches for the best sequence for a purpose: the walk, within a given time, with the least predicted sigmas relative to their aims.
//
//   cost(walk) = mean over the parameters of ln(sigma / aim)  +  60 max(0, ln(sigma / aim))     (AimAt::mean)
//              = the largest ln(sigma / aim)                                                    (AimAt::worst)
//   + the mean of ln(detectable / aim) over the requested effect components, with the same excess
// sigma and detectable are those of predict() (calib/prediction/predict.h): the filter and the estimator of a calibration, on the recording
// of an ideal unit. An undetermined parameter counts as a sigma of e^10 times its aim.
//
// Search: exchange (Fedorov 1972; Atkinson, Donev and Tobias, Optimum Experimental Designs, 2007, ch. 12; criteria: Pukelsheim, Optimal
// Design of Experiments, 2006). A leg is changed, inserted, removed or moved, or its rest made longer or shorter. A better walk is kept, and
// in the first part of the tries a slightly worse one, too (threshold accepting). The rests share the time that the turns leave, so that all
// walks last as long as allowed; at most two turns follow each other without a rest. The seed gives all random numbers: the same task
// gives the same walk on every machine.
//
// Walks are judged at 20 samples a second: the sigmas of a 200 Hz unit to a few parts in a thousand, at a tenth of the time.
// Not in the cost: time to home, effects not asked for, errors of the table.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/prediction/predict.h"
#include "calib/prediction/separation.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/station/verdict.h"
#include "sequences/plan.h"
#include "sequences/walk.h"

namespace turncal {

enum class AimAt { mean, worst };

struct DesignTask {
  PlanLimits limits;
  RecordingInfo info;                           // period, site, increments of the unit
  PredictOptions predict;                       // noise of the unit
  double time_s = 0.0;                          // of the whole run, without the way to the start
  std::array<bool, 3> turns{true, true, true};  // which axes may turn, indexed by Axis
  std::vector<double> rates_degps{10.0};        // choices, as far as the axis allows; the first is that of the file
  double acceleration_degps2 = 20.0;
  double least_rest_s = 10.0;
  ParameterVector aim;  // sigma, file units; 0: this parameter does not count
  AimAt criterion = AimAt::mean;
  // Replaces the cost above, for the motion as a unit of this period records it. The search ends when it is 0.
  std::function<double(const PlannedMotion&, double sample_period_s)> judged_by;
  std::vector<std::string> effects;          // names of the catalogue
  std::vector<PredictedEffect> effect_aims;  // aims: `detectable` of each component
  Walk start;                                // where the search begins; the table must be able to run it (on_table())
  std::uint64_t seed = 1;
  int tries = 1500;
};

struct DesignProgress {
  int done = 0, tries = 0;
  double cost = 0.0;  // cost of the best walk so far
  std::size_t legs = 0;
};

struct Design {
  Walk walk;  // rests in the unit's samples
  double cost = 0.0;
  double start_cost = 0.0;
};

// Searches for the best walk. Errors (input): not even a rest fits into the time; no axis may turn. progress is called from time to time and ends the
// search by returning false.
Result<Design> design_walk(const DesignTask& task, const std::function<bool(const DesignProgress&)>& progress);

// Returns a lower bound of the mean of ln(sigma / aim), or of the largest with AimAt::worst, for every walk that design_walk() may try
// (calib/prediction/design_bound.h). Excess over an aim, and effects, are not considered. Empty: the turns leave a parameter undetermined.
std::optional<double> design_bound(const DesignTask& task);

// `turncal design --separate`: the shortest walk that separates the effects of an alias class (calib/prediction/separation.h).
//
//   cost(walk) = sum over the ordered pairs of max(0, ln(separating_gain / expected gain))
// The search begins with the longest time allowed and shortens it, starting from the walk found, until cost 0 is not reached.
struct ExtraLegs {
  Walk walk;
  double time_s = 0.0;
  std::vector<AliasPair> after;  // pairs after the walk
  double further = 0.0;          // rest of the task's own cost, beside the pairs
  bool apart = false;            // every pair is separated, and `further` is 0
};

// `task`: time_s is the longest time allowed; its judged_by, if any, is added to the cost. Without `separation` that is all of it. Errors of
// design_walk().
Result<ExtraLegs> find_extra_legs(const Separation* separation, DesignTask task,
                                  const std::function<void(double time_s)>& looking);

// The legs that a run adds to its plan when another minute is worth it (docs/sequences.md): its diagnosis cannot separate effects, or a parameter
// is not known well enough. The cost then also has the sum of max(0, ln(expected sigma / needed)). The legs keep to poses that the plan's
// cable leaves, and are worth it when the worst pair is separated with a chance of worth_a_try, or every sigma is expected to be enough.
// The same samples give the same legs. Not modelled: the time of the search (10 to 60 s, with the table at rest and watched).
inline constexpr double least_settling_s = 60.0;  // with less time nothing is searched
inline constexpr double worth_a_try = 0.1;

std::string words_of(const NeededSigma& sigma);  // "n11, 4.5e-07 where 4.2e-07 is enough"

struct SettlingTask {
  const CompressedRecording& recording;  // the recording so far
  const JointResult& base;               // its fit
  const Sequence& sequence;
  const Plan& plan;  // plan of `sequence`
  PlanLimits limits;
  double left_s = 0.0;
  std::vector<NeededSigma> needed = {};
};

// Returns nothing when the diagnosis leaves no doubt and every sigma is enough; why_not and no sequence when no legs help. Not set: unit.
std::optional<Settling> find_settling(const SettlingTask& task);

}  // namespace turncal
