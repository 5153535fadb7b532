// `turncal design --separate`: the shortest walk that tells the effects of an alias class apart (calib/prediction/separation.h).
//
//   cost(walk) = sum over the ordered pairs of max(0, ln(separating_gain / gain expected))
// is searched for (sequence_design.h) in the longest time allowed; then in less and less of it, from what was found, until it is not reached.
#pragma once

#include <functional>
#include <vector>

#include "calib/prediction/separation.h"
#include "orchestrator/jobs/design/sequence_design.h"

namespace turncal {

struct ExtraLegs {
  Walk walk;
  double time_s = 0.0;
  std::vector<AliasPair> before, after;  // with what is recorded; with the walk, too
  bool apart = false;                    // every pair is told apart
};

// `task`: time_s is the longest that is allowed. Errors of design_walk().
Result<ExtraLegs> find_extra_legs(const Separation& separation, DesignTask task,
                                  const std::function<void(double time_s)>& looking);

}  // namespace turncal
