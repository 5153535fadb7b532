// A name is given only where nothing without a name explains the rests as well.
//
// The families are those that rests can show: a bias or a scale factor of one sensor
//   that steps once           at one of 24 times
//   that wanders              steps of one size at all of them
//   by a curve in time        six cosines over the recording, with sizes 1/k
//   by a curve with force     two waves, odd and even, of each axis' specific force
//   by a curve with rate      the same of each axis' rate; nothing at rest
// compared by their marginal likelihood at the weights of the final model.
#pragma once

#include "calib/rest_diagnosis/rest_diagnosis_model.h"

namespace turncal {

// Why the names of m.model do not stand, and what the residual looks like instead; empty: they do, and without names nothing is left.
// What came near goes into `beside`: shifts of the 24 parameters that may be the truth as well.
std::string why_names_fall(const RestDiagnosisModel& m, std::vector<Eigen::VectorXd>& beside);

}  // namespace turncal
