#include "turntable_drivers/rig/rig_motion.h"

#include <cassert>
#include <cmath>

namespace turncal::rig_model {

AxisProfile AxisProfile::stand(double position_deg) {
  AxisProfile profile;
  profile.end_deg_ = position_deg;
  return profile;
}

void AxisProfile::append(double length_s, double acceleration_degps2) {
  if (!(length_s > 0.0)) return;
  assert(phase_count_ < phases_.size());
  if (corner_count_ == 0) corners_[corner_count_++] = 0.0;
  phases_[phase_count_++] = {duration_s_, end_deg_, end_rate_degps_, acceleration_degps2};
  end_deg_ += length_s * (end_rate_degps_ + 0.5 * acceleration_degps2 * length_s);
  end_rate_degps_ += acceleration_degps2 * length_s;
  duration_s_ += length_s;
  corners_[corner_count_++] = duration_s_;
}

AxisProfile AxisProfile::brake(double position_deg, double rate_degps, double acceleration_degps2) {
  assert(acceleration_degps2 > 0.0);
  AxisProfile profile;
  profile.end_deg_ = position_deg;
  profile.end_rate_degps_ = rate_degps;
  profile.append(std::abs(rate_degps) / acceleration_degps2, std::copysign(acceleration_degps2, -rate_degps));
  profile.end_rate_degps_ = 0.0;
  return profile;
}

AxisProfile AxisProfile::move(double position_deg, double rate_degps, double target_deg, double max_rate_degps,
                              double acceleration_degps2) {
  assert(max_rate_degps > 0.0);
  AxisProfile profile = brake(position_deg, rate_degps, acceleration_degps2);
  const double way_deg = target_deg - profile.end_deg_;
  const double distance_deg = std::abs(way_deg);
  const double acceleration = std::copysign(acceleration_degps2, way_deg);
  const double ramp_deg = max_rate_degps * max_rate_degps / acceleration_degps2;  // up and down together
  const bool cruises = distance_deg > ramp_deg;
  const double peak_degps = cruises ? max_rate_degps : std::sqrt(distance_deg * acceleration_degps2);
  const double ramp_s = peak_degps / acceleration_degps2;
  profile.append(ramp_s, acceleration);
  if (cruises) profile.append((distance_deg - ramp_deg) / max_rate_degps, 0.0);
  profile.append(ramp_s, -acceleration);
  profile.end_deg_ = target_deg;  // the sum above differs from it by rounding only
  profile.end_rate_degps_ = 0.0;
  return profile;
}

double AxisProfile::last_direction() const {
  if (phase_count_ == 0) return 0.0;
  return phases_[phase_count_ - 1].acceleration_degps2 < 0.0 ? 1.0 : -1.0;  // the last phase slows down
}

AxisPoint AxisProfile::at(double time_s) const {
  if (time_s >= duration_s_) return {end_deg_, 0.0, 0.0};
  std::size_t i = phase_count_ - 1;
  while (i > 0 && time_s < phases_[i].start_s) --i;
  const Phase& phase = phases_[i];
  const double t = time_s - phase.start_s;
  return {phase.position_deg + t * (phase.rate_degps + 0.5 * phase.acceleration_degps2 * t),
          phase.rate_degps + phase.acceleration_degps2 * t, phase.acceleration_degps2};
}

}  // namespace turncal::rig_model
