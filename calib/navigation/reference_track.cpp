#include "calib/navigation/reference_track.h"

#include <algorithm>
#include <cmath>

#include "calib/model/parameters.h"
#include "calib/navigation/earth.h"

namespace turncal {

ReferenceTrack::ReferenceTrack(std::vector<ReferencePoint> points, bool with_velocity)
    : points_(std::move(points)), with_velocity_(with_velocity) {
  for (std::size_t k = 1; k < points_.size(); ++k) {
    const double before = points_[k - 1].longitude_rad;
    points_[k].longitude_rad = before + std::remainder(points_[k].longitude_rad - before, 2.0 * pi);
  }
}

double ReferenceTrack::longest_in_motion_s() const {
  double longest_s = 0.0;
  for (std::size_t k = 1; k < points_.size(); ++k)
    if (!stands_at(0.5 * (points_[k - 1].time_s + points_[k].time_s)))
      longest_s = std::max(longest_s, points_[k].time_s - points_[k - 1].time_s);
  return longest_s;
}

ReferencePoint ReferenceTrack::at(double time_s) const {
  const auto after = std::upper_bound(points_.begin() + 1, points_.end() - 1, time_s,
                                      [](double t, const ReferencePoint& point) { return t < point.time_s; });
  const ReferencePoint &b = *after, &a = *(after - 1);
  const double seconds = b.time_s - a.time_s;
  const double share = std::clamp((time_s - a.time_s) / seconds, 0.0, 1.0);
  const auto between = [share](const auto& from, const auto& to) { return from + share * (to - from); };
  ReferencePoint point{time_s, between(a.latitude_rad, b.latitude_rad), between(a.longitude_rad, b.longitude_rad),
                       between(a.height_m, b.height_m)};
  if (with_velocity_) {
    point.velocity_mps = a.velocity_mps + share * (b.velocity_mps - a.velocity_mps);
  } else {
    const RadiiOfCurvature radii = radii_of_curvature(point.latitude_rad);
    point.velocity_mps = {
        (b.latitude_rad - a.latitude_rad) * (radii.north_m + point.height_m) / seconds,
        (b.longitude_rad - a.longitude_rad) * (radii.east_m + point.height_m) * std::cos(point.latitude_rad) / seconds};
  }
  return point;
}

}  // namespace turncal
