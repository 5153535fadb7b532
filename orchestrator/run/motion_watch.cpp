#include "orchestrator/run/motion_watch.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "calib/model/parameters.h"
#include "calib/statistics/numerics.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace {

constexpr double homing_begins_s = 20.0;  // after the command, or after another axis found its zero
constexpr double turns_degps = 0.01;

constexpr int guard_polls = 3;

// Least progress: far less than any real move makes in stall_s, more than an encoder's flicker.
constexpr double progress_deg = 2e-4;

}  // namespace

void ArrivalMonitor::start_move(const Move& move, double from_deg, double now_s) {
  const double angle_deg = std::abs(move.target_deg - from_deg);
  const double duration_s = move_duration_s(angle_deg, move.rate_degps, move.acceleration_degps2);
  const double longest_s = angle_deg / move.rate_degps + 2.0 * move.rate_degps / move.acceleration_degps2;
  at_ = {.move = move,
         .from_deg = from_deg,
         .started_s = now_s,
         .expected_end_s = now_s + duration_s,
         .deadline_s = now_s + longest_s + config_.deadline_margin_s,
         .best_distance_deg = angle_deg,
         .last_progress_s = now_s};
}

void ArrivalMonitor::settle_only(double now_s) {
  at_ = {.started_s = now_s,
         .expected_end_s = now_s,
         .deadline_s = now_s + config_.settle_s + config_.deadline_margin_s,
         .motion_seen = true,
         .arrived_s = now_s};
}

bool ArrivalMonitor::holds(const TableStatus& status) const {
  for (const AxisStatus& axis : status)
    if (axis.moving || !(std::abs(axis.rate_degps) <= config_.settle_rate_degps)) return false;
  if (!at_.move) return true;
  const AxisStatus& axis = status[index(at_.move->axis)];
  const bool armed = at_.motion_seen || at_.polls >= guard_polls;
  return armed && axis.in_position &&
         std::abs(axis.position_deg - at_.move->target_deg) <= config_.position_tolerance_deg;
}

std::optional<RunEvent> ArrivalMonitor::update(const TableStatus& status, double now_s) {
  ++at_.polls;
  if (at_.move) {
    const AxisStatus& axis = status[index(at_.move->axis)];
    at_.motion_seen = at_.motion_seen || axis.moving || std::abs(axis.rate_degps) > config_.settle_rate_degps ||
                      std::abs(axis.position_deg - at_.from_deg) > config_.position_tolerance_deg;
  }
  if (holds(status)) {
    if (!std::exchange(at_.arrived_s, at_.arrived_s.value_or(now_s))) return RunEvent::arrived;
    const bool stood = now_s - *at_.arrived_s >= config_.settle_s - time_slack_s;
    return stood ? std::optional(RunEvent::settled) : std::nullopt;
  }
  const bool was_settling = std::exchange(at_.arrived_s, std::nullopt).has_value();
  if (now_s > at_.deadline_s + time_slack_s) return RunEvent::deadline;
  if (!at_.move) {
    at_.arrived_s = now_s;  // the settle time starts again; the deadline does not
    return std::nullopt;
  }
  if (was_settling) {
    at_.last_progress_s = now_s;
    return RunEvent::unsettled;
  }
  const double distance_deg = std::abs(status[index(at_.move->axis)].position_deg - at_.move->target_deg);
  if (distance_deg < at_.best_distance_deg - progress_deg) {
    at_.best_distance_deg = distance_deg;
    at_.last_progress_s = now_s;
  }
  const bool outside = distance_deg > config_.position_tolerance_deg;
  const bool stalls = outside && now_s - at_.last_progress_s >= config_.stall_s - time_slack_s;
  return stalls ? std::optional(RunEvent::stall) : std::nullopt;
}

double ArrivalMonitor::moment_of_interest_s(double now_s) const {
  if (at_.arrived_s) return *at_.arrived_s + config_.settle_s;
  if (at_.expected_end_s > now_s + time_slack_s) return at_.expected_end_s;
  return at_.deadline_s + 2.0 * time_slack_s;
}

std::optional<std::string> stray_axis(const TableStatus& axes, const AxisTriple& held_deg,
                                      const std::optional<Move>& move, double standing_deg,
                                      double position_tolerance_deg) {
  const double beyond_deg = least_runaway_deg(position_tolerance_deg);
  for (const Axis axis : all_axes) {
    const double at_deg = axes[index(axis)].position_deg, from_deg = held_deg[axis];
    if (move && move->axis == axis) {
      const double low = std::min(from_deg, move->target_deg), high = std::max(from_deg, move->target_deg);
      if (!(at_deg >= low - beyond_deg && at_deg <= high + beyond_deg))
        return fmt::format("{} runs away: at {:.4f} deg on the way from {:.4f} to {:.4f} deg", to_string(axis), at_deg,
                           from_deg, move->target_deg);
    } else if (!(std::abs(at_deg - from_deg) <= standing_deg)) {
      return fmt::format("{} moves although nothing sent it: from {:.4f} to {:.4f} deg", to_string(axis), from_deg,
                         at_deg);
    }
  }
  return std::nullopt;
}

FeltRate::FeltRate(const RecordingInfo& info)
    : degrees_per_count_(nominal_gyro_rad(info) / rad_per_deg),
      period_s_(info.sample_period_s),
      block_samples_(std::max<std::int64_t>(1, std::llround(0.01 / info.sample_period_s))) {}

void FeltRate::add(const ImuSample& sample) {
  const bool flagged = (sample.flags & sample_flag_invalid) != 0;
  if (flagged || (next_counter_ && sample.counter != *next_counter_)) {
    sum_ = {};
    in_block_ = 0;
    known_ = 0;
  }
  next_counter_ = sample.counter + 1;
  if (flagged) return;
  for (std::size_t i = 0; i < 3; ++i) sum_[i] += sample.gyro[i];
  if (++in_block_ == block_samples_) close_block();
}

void FeltRate::close_block() {
  const double block_s = double(block_samples_) * period_s_;
  const double turned_deg = degrees_per_count_ * std::hypot(sum_[0], sum_[1], sum_[2]);
  sum_ = {};
  in_block_ = 0;
  std::rotate(last_degps_.begin(), last_degps_.begin() + 1, last_degps_.end());
  last_degps_.back() = turned_deg / block_s;
  way_deg_ += turned_deg;
  way_s_ += block_s;
  const bool follows = known_ == blocks;
  known_ = std::min(known_ + 1, blocks);
  if (known_ < blocks) return;
  std::array<double, blocks> sorted = last_degps_;
  const double before_degps = std::exchange(median_degps_, median(sorted));
  peak_degps_ = std::max(peak_degps_, median_degps_);
  if (!follows) return;
  const double may_degps = allowed_degps2_ * block_s / scale_, change_degps = median_degps_ - before_degps;
  up_degps_ = std::max(0.0, up_degps_ + change_degps - may_degps);
  down_degps_ = std::max(0.0, down_degps_ - change_degps - may_degps);
  beyond_degps_ = std::max({beyond_degps_, up_degps_, down_degps_});
}

void FeltRate::begin_turn(double allowed_degps2) {
  // When the last turn was not ended, the rest before that turn stays valid.
  if (!turning_) rest_degps_ = way_s_ > 0.0 ? 4.0 * way_deg_ / way_s_ : 0.0;
  way_deg_ = way_s_ = peak_degps_ = up_degps_ = down_degps_ = beyond_degps_ = 0.0;
  allowed_degps2_ = allowed_degps2;
  turning_ = true;
}

std::optional<double> FeltRate::end_turn(double turned_deg) {
  // Ratios of felt to turned angle that a unit may have; beyond them its frame is wrong.
  constexpr double least_deg = 4.0, least = 0.4, same = 0.02;
  const double ratio = way_deg_ / std::abs(turned_deg);
  const double felt_degps = peak_degps_;
  const bool tells = std::abs(turned_deg) >= least_deg && ratio >= least && ratio <= largest_scale;
  // Two turns have to agree, because one alone may have lost samples.
  const bool agrees = tells && std::abs(ratio - ratio_) <= same * ratio;
  if (agrees) scale_ = 1.0 / ratio;
  confirmed_ = confirmed_ || agrees;
  if (tells && (agrees || !confirmed_)) ratio_ = ratio;
  const bool felt_whole = std::abs(way_deg_ * scale_ - std::abs(turned_deg)) <= 0.3 + 0.005 * std::abs(turned_deg);
  jump_degps_ = confirmed_ && felt_whole ? (beyond_degps_ - 2.0 * rest_degps_) * scale_ : 0.0;
  least_way_deg_ = std::max(0.0, way_deg_ - rest_degps_ * way_s_) * (confirmed_ ? scale_ : 1.0 / largest_scale);
  way_deg_ = way_s_ = 0.0;
  turning_ = false;
  return tells ? std::optional(felt_degps / ratio) : std::nullopt;
}

std::optional<double> FeltRate::now_degps() const {
  if (known_ < blocks) return std::nullopt;
  return std::max(0.0, median_degps_ - rest_degps_) * scale_;
}

double SpeedWatch::allowed_degps(Axis axis, const std::optional<Move>& sent, bool searches) const {
  const double most_degps = limits_[index(axis)].max_rate_degps;
  if (searches || !sent || sent->axis != axis) return most_degps;
  return std::min(factor * sent->rate_degps, std::max(most_degps, sent->rate_degps));
}

std::string SpeedWatch::too_fast(Axis axis, double degps, const char* by, const std::optional<Move>& sent) const {
  const double most_degps = limits_[index(axis)].max_rate_degps;
  if (!sent || sent->axis != axis)
    return fmt::format("{} turns at {:.4g} deg/s ({}): expected at most {:.4g} deg/s", to_string(axis), degps, by,
                       most_degps);
  const bool most_decides = most_degps < factor * sent->rate_degps;
  return fmt::format("{} turns at {:.4g} deg/s, {:.3g} times the {:.4g} deg/s that were sent{} ({})", to_string(axis),
                     degps, degps / sent->rate_degps, sent->rate_degps,
                     most_decides ? ", above max_rate_degps, " + format_number(most_degps) : "", by);
}

void SpeedWatch::restart(const TableStatus& axes, double asked_s, double answered_s) {
  before_.reset();
  static_cast<void>(add(axes, asked_s, answered_s, std::nullopt, false));
}

std::optional<std::string> SpeedWatch::add(const TableStatus& axes, double asked_s, double answered_s,
                                           const std::optional<Move>& sent, bool searches) {
  if (!before_) beyond_ = {};
  Reading now{{}, asked_s, answered_s};
  std::optional<std::string> said;
  for (const Axis axis : all_axes) {
    const AxisStatus& read = axes[index(axis)];
    Beyond& beyond = beyond_[index(axis)];
    now.at_deg[axis] = read.position_deg;
    const double allowed = allowed_degps(axis, sent, searches);
    const double rate_degps = std::abs(read.rate_degps);
    if (read.rate_told && rate_degps > allowed + rate_margin_degps(allowed))
      return too_fast(axis, rate_degps, "by its own rate", sent);
    if (!before_) continue;
    const double change_deg = read.position_deg - before_->at_deg[axis], longest_s = answered_s - before_->asked_s;
    if (searches && std::abs(change_deg) > 2.0 * allowed * longest_s && beyond.set_anew++ < zeros) continue;
    const double late_deg = allowed * (before_->answered_s - before_->asked_s);
    const double may_deg = allowed * (answered_s - before_->answered_s);
    for (const double way : {1.0, -1.0}) {
      Excess& excess = way > 0.0 ? beyond.up : beyond.down;
      if (excess.deg <= -late_deg) excess = {-late_deg, before_->answered_s};
      excess.deg += way * change_deg - may_deg;
      if (excess.deg > 0.1 + allowed * stale_s * speed_up_)
        said = too_fast(axis, allowed + excess.deg / (answered_s - excess.since_s), "by its positions", sent);
    }
  }
  before_ = now;
  return said;
}

std::optional<std::string> SpeedWatch::add_felt(const std::vector<const FeltRate*>& felt, const TableStatus& axes,
                                                const std::optional<Move>& sent, bool searches) const {
  double most_degps = 0.0;
  for (const AxisLimits& axis : limits_) most_degps = std::max(most_degps, axis.max_rate_degps);
  std::optional<double> rate_degps;  // least over the units
  for (const FeltRate* unit : felt) {
    // In a search the scale is not yet known, so the largest one is assumed.
    std::optional<double> now = unit->confirmed() || searches ? unit->now_degps() : std::nullopt;
    if (!now) continue;
    if (!unit->confirmed()) *now /= FeltRate::largest_scale;
    rate_degps = std::min(rate_degps.value_or(*now), *now);
  }
  if (!rate_degps) return std::nullopt;
  const double allowed = sent ? allowed_degps(sent->axis, sent, false) : most_degps;
  if (!(*rate_degps > allowed + felt_margin_degps(allowed))) return std::nullopt;
  if (!sent)
    return fmt::format(
        "the unit feels {:.4g} deg/s: expected at most {:.4g} deg/s, max_rate_degps; or the scale of its frame",
        *rate_degps, most_degps);
  return fmt::format(
      "the unit feels {:.4g} deg/s, {:.3g} times the {:.4g} deg/s that {} was sent at, where the table reads {:.4g} "
      "deg/s: the scale of the table's angles or rates, or that of the unit's frame",
      *rate_degps, *rate_degps / sent->rate_degps, sent->rate_degps, to_string(sent->axis),
      axes[index(sent->axis)].rate_degps);
}

std::optional<std::string> SpeedWatch::judge_turn(const std::vector<const FeltRate*>& felt, const Move& move,
                                                  double turned_deg) {
  std::optional<double> jump_degps, way_deg;  // least over the units
  for (const FeltRate* unit : felt) {
    way_deg = std::min(way_deg.value_or(unit->least_way_deg()), unit->least_way_deg());
    if (unit->confirmed()) jump_degps = std::min(jump_degps.value_or(unit->jump_degps()), unit->jump_degps());
  }
  if (way_deg.value_or(0.0) > std::abs(turned_deg) + way_margin_deg(turned_deg))
    return fmt::format("the unit felt that {} turned by {:.4g} deg, where the table read {:.4g} deg",
                       to_string(move.axis), *way_deg, std::abs(turned_deg));
  if (jump_degps.value_or(0.0) <= jump_margin_degps(move.rate_degps)) return std::nullopt;
  return fmt::format(
      "{} was sped up or braked too quickly: its rate changed by {:.3g} deg/s more than it may at the {:.4g} deg/s^2 "
      "that were sent, as the unit felt it",
      to_string(move.axis), *jump_degps, move.acceleration_degps2);
}

std::optional<std::string> HomingWatch::add(const TableStatus& axes) {
  const std::optional<TableStatus> before = std::exchange(before_, axes);
  if (!before) return std::nullopt;
  double passed_s = 0.0;
  bool any_turns = false;
  for (const Axis axis : all_axes) {
    const auto i = index(axis);
    const double seconds = axes[i].time_s - (*before)[i].time_s;
    const double moved_deg = std::abs(axes[i].position_deg - (*before)[i].position_deg);
    const bool set_anew = moved_deg > 2.0 * limits_[i].max_rate_degps * seconds;
    const double by_rate_deg = std::isfinite(axes[i].rate_degps) ? std::abs(axes[i].rate_degps) * seconds : 0.0;
    turned_deg_[axis] += std::max(by_rate_deg, set_anew ? 0.0 : moved_deg);
    passed_s = std::max(passed_s, seconds);
    any_turns = any_turns || axes[i].moving || std::max(by_rate_deg, moved_deg) > turns_degps * seconds;
    const double travel_deg = limits_[i].soft_max_deg - limits_[i].soft_min_deg;
    const double most_deg = std::min(2.0 * travel_deg, travel_deg + 360.0);
    if (!(turned_deg_[axis] <= most_deg))
      return fmt::format("{} does not find its zero: it has turned {:.0f} deg, its travel is {:.0f} deg",
                         to_string(axis), turned_deg_[axis], travel_deg);
  }
  idle_s_ = any_turns ? 0.0 : idle_s_ + passed_s;
  for (const Axis axis : all_axes) {
    const AxisStatus& now = axes[index(axis)];
    if (!(idle_s_ < homing_begins_s) && !now.homed)
      return fmt::format("{} does not look for its zero: it stands at {:.4f} deg, and nothing has turned for {:.0f} s",
                         to_string(axis), now.position_deg, idle_s_);
  }
  return std::nullopt;
}

}  // namespace turncal
