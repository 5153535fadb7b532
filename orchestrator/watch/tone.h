// How something looks at a glance: on the status page, and in colours on a terminal.
//
// A stream shows colours after allow_colour: a terminal of somebody who has not asked for none (https://no-color.org).
#pragma once

#include <ostream>
#include <string>
#include <string_view>

#include "orchestrator/station/verdict.h"

namespace turncal {

enum class Tone { good, attention, bad };  // green, amber, red
Tone tone_of(UnitVerdict verdict);

void allow_colour(std::ostream& out, int descriptor);
std::string in_tone(std::ostream& out, Tone tone, std::string_view text);  // as `out` may show it

}  // namespace turncal
