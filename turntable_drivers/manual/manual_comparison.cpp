// An answer of the operator compared with what the unit senses: gravity for the tilt, the gyros for the turn.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "turntable_drivers/manual/manual_turntable.h"

namespace turncal {
namespace {

// The mean of gravity is of one second in halves that are complete: by then all of it is of after the answer.
constexpr double gravity_settle_s = 1.6;
constexpr double gravity_deadline_s = 10.0;
constexpr double quarter_deg = 90.0;
constexpr double least_scale_turn_deg = 30.0;  // from which what the gyros feel of a degree is learned

}  // namespace

void ManualTurntable::check_answer() {
  if (!answered_) return;
  const double now_s = clock_.now_s();
  if (rehearsed_ && rehearsed_->moving()) {
    answered_->since_s = now_s;
    return;
  }
  const Wanted now = queue_.front();
  const double angle_deg = answered_->angle_deg;
  // The tilt follows from both angles; one that is not known yet cannot be checked against.
  const Axis other = now.axis == Axis::pitch ? Axis::roll : Axis::pitch;
  const bool tilts = now.axis != Axis::heading && sense_ && hands_[index(other)].known;
  if (!tilts && (now.homing || !felt_deg(now.axis))) return accept(angle_deg);
  if (now_s - answered_->since_s < gravity_settle_s) return;
  if (sense_ && !sense_()) {
    if (now_s - answered_->since_s < gravity_deadline_s) return;
    return object(texts_.say("wrong.not_still"));
  }
  if (const auto objection = tilts ? gravity_objection(now.axis, angle_deg) : std::nullopt) {
    object(*objection);
    if (now.homing) {  // which of the two is wrong cannot be told
      hands_[index(other)] = {};
      queue_.push_front({.axis = other, .homing = true});
      begin_question();
    }
    return;
  }
  if (const auto objection = turn_objection(now, angle_deg)) return object(*objection);
  accept(angle_deg);
}

void ManualTurntable::object(const std::string& why) {
  answered_.reset();
  note(why, true);
}

void ManualTurntable::accept(double angle_deg) {
  const Wanted now = queue_.front();
  Hand& hand = hands_[index(now.axis)];
  const double way_deg = angle_deg - hand.position_deg;
  if (const std::optional<double> felt = felt_deg(now.axis);
      felt && hand.known && now.axis != Axis::heading && sense_ && std::abs(way_deg) >= least_scale_turn_deg)
    felt_of_a_degree_ = std::clamp(*felt / way_deg, 0.4, 1.7);  // of more no calibration settles
  hand.position_deg = angle_deg;
  hand.known = true;
  hand.homed = hand.homed || now.homing;
  answered_.reset();
  note_.clear();
  queue_.pop_front();
  begin_question();
  tell_changed();
}

std::optional<double> ManualTurntable::felt_deg(Axis axis) const {
  if (!felt_before_ || !turn_sense_) return {};
  const std::optional<std::array<double, 3>> felt = turn_sense_();
  const Hand &pitch = hands_[index(Axis::pitch)], &roll = hands_[index(Axis::roll)];
  if (!felt || (axis != Axis::roll && !roll.known) || (axis == Axis::heading && !pitch.known)) return {};
  const double p = pitch.position_deg * std::numbers::pi / 180.0, r = roll.position_deg * std::numbers::pi / 180.0;
  // The body axis about which + turns: heading is about -y of the frame n, pitch about z of the middle ring, roll about x.
  const std::array<double, 3> about =
      axis == Axis::roll    ? std::array{1.0, 0.0, 0.0}
      : axis == Axis::pitch ? std::array{0.0, std::sin(r), std::cos(r)}
                            : std::array{-std::sin(p), -std::cos(p) * std::cos(r), std::cos(p) * std::sin(r)};
  double along = 0.0;
  for (std::size_t i = 0; i < 3; ++i) along += about[i] * ((*felt)[i] - (*felt_before_)[i]);
  return along;
}

std::optional<std::string> ManualTurntable::turn_objection(const Wanted& now, double angle_deg) const {
  const Hand& hand = hands_[index(now.axis)];
  const std::optional<double> felt = felt_deg(now.axis);
  if (now.homing || !hand.known || !felt) return {};
  const double way_deg = angle_deg - hand.position_deg;
  const double made_deg = *felt / felt_of_a_degree_.value_or(1.0);
  const double sign = way_deg < 0.0 ? -1.0 : 1.0, way = std::abs(way_deg);
  // What was learned may be of a turn that another axis had a part in: the nominal scale will do, too.
  const bool agrees = felt_of_a_degree_
                          ? std::abs(made_deg - way_deg) <= quarter_deg || std::abs(*felt - way_deg) <= quarter_deg
                          : sign * *felt >= 0.25 * way - 60.0 && sign * *felt <= 2.0 * way + 60.0;
  if (agrees) return {};
  // Only whole turns can be missing: the dial shows the rest.
  const double turns = std::max(1.0, std::round(std::abs(way_deg - made_deg) / 360.0));
  return texts_.say("wrong.turn", {{"axis", name(now.axis)},
                                   {"felt", texts_.exact(std::round(made_deg) + 0.0)},
                                   {"way", texts_.exact(std::round(way_deg) + 0.0)},
                                   {"missing", texts_.exact(360.0 * turns)},
                                   {"sense", sense_words(way_deg - made_deg)}});
}

std::optional<std::string> ManualTurntable::gravity_objection(Axis axis, double angle_deg) const {
  const Axis other = axis == Axis::pitch ? Axis::roll : Axis::pitch;
  const std::optional<std::array<double, 3>> sensed = sense_();
  const double other_deg = hands_[index(other)].position_deg;
  const double pitch = (axis == Axis::pitch ? angle_deg : other_deg) * std::numbers::pi / 180.0;
  const double roll = (axis == Axis::roll ? angle_deg : other_deg) * std::numbers::pi / 180.0;
  const std::array<double, 3> expected = {std::sin(pitch), std::cos(pitch) * std::cos(roll),
                                          -std::cos(pitch) * std::sin(roll)};
  double along = 0.0, squared = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    along += expected[i] * (*sensed)[i];
    squared += (*sensed)[i] * (*sensed)[i];
  }
  if (!(squared > 0.0)) return texts_.say("wrong.no_gravity");
  const double away_deg = std::acos(std::clamp(along / std::sqrt(squared), -1.0, 1.0)) * 180.0 / std::numbers::pi;
  if (away_deg <= settings_.gravity_tolerance_deg) return {};
  return texts_.say("wrong.gravity", {{"away", texts_.shown(away_deg)},
                                      {"axis", name(axis)},
                                      {"angle", texts_.exact(angle_deg)},
                                      {"most", texts_.shown(settings_.gravity_tolerance_deg)}});
}

}  // namespace turncal
