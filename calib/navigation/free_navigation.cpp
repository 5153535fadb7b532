#include "calib/navigation/free_navigation.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "calib/model/attitude.h"
#include "calib/model/parameters.h"

namespace turncal {

namespace {

constexpr double track_step_s = 1.0;
constexpr double rest_interval_s = 0.1;

Eigen::Vector3d attitude_sigma(const DriftMatrix& covariance) {
  return covariance.diagonal().head<3>().cwiseMax(0.0).cwiseSqrt();
}

Eigen::Matrix2d position_block(const DriftMatrix& covariance) { return covariance.block<2, 2>(5, 5); }

// Returns what a unit reads at rest over one interval.
MotionInterval resting(const Eigen::Matrix3d& C_nb, const DriftCovariance::Site& site, double seconds) {
  MotionInterval interval;
  interval.duration_s = seconds;
  interval.at_rest = true;
  interval.gyro_rad = seconds * (C_nb.transpose() * earth_rate_n(site.latitude_rad / rad_per_deg));
  interval.accel_mps = seconds * (C_nb.transpose() * Eigen::Vector3d(0.0, site.gravity_mps2, 0.0));
  interval.turn = quaternion_of(interval.gyro_rad);
  interval.push_mps = interval.accel_mps + 0.5 * interval.gyro_rad.cross(interval.accel_mps);
  return interval;
}

}  // namespace

Result<FreeNavigation> navigate_freely(std::span<const MotionInterval> stretch, const FreeNavigationSetup& setup) {
  if (stretch.empty()) return input_error("nothing to navigate: the stretch is empty");
  Elapsed time, free_time;
  std::size_t align_intervals = 0;
  for (; align_intervals < stretch.size(); ++align_intervals) {
    const double duration_s = stretch[align_intervals].duration_s;
    if (time.now_s() >= setup.align_s - 0.5 * duration_s) break;
    time.add(duration_s);
  }
  if (stretch.size() <= align_intervals)
    return input_error("alignment: the stretch has {} s, expected more than the {} s of the alignment",
                       std::lround(time.now_s()), std::lround(setup.align_s));
  // The true position now.
  const auto truth = [&] {
    if (setup.reference == nullptr) return ReferencePoint{.latitude_rad = setup.site.latitude_rad};
    return setup.reference->at(setup.start_s + time.now_s());
  };
  const ReferencePoint begin = truth();
  DriftCovariance::Site site{begin.latitude_rad, setup.site.gravity_mps2};
  if (setup.reference != nullptr) {
    const ReferencePoint first = setup.reference->at(setup.reference->begins_s());
    site.gravity_mps2 += normal_gravity_mps2(begin.latitude_rad, begin.height_m) -
                         normal_gravity_mps2(first.latitude_rad, first.height_m);
  }
  auto alignment = TRY(align(stretch.first(align_intervals), site, DriftCovariance(site, setup.noise, setup.counts)));
  alignment.state.longitude_rad = begin.longitude_rad;
  alignment.state.height_m = begin.height_m;

  FreeNavigation result;
  result.align_rest_s = alignment.rest_s;
  result.aligned = alignment.state;
  DriftCovariance& drift = alignment.drift;
  const DriftMatrix at_start = drift.covariance(setup.parameter_covariance);
  result.align_sigma_rad = attitude_sigma(at_start);
  result.heading_sigma_rad = angle_sigmas(at_start.topLeftCorner<3, 3>(), result.aligned.q_nb)[0];
  const std::span<const MotionInterval> free = stretch.subspan(align_intervals);
  Navigator navigator(alignment.state, site.gravity_mps2, true);
  RadialErrorRate rate;
  double squares = 0.0;
  const auto note = [&] {
    const NavigationState& state = navigator.state();
    const double t = free_time.now_s();
    const ReferencePoint there = truth();
    const Eigen::Vector2d moved = displacement_m(state, there.latitude_rad, there.longitude_rad);
    const Eigen::Vector2d velocity(state.velocity_n_mps[0], state.velocity_n_mps[2]);
    result.track.push_back({t, state, moved, velocity - there.velocity_mps});
    rate.add(t, moved.norm());
    squares += (velocity - there.velocity_mps).squaredNorm();
  };
  note();
  for (std::size_t k = 0; k < free.size(); ++k) {
    const Eigen::Quaterniond before = navigator.state().q_nb;
    const double duration_s = free[k].duration_s;
    time.add(duration_s);
    free_time.add(duration_s);
    if (setup.reference != nullptr) navigator.set_climb((truth().height_m - navigator.state().height_m) / duration_s);
    navigator.advance(free[k]);
    if (setup.expected) {
      // Half way: the mean of two quaternions that are close, to second order of the angle between them.
      const Eigen::Quaterniond& after = navigator.state().q_nb;
      const double side = before.dot(after) < 0.0 ? -1.0 : 1.0;
      const Eigen::Quaterniond middle(Eigen::Vector4d(before.coeffs() + side * after.coeffs()).normalized());
      drift.advance(middle.toRotationMatrix(), free[k]);
    }
    const double since_s = free_time.now_s() - result.track.back().time_s;
    if (since_s >= track_step_s - 0.5 * duration_s || k + 1 == free.size()) note();
  }
  result.free_s = free_time.now_s();
  result.nm_per_h = rate.nm_per_h();
  result.velocity_rms_mps = std::sqrt(squares / double(result.track.size()));
  if (setup.expected) result.end_covariance_m2 = position_block(drift.covariance(setup.parameter_covariance));
  return result;
}

ExpectedDrift expected_drift(const FreeNavigationSetup& setup, double heading_rad, double free_s, double every_s) {
  const Eigen::Matrix3d C_nb = attitude_from_angles(heading_rad, 0.0, 0.0);
  const MotionInterval interval = resting(C_nb, setup.site, rest_interval_s);
  const auto intervals_of = [](double seconds) { return std::lround(seconds / rest_interval_s); };
  DriftCovariance drift(setup.site, setup.noise, setup.counts);
  begin_alignment(drift);
  const long a_second = intervals_of(1.0);
  for (long k = 1; k <= intervals_of(setup.align_s); ++k) {
    drift.advance(C_nb, interval);
    if (k % a_second == 0) drift.observe_rest(Eigen::Vector2d::Zero());
  }
  drift.begin_navigation();
  ExpectedDrift result;
  result.align_sigma_rad = attitude_sigma(drift.covariance(setup.parameter_covariance));
  const long end = intervals_of(free_s);
  const long every = std::max(a_second, intervals_of(every_s));
  for (long k = 1; k <= end; ++k) {
    drift.advance(C_nb, interval);
    if (k % every != 0 && k != end) continue;
    const DriftMatrix covariance = drift.covariance(setup.parameter_covariance);
    result.points.push_back(
        {double(k) * rest_interval_s, position_block(covariance), position_block(drift.noise_covariance())});
  }
  return result;
}

double expected_nm_per_h(const Eigen::Matrix2d& covariance_m2, double time_s) {
  return time_s > 0.0 ? std::sqrt(std::max(0.0, covariance_m2.trace())) / metres_per_nautical_mile / (time_s / 3600.0)
                      : 0.0;
}

double RadialErrorRate::nm_per_h() const { return tt_ > 0.0 ? dt_ / tt_ * 3600.0 / metres_per_nautical_mile : 0.0; }

DriftOverRuns drift_over_runs(std::span<const double> rates_nm_per_h) {
  if (rates_nm_per_h.empty()) return {};
  double squares = 0.0;
  for (const double rate : rates_nm_per_h) squares += rate * rate;
  const double rms = std::sqrt(squares / double(rates_nm_per_h.size()));
  return {rms, std::sqrt(std::log(2.0)) * rms, std::sqrt(std::log(20.0)) * rms};
}

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
