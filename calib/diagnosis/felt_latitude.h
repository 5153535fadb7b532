// Does the earth turn as the recording's latitude says? From a joint estimate whose last pass had the columns of the earth's rate beside its
// own: one step gives the error of that rate x = (north, up) and its information Q. At a latitude L the rate is w(L) = w_ie (cos L, sin L), so
//   L = argmin r' Q r,  r = x - w(L) + w(stated);   sigma^2 = 1 / v' Q v,  v = dw / dL
// The fourteen steps tell it to one to three arc minutes (1 sigma). A latitude that is many degrees off looks like so much bias instability
// that the gyros' biases stay open; then an estimate with the earth's rate among the unknowns tells it. Another field that goes with the direction of north
// or up (gyro_magnetic, a sensitivity to g that is the same for all gyros) looks the same: what is found is no proof of which of them it is.
#pragma once

#include <optional>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

struct FeltLatitude {
  double latitude_deg = 0.0;  // what would explain the gyros best
  double sigma_deg = 0.0;
  // By five sigma, and by more than what a site is known to.
  bool speaks_against(double stated_deg) const;
};

// The candidates that the estimate has to be made with (JointOptions::candidates).
std::vector<EffectColumn> latitude_columns();

// Of the estimate `fit` of the recording. Nothing where rests and turns do not tell, where parameters stay open with the earth's rate free,
// too, or where the fit was made without those candidates.
std::optional<FeltLatitude> felt_latitude(const CompressedRecording& recording, const JointResult& fit);

}  // namespace turncal
