// Which part of a stretch that is said to be at rest really is.
//
// The stretch comes as means over equal pieces, gyros x y z and accelerometers x y z. A piece moves when the mean of it and its two
// neighbours stands more than `outlier` robust standard deviations (1.4826 times the median of absolute deviations of the
// pieces, but not less than their noise) from the median in any channel. What creeps or trembles evenly raises that deviation and
// stays; the start of a turn, a knock or a second turn in the middle stands out. Of what is left the longest stretch counts.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>

namespace turncal {

using SixChannels = Eigen::Array<double, 6, 1>;

struct StillPart {
  std::size_t first = 0;
  std::size_t end = 0;  // exclusive; equal to first: nothing is still
};

// `noise`: standard deviation of a piece by sensor noise alone. Fewer than five pieces are taken as they are.
StillPart longest_still(std::span<const SixChannels> pieces, const SixChannels& noise, double outlier = 8.0);

}  // namespace turncal
