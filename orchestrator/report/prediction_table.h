// What `turncal predict` prints: sigmas side by side, what is not determined, and the smallest effects that would be caught.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "calib/prediction/predict.h"

namespace turncal {

struct NamedPrediction {
  std::string name;  // of the sequence
  Prediction prediction;
  double station_s = 0.0;
};

// REQUIRES at least one prediction, all of the same unit.
void print_sigmas(const std::vector<NamedPrediction>& columns, const RecordingInfo& info, std::ostream& out);
void print_undetermined(const std::vector<NamedPrediction>& columns, std::ostream& out);
// REQUIRES predictions with the same effects.
void print_effects(const std::vector<NamedPrediction>& columns, std::ostream& out);

// "+0.82 n12 -0.41 a12"
std::string describe(const Undetermined& direction);

}  // namespace turncal
