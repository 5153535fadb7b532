// The latitude estimated from the gyros. The last pass of a joint estimate carries candidate columns for the Earth's rate; one step gives
// the error of that rate x = (north, up) and its information Q. At a latitude L the rate is w(L) = w_ie (cos L, sin L), so
//   L = argmin r' Q r,  r = x - w(L) + w(stated);   sigma^2 = 1 / v' Q v,  v = dw / dL
// and at least (L - stated)^2 / (r' Q r at the stated latitude - at L): latitudes of opposite sign share the same north rate. Q is that of
// the fitted noise. A bias instability too small to be kept (noise_fit.h) widens the gyro biases and the Earth's rate from the rests alike,
// so Q is divided by the largest of the three variance factors. The fourteen steps give L to one to three arc minutes (1 sigma). A latitude
// that is wrong by many degrees looks like a bias instability that leaves the gyro biases open; an estimate with the Earth's rate among the
// unknowns then finds it. An error fixed to the direction of north or up (gyro_magnetic, a g-sensitivity common to all gyros) is confounded
// with a wrong latitude: the estimate does not tell which of them is present.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"
#include "calib/navigation/mechanisation.h"

namespace turncal {

// Returns the candidates that the estimate must be made with (JointOptions::candidates).
std::vector<EffectColumn> latitude_columns();

// Returns the estimated latitude. Fits the recording again if `fit` lacks those candidates or leaves parameters open.
// None if rests and turns do not determine it, or parameters stay open with the Earth's rate free.
std::optional<FeltLatitude> felt_latitude(const CompressedRecording& recording, const JointResult& fit);

// Returns "the gyros measure the Earth's rate of a latitude of 40.01 +- 0.01 deg, the recording says 50"; empty: no
// contradiction. The diagnosis finds the same as the effect earth_rate, or as something that it cannot name.
std::string wrong_latitude(const CompressedRecording& recording, const JointResult& fit);

// For hand-turned data, whose heading is open: the column of the Earth's rate about the vertical, in deg/h beyond that
// at the stated latitude, and the latitude that a value of it implies, in words.
EffectColumn vertical_earth_rate();
std::string latitude_of_vertical(double stated_deg, double more_degph, double sigma_degph);

}  // namespace turncal
