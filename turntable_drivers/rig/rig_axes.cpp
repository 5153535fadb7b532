#include "turntable_drivers/rig/rig_axes.h"

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
  const double ramp_deg = max_rate_degps * max_rate_degps / acceleration_degps2;  // speeding up plus slowing down
  const bool cruises = distance_deg > ramp_deg;
  const double peak_degps = cruises ? max_rate_degps : std::sqrt(distance_deg * acceleration_degps2);
  const double ramp_s = peak_degps / acceleration_degps2;
  profile.append(ramp_s, acceleration);
  if (cruises) profile.append((distance_deg - ramp_deg) / max_rate_degps, 0.0);
  profile.append(ramp_s, -acceleration);
  profile.end_deg_ = target_deg;  // the sum of the phases differs only by rounding
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

namespace {

constexpr double rad_per_deg = pi / 180.0;
constexpr double creep_lasts_tau = 40.0;  // exp(-40) of an arc second is below double precision

}  // namespace

RigAxis::RigAxis(double position_deg, const TableErrorsInForce::Encoder& encoder, double creep_deg, double creep_tau_s,
                 double period_s)
    : encoder_(encoder), creep_deg_(creep_deg), creep_tau_s_(creep_tau_s), period_s_(period_s) {
  command_.profile = AxisProfile::stand(position_deg);
}

double RigAxis::creep_at(double since_s) const {
  if (creep_direction_ == 0.0 || since_s <= 0.0) return creep_base_deg_;
  return creep_base_deg_ + creep_direction_ * creep_deg_ * (1.0 - exp_of(-since_s / creep_tau_s_));
}

void RigAxis::note_end(const Leg& leg) {
  if (leg.profile.duration_s() <= 0.0) return;
  const double end_s = double(leg.start) * period_s_ + leg.profile.duration_s();
  if (end_s > motion_end_s_) motion_end_s_ = end_s;
}

void RigAxis::replace_command(std::int64_t k, const AxisProfile& profile) {
  if (creep_deg_ != 0.0) {
    creep_base_deg_ = creep_at(elapsed_s(command_, k) - command_.profile.duration_s());
    creep_direction_ = profile.last_direction();
  }
  if (profile.duration_s() > 0.0 || running(command_, k)) {
    // A motion that is interrupted ends with the one that replaces it.
    motion_end_s_ = double(k) * period_s_ + profile.duration_s();
    command_end_s_ = motion_end_s_;
  }
  command_ = {profile, k};
  seen_slip_ = {};
  note_end(hidden_slip_);
}

void RigAxis::move(std::int64_t k, double target_deg, double rate_degps, double acceleration_degps2) {
  const AxisPoint now = reading(k, 0.0);
  if (!turning(k) && now.position_deg == target_deg) return;  // already there: creep continues
  replace_command(k, AxisProfile::move(now.position_deg, now.rate_degps, target_deg, rate_degps, acceleration_degps2));
}

void RigAxis::brake(std::int64_t k, double acceleration_degps2) {
  if (!turning(k)) return;
  const AxisPoint now = reading(k, 0.0);
  replace_command(k, AxisProfile::brake(now.position_deg, now.rate_degps, acceleration_degps2));
}

void RigAxis::halt(std::int64_t k) {
  if (!turning(k)) return;
  const AxisPoint now = reading(k, 0.0);
  const double acceleration = std::abs(now.rate_degps) / period_s_;
  replace_command(k, acceleration > 0.0 ? AxisProfile::brake(now.position_deg, now.rate_degps, acceleration)
                                        : AxisProfile::stand(now.position_deg));
}

void RigAxis::slip(std::int64_t k, double angle_deg, double rate_degps, bool hidden) {
  Leg& leg = hidden ? hidden_slip_ : seen_slip_;
  const AxisPoint now = leg.profile.at(elapsed_s(leg, k));
  leg = {
      AxisProfile::move(now.position_deg, now.rate_degps, now.position_deg + angle_deg, rate_degps, 10.0 * rate_degps),
      k};
  note_end(leg);
}

AxisPoint RigAxis::reading(std::int64_t k, double offset_s) const {
  AxisPoint point = command_.profile.at(elapsed_s(command_, k) + offset_s);
  const AxisPoint slip = seen_slip_.profile.at(elapsed_s(seen_slip_, k) + offset_s);
  point.position_deg += slip.position_deg;
  point.rate_degps += slip.rate_degps;
  point.acceleration_degps2 += slip.acceleration_degps2;
  return point;
}

TrueAxis RigAxis::truth(std::int64_t k, double offset_s) const {
  const AxisPoint e = reading(k, offset_s);
  const double scale = 1.0 + encoder_.scale_ppm * 1e-6;
  double angle_deg = e.position_deg + e.position_deg * (encoder_.scale_ppm * 1e-6) + encoder_.offset_arcsec / 3600.0;
  double rate_degps = scale * e.rate_degps;
  double acceleration_degps2 = scale * e.acceleration_degps2;
  if (encoder_.harmonic_arcsec != 0.0) {
    const double order = encoder_.order;
    const double size_deg = encoder_.harmonic_arcsec / 3600.0;
    const SinCos a = sin_cos_deg(order * e.position_deg + encoder_.phase_deg);
    const double slope = order * rad_per_deg;  // of the argument: rad per degree of reading
    angle_deg += size_deg * a.sin;
    rate_degps += size_deg * slope * e.rate_degps * a.cos;
    acceleration_degps2 +=
        size_deg * (slope * e.acceleration_degps2 * a.cos - slope * e.rate_degps * slope * e.rate_degps * a.sin);
  }
  if (hidden_slip_.profile.duration_s() > 0.0) {
    const AxisPoint slip = hidden_slip_.profile.at(elapsed_s(hidden_slip_, k) + offset_s);
    angle_deg += slip.position_deg;
    rate_degps += slip.rate_degps;
    acceleration_degps2 += slip.acceleration_degps2;
  }
  if (creep_deg_ != 0.0) {
    const double since_s = elapsed_s(command_, k) + offset_s - command_.profile.duration_s();
    angle_deg += creep_at(since_s);
    if (creep_direction_ != 0.0 && since_s > 0.0) {
      const double left = creep_direction_ * creep_deg_ * exp_of(-since_s / creep_tau_s_);
      rate_degps += left / creep_tau_s_;
      acceleration_degps2 -= left / (creep_tau_s_ * creep_tau_s_);
    }
  }
  return {sin_cos_deg(angle_deg), rate_degps * rad_per_deg, acceleration_degps2 * rad_per_deg};
}

bool RigAxis::turning(std::int64_t k) const { return running(command_, k) || running(seen_slip_, k); }

bool RigAxis::standing(std::int64_t k) const {
  if (turning(k) || running(hidden_slip_, k)) return false;
  if (creep_deg_ == 0.0 || creep_direction_ == 0.0) return true;
  return elapsed_s(command_, k) - command_.profile.duration_s() > creep_lasts_tau * creep_tau_s_;
}

std::size_t RigAxis::corners(std::int64_t k, std::span<double> out) const {
  std::size_t count = 0;
  for (const Leg* leg : {&command_, &seen_slip_, &hidden_slip_}) {
    const double elapsed = elapsed_s(*leg, k);
    for (double corner_s : leg->profile.corners_s()) {
      const double offset = corner_s - elapsed;
      if (offset > 0.0 && offset < period_s_ && count < out.size()) out[count++] = offset;
    }
  }
  return count;
}

}  // namespace turncal::rig_model
