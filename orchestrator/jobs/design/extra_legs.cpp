#include "orchestrator/jobs/design/extra_legs.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr double shorter = 0.8;
constexpr double least_s = 60.0;

double cost_of(const std::vector<AliasPair>& pairs) {
  double cost = 0.0;
  for (const AliasPair& pair : pairs) cost += std::max(0.0, std::log(separating_gain / std::max(pair.gain, 1e-9)));
  return cost;
}

}  // namespace

Result<ExtraLegs> find_extra_legs(const Separation& separation, DesignTask task,
                                  const std::function<void(double time_s)>& looking) {
  ExtraLegs legs;
  legs.before = separation.pairs(nullptr, 0.0);
  task.judged_by = [&](const PlannedMotion& motion, double period_s) {
    const std::vector<AliasPair> pairs = separation.pairs(&motion, period_s);
    const double cost = cost_of(pairs);
    if (legs.after.empty() || (!legs.apart && cost < cost_of(legs.after)) || cost <= 0.0) legs.after = pairs;
    return cost;
  };
  for (; task.time_s >= least_s; task.time_s *= shorter) {
    looking(task.time_s);
    const Result<Design> design = design_walk(task, [](const DesignProgress&) { return true; });
    if (!design && !legs.apart) return design.error();
    const bool apart = design.ok() && design->cost <= 0.0;
    if (apart || !legs.apart) {
      legs.walk = design->walk;
      legs.time_s = task.time_s;
    }
    if (!apart) break;
    legs.apart = true;
    task.start = design->walk;
  }
  return legs;
}

}  // namespace turncal
