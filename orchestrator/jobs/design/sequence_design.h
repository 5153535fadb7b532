// A sequence found for a purpose: the walk whose predicted sigmas are best in units of what is aimed at, within a given time.
//
//   cost(walk) = mean over the parameters of ln(sigma / aim)  +  60 max(0, ln(sigma / aim))     (AimAt::mean)
//              = the largest ln(sigma / aim)                                                    (AimAt::worst)
//   + the mean of ln(detectable / aim) over the effect components asked for, with the same excess
// sigma and detectable are those of predict() (calib/prediction/predict.h): the filter and the estimator of a calibration, on the recording
// of an ideal unit. A parameter that the walk does not determine counts as a sigma of e^10 times its aim.
//
// Search: exchange (Fedorov 1972; Atkinson, Donev and Tobias, Optimum Experimental Designs, 2007, ch. 12; criteria: Pukelsheim, Optimal
// Design of Experiments, 2006). A leg is changed, put in, taken out, moved, or its rest made longer or shorter; what is better stays, and for
// the first part of the tries what is a little worse, too (threshold accepting). The time that turns leave is shared out among the
// rests in the ratio of their shares, so that every walk that is judged lasts as long as may be; at most two turns have no rest between them. All random numbers come from the
// seed: the same task gives the same walk on every machine.
//
// The walks are judged at 20 samples a second: the sigmas of a 200 Hz unit to a few parts in a thousand, at a tenth of the time.
// Not in the cost: time to home, effects not asked for, what table errors do.
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
  PredictOptions predict;                       // its noise
  double time_s = 0.0;                          // of the whole run, the way to the start not counted
  std::array<bool, 3> turns{true, true, true};  // which axes may turn, indexed by Axis
  std::vector<double> rates_degps{10.0};        // to choose from, as far as the axis may; the first is that of the file
  double acceleration_degps2 = 20.0;
  double least_rest_s = 10.0;
  ParameterVector aim;  // sigma, file units; 0: this parameter does not count
  AimAt criterion = AimAt::mean;
  // Of a walk as a unit of this period would record it, what is made small in place of the cost above. The search ends where it is 0.
  std::function<double(const PlannedMotion&, double sample_period_s)> judged_by;
  std::vector<std::string> effects;          // names of the catalogue
  std::vector<PredictedEffect> effect_aims;  // what is aimed at: `detectable` of each component
  Walk start;                                // where the search begins: one that the table can make (on_table())
  std::uint64_t seed = 1;
  int tries = 1500;
};

struct DesignProgress {
  int done = 0, tries = 0;
  double cost = 0.0;  // of the best so far
  std::size_t legs = 0;
};

struct Design {
  Walk walk;  // rests in samples of the unit
  double cost = 0.0;
  double start_cost = 0.0;
};

// Errors (input): not even a rest fits into the time; no axis may turn. progress is called now and then and ends the search
// by returning false.
Result<Design> design_walk(const DesignTask& task, const std::function<bool(const DesignProgress&)>& progress);

// What no walk that design_walk() may try has its mean of ln(sigma / aim) below; with AimAt::worst, its largest
// (calib/prediction/design_bound.h). What is above its aim, and effects, are not looked at. Nothing: the turns leave a parameter open.
std::optional<double> design_bound(const DesignTask& task);

// `turncal design --separate`: the shortest walk that tells the effects of an alias class apart (calib/prediction/separation.h).
//
//   cost(walk) = sum over the ordered pairs of max(0, ln(separating_gain / gain expected))
// is searched for in the longest time allowed; then in less and less of it, from what was found, until it is not reached.
struct ExtraLegs {
  Walk walk;
  double time_s = 0.0;
  std::vector<AliasPair> after;  // with the walk, too
  double further = 0.0;          // what is left of the cost that the task has beside the pairs
  bool apart = false;            // every pair is told apart, and nothing further is left
};

// `task`: time_s is the longest that is allowed; its judged_by, where it has one, is added to the cost. No separation: that alone. Errors of
// design_walk().
Result<ExtraLegs> find_extra_legs(const Separation* separation, DesignTask task,
                                  const std::function<void(double time_s)>& looking);

// What a run adds to its plan where a minute more is worth it (docs/sequences.md): its diagnosis cannot tell effects apart, or a parameter is not yet
// known as well as it has to be. Beside the pairs the cost has the sum of max(0, ln(sigma expected / needed)). The legs keep to the poses that
// the plan leaves to the cable, and are worth it when the worst pair is told with a chance of worth_a_try, or every sigma is expected to be enough.
// The same samples give the same legs. Not modelled: how long the search takes (10 to 60 s, the table at rest and under watch meanwhile).
inline constexpr double least_settling_s = 60.0;  // for less nothing is looked for
inline constexpr double worth_a_try = 0.1;

std::string words_of(const NeededSigma& sigma);  // "n11, 4.5e-07 where 4.2e-07 is enough"

struct SettlingTask {
  const CompressedRecording& recording;  // so far
  const JointResult& base;               // its fit
  const Sequence& sequence;
  const Plan& plan;  // of it
  PlanLimits limits;
  double left_s = 0.0;
  std::vector<NeededSigma> needed = {};
};

// Nothing: the diagnosis leaves no doubt, and every sigma is enough. Without a sequence: nothing was found that would help, and why_not. The unit is not set.
std::optional<Settling> find_settling(const SettlingTask& task);

}  // namespace turncal
