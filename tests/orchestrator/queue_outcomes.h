// For tests: what became of the units of a queue, "SN1=pass SN2=fail ".
#pragma once

#include <string>

#include "orchestrator/records/unit_queue.h"

namespace turncal {

inline std::string outcomes_text(const std::string& queue) {
  const auto all = read_outcomes(queue);
  std::string text;
  if (all) {
    for (const UnitOutcome& o : *all) text += o.unit + "=" + o.outcome + " ";
  }
  return text;
}

}  // namespace turncal
