// Does the earth turn as the recording's latitude says? From a joint estimate whose last pass had the columns of the earth's rate beside its
// own: one step gives the error of that rate x = (north, up) and its covariance C. A latitude that is off by d turns it in the meridian:
//   x = v d,  v = (-w_ie sin(latitude), w_ie cos(latitude));   d = v' C^-1 x / v' C^-1 v,  sigma^2 = 1 / v' C^-1 v
// The fourteen steps tell it to one to three arc minutes (1 sigma). Another field that goes with the direction of north or up (gyro_magnetic, a
// sensitivity to g that is the same for all gyros) looks the same: what is found is no proof of which of them it is.
#pragma once

#include <optional>
#include <vector>

#include "calib/joint/joint_estimate.h"

namespace turncal {

struct FeltLatitude {
  double latitude_deg = 0.0;  // what would explain the gyros best
  double sigma_deg = 0.0;
};

// The candidates that the estimate has to be made with (JointOptions::candidates).
std::vector<EffectColumn> latitude_columns();

// Nothing where rests and turns do not tell, or leave parameters open, or where the fit was made without those candidates.
std::optional<FeltLatitude> felt_latitude(const RecordingInfo& info, const JointResult& fit);

}  // namespace turncal
