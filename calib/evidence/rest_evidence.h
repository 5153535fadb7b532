// What a fit of hand-turned data leaves to be explained (evidence.h), from the observations of rests and turns (rest_system.h).
//
// Cells are the first second of a rest, its middle and its last second, and parts of the turn before it. A unit of a reading in a cell changes
// the observations by a column of the rest model's own Jacobian; coordinates are the observations over their sigmas. What is another value in
// every rest is the floor of a kind (rest_model.h) and no term. A missing effect raises the floors it touches, so models are weighed with those
// of the 21 parameters alone, and with those that the most probable model leaves.
#pragma once

#include "calib/evidence/evidence.h"
#include "calib/rests/rest_model.h"

namespace turncal {

// Of the gyros and accelerometers, by white noise alone.
NoiseModel rest_noise(const RestData& data, const Parameters& parameters);

// What temperature effects are referred to: the mean of the recording, 0 without a thermometer.
double rest_reference_temperature_c(const RestData& data);

EffectModel rest_effects(const RestData& data, const std::vector<EstimatedEffect>& effects);

// `fit` has `effects`; `without`: floors of the 21 parameters alone. `accelerometers`: they may be what is missing.
Evidence weigh_rests(const RestData& data, const RestFit& fit, const std::vector<EstimatedEffect>& effects,
                     const RestFloors& without, bool accelerometers);

}  // namespace turncal
