// Does the earth turn as the recording's latitude says? From a joint estimate whose last pass had the columns of the earth's rate beside its
// own: one step gives the error of that rate x = (north, up) and its information Q. At a latitude L the rate is w(L) = w_ie (cos L, sin L), so
//   L = argmin r' Q r,  r = x - w(L) + w(stated);   sigma^2 = 1 / v' Q v,  v = dw / dL
// and no less than (L - stated)^2 / (r' Q r at the stated one - at L): latitudes that mirror each other have one rate north.
// Q is that of the fitted noise. What a bias instability too small to be kept may add (noise_fit.h) widens the gyros' biases, and what rests
// tell of the earth's rate as much: Q is divided by the largest of the three factors.
// The fourteen steps tell it to one to three arc minutes (1 sigma). A latitude that is many degrees off looks like so much bias instability
// that the gyros' biases stay open; then an estimate with the earth's rate among the unknowns tells it. Another field that goes with the direction of north
// or up (gyro_magnetic, a sensitivity to g that is the same for all gyros) looks the same: what is found is no proof of which of them it is.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"
#include "calib/navigation/mechanisation.h"

namespace turncal {

// The candidates that the estimate has to be made with (JointOptions::candidates).
std::vector<EffectColumn> latitude_columns();

// Of the estimate `fit` of the recording; where it was made without those candidates, or parameters stay open, the recording is fitted again.
// Nothing where rests and turns do not tell, or where parameters stay open with the earth's rate free, too.
std::optional<FeltLatitude> felt_latitude(const CompressedRecording& recording, const JointResult& fit);

// "the gyros feel the earth turn as at a latitude of 40.01 +- 0.01 deg, the recording says 50"; empty: nothing speaks against it. The
// diagnosis finds the same as the effect earth_rate, or nothing that it could name.
std::string wrong_latitude(const CompressedRecording& recording, const JointResult& fit);

// Of hand-turned data, whose heading is open: the part of the Earth's rate about the vertical, deg/h beyond that of the latitude that is stated, and
// what a value of it says.
EffectColumn vertical_earth_rate();
std::string latitude_of_vertical(double stated_deg, double more_degph, double sigma_degph);

}  // namespace turncal
