// What the person at a table turned by hand has to do now, as plain data. Terminal and page both draw it
// (orchestrator/watch/operator_screen.h). Degrees.
#pragma once

#include <optional>
#include <string>

#include "calib/types/axis.h"

namespace turncal {

struct OperatorTask {
  enum class Kind {
    nothing,  // the table is not theirs: hands off
    where,    // say where an axis stands
    turn,     // turn an axis, say the angle reached
    compare,  // the answer is compared with gravity and gyros: hands off
    paused
  };
  Kind kind = Kind::nothing;
  Axis axis = Axis::heading;
  std::optional<double> from_deg;  // empty: not known
  double target_deg = 0.0;
  std::string note;    // what was said last, and holds still, in the operator's language
  bool wrong = false;  // the note is of an answer that was not taken
  long answers = 0;    // lines that were typed so far
};

}  // namespace turncal
