// Sentences with the numbers of a move in them: what the device is told, and whether its columns and decimals can tell and show it.
// Pure functions.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/table/drive_rules.h"

namespace turncal {

// A sentence as it is sent to this axis.
std::string filled(const Dialect& dialect, const SentenceTemplate& sentence, Axis axis, const Moves& moves);

// An error: a number does not fit its column, or a rate or an acceleration rounds to nothing.
Status check_sentences(const Dialect& dialect, Axis axis, const Moves& moves);

// The same; and the angle is told, and can be read, to the tolerance.
Status check_move(const Dialect& dialect, Axis axis, const Moves& moves, double tolerance_deg);

}  // namespace turncal
