// The noise that a joint estimate begins with.
#pragma once

#include "calib/model/noise_model.h"
#include "calib/model/parameters.h"
#include "calib/statistics/allan.h"
#include "calib/statistics/compression.h"

namespace turncal {

// The noise to begin with: read off the static dwells, never below what a tenth of a pulse in a second would make.
NoiseModel start_noise(const CompressedRecording& recording, const AllanResult& allan, const Parameters& from);

}  // namespace turncal
