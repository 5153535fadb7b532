// Units that are plainly wrong, said in plain words.
//
// Gravity at rest, by the nominal scale, against that of the site: a ratio near 1/9.80665 is g taken for m/s^2, and so on. Turns: the
// common factor on the gyros' scale at which gravity is carried best from rest to rest, beyond roughest_scale. Any factor could be fitted as
// a scale factor; such a one is a slip, and its parameters would not be those of the unit.
#pragma once

#include <string>

#include "calib/model/parameters.h"
#include "calib/rests/rest_data.h"

namespace turncal {

// One sentence; empty: nothing is plainly wrong, or there is nothing to judge by. Of the accelerometers' unit, the gyros' unit, and gyros that read
// another axis, or the reverse.
std::string wrong_units(const RestData& data);

}  // namespace turncal
