// A station that settles its own doubts: what a run adds to its plan where its diagnosis cannot tell two effects apart.
//
// The legs are those of `turncal design --separate` (sequence_design.h), in the poses that the plan leaves to the cable. They count when the pair that is told
// apart worst is expected to gain 2 ln L of SelectionLimits::bic_margin within the time left, less the way to their start. The gain
// is that of a second recording with biases of its own; within one recording it is larger. The same samples give the same legs.
//
// Not modelled: how long the search takes (10 to 60 s, the table at rest and under watch meanwhile).
#pragma once

#include <optional>

#include "calib/evidence/diagnosis.h"
#include "orchestrator/records/journal.h"
#include "sequences/plan.h"

namespace turncal {

inline constexpr double least_settling_s = 60.0;  // with less left nothing is looked for

struct SettlingTask {
  const CompressedRecording& recording;  // so far
  const JointResult& base;               // its fit
  const Sequence& sequence;
  const Plan& plan;  // of it
  PlanLimits limits;
  double left_s = 0.0;
};

// Nothing: the diagnosis leaves no doubt. Without a sequence: nothing was found that would help, and why_not. The unit is not set.
std::optional<Settling> find_settling(const SettlingTask& task);

}  // namespace turncal
