// Detects units that are plainly wrong, and says so in plain words.
//
// Accelerometers: gravity at rest by the nominal scale, over that of the site; a ratio near 1/9.80665 is g taken for
// m/s^2, and so on. Gyros: the common factor on their scale that carries gravity best from rest to rest, if beyond
// roughest_scale. A fit would absorb any factor as a scale factor, but its parameters would not be those of the unit.
#pragma once

#include <string>

#include "calib/model/parameters.h"
#include "calib/rests/rest_data.h"

namespace turncal {

// Returns a sentence about the accelerometers' unit, the gyros' unit, and gyros that read another axis, or the reverse;
// empty: nothing is plainly wrong, or there is too little to judge by.
std::string wrong_units(const RestData& data);

}  // namespace turncal
